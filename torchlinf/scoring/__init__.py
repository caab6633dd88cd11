"""Masks in files and archives in, one row of numbers a mask out. Nothing that is wrong with one stops the others.

`scoring.distributed` does the same on many machines; it needs the extra `ray` and is imported by its own name.
"""

from torchlinf.scoring.compare import COMPARED, Column, Comparison, Join, Pair, compare_scores, write_pairs
from torchlinf.scoring.mask_rules import MAX_PIXELS, RULE, inside_above, read_mask, read_source
from torchlinf.scoring.readers import SUFFIXES, UnreadableMaskError
from torchlinf.scoring.rows import COLUMNS, NoTableError, Score
from torchlinf.scoring.score import score_mask, score_masks, score_source
from torchlinf.scoring.shards import Options, Part, Shard, find_shards
from torchlinf.scoring.sources import Source, find_masks
from torchlinf.scoring.tables import JOURNAL, open_table, read_table
from torchlinf.scoring.terminal import print_table
from torchlinf.scoring.workers import NoWorkersError

__all__ = [
    "COLUMNS",
    "COMPARED",
    "JOURNAL",
    "MAX_PIXELS",
    "RULE",
    "SUFFIXES",
    "Column",
    "Comparison",
    "Join",
    "NoTableError",
    "NoWorkersError",
    "Options",
    "Pair",
    "Part",
    "Score",
    "Shard",
    "Source",
    "UnreadableMaskError",
    "compare_scores",
    "find_masks",
    "find_shards",
    "inside_above",
    "open_table",
    "print_table",
    "read_mask",
    "read_source",
    "read_table",
    "score_mask",
    "score_masks",
    "score_source",
    "write_pairs",
]
