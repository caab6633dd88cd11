"""Text for a terminal: no name steers it, every name can be printed, and names stay visible in a narrow table."""

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

# Control characters, line separators, marks that turn the direction of the text around, halves of surrogate pairs.
UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
WIDEST_NAME = 24  # characters that a name should have at least, if it is so long


def printable(text: str, encoding: str | None = None) -> str:
    r"""A text on one line, with escapes for what would steer a terminal, and for what `encoding` does not have.

    A byte of a file name that is no UTF-8, which Python has as half of a surrogate pair, is shown as that byte.

    >>> print(printable("a\x1b[31m\nb\udcff"))
    a\x1b[31m\nb\xff
    """
    return encodable(UNPRINTABLE.sub(lambda match: _escape(match[0]), text), encoding)


def encodable(text: str, encoding: str | None) -> str:
    r"""A text with escapes for what an encoding does not have; None is UTF-8.

    >>> encodable("ü", "ascii"), encodable("ü", None)
    ('\\xfc', 'ü')
    """
    encoding = encoding or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)


def _escape(character: str) -> str:
    byte = ord(character) - 0xDC00
    return f"\\x{byte:02x}" if 0x80 <= byte <= 0xFF else character.encode("unicode_escape").decode()


def names_table(
    names: Sequence[str],
    numbers: Mapping[str, Sequence[str]],
    *,
    width: int,
    texts: Mapping[str, Sequence[str]] | None = None,
    important: Sequence[str] = (),
    title: str = "",
    caption: str = "",
) -> "Table":
    """A table for people whose first column has names, as wide as they need.

    In a narrow terminal columns of numbers are left out, which the caption says, and names are folded.

    Args:
        names: of the rows, as they are to be shown.
        numbers: columns by their titles; they are not folded.
        width: of the terminal, characters.
        texts: further columns, which are folded.
        important: titles of numbers; the last ones are left out first, and before them those that are not in it, from
            the right.
        title: above the table.
        caption: below the table.
    """
    from rich.box import SIMPLE_HEAD
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    folded = {"mask": names, **(texts or {})}
    natural = [max(map(cell_len, (head, *column))) for head, column in folded.items()]
    wanted = min(natural[0], WIDEST_NAME, max(4, width // 2 - 4))
    ranks = [*important, *(head for head in numbers if head not in important)]
    kept = list(numbers)
    while True:
        # The box takes a character at each end, and each column has two to the next one.
        fixed = sum(max(map(cell_len, (head, *numbers[head]))) for head in kept) + 2 * (len(kept) + len(folded))
        widths = _shared(natural, width - fixed)
        if widths[0] >= wanted or len(kept) < 2:
            break
        kept.remove(max(kept, key=ranks.index))
    if left := [head for head in numbers if head not in kept]:
        caption = f"{caption} Not shown, for want of width: {', '.join(left)}.".strip()
    table = Table(
        title=Text(title) if title else None,
        caption=Text(caption) if caption else None,
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("mask", overflow="fold", width=widths[0])
    for head in kept:
        table.add_column(Text(head), justify="right", no_wrap=True)
    for head, size in zip(texts or {}, widths[1:], strict=True):
        table.add_column(head, overflow="fold", width=size)
    for row in range(len(names)):
        cells = (names[row], *(numbers[head][row] for head in kept), *(text[row] for text in (texts or {}).values()))
        table.add_row(*map(Text, cells))
    return table


def _shared(natural: Sequence[int], room: int) -> list[int]:
    """Widths that fit into the room together, the widest cut first.

    >>> _shared([30, 5, 12], 25), _shared([3, 4], 25)
    ([10, 5, 10], [3, 4])
    """
    cap = max(natural)
    while cap > 4 and sum(min(cap, one) for one in natural) > room:
        cap -= 1
    return [min(cap, one) for one in natural]
