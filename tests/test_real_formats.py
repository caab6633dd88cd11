"""Files of people who keep masks, named by TORCHLINF_FORMATS, against other decoders: one row a mask, no pixel off."""

import gzip
import json
import os
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from pycocotools import mask as coco

from torchlinf.scoring import find_masks, read_source, score_masks

FOLDER = Path(os.environ.get("TORCHLINF_FORMATS", "none"))
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="TORCHLINF_FORMATS names no folder of files")

ASKED = "and inside is not clear: pass --labels"


def labels_of(path: Path) -> np.ndarray:
    """The labels of a file, by another reader than ours, or by the definition of the format."""
    if path.suffix == ".gz":  # NIfTI 1 of 16-bit numbers
        content = gzip.decompress(path.read_bytes())
        x, y, z = np.frombuffer(content, "<i2", 3, 42).tolist()
        return np.frombuffer(content, "<u2", x * y * z, 352).reshape(z, y, x)
    if path.suffix == ".tif":
        return tifffile.imread(path)
    picture = np.asarray(Image.open(path)).astype(np.int64)
    return picture if picture.ndim == 2 else picture @ [1, 256, 65536]


@pytest.mark.parametrize(
    "path", [*sorted(FOLDER.glob("*/*.tif")), *sorted(FOLDER.glob("*/*.png")), *FOLDER.glob("*/*.gz")]
)
def test_label_maps_ask_and_give_a_row_a_label(path: Path) -> None:
    (asked,) = score_masks(find_masks([path]))
    assert ASKED in asked.error
    labels = labels_of(path)
    ignore = [255] if path.name.startswith("voc") else []
    names = [name for name in np.unique(labels).tolist() if name not in (0, *ignore)]
    rows = list(score_masks(find_masks([path]), labels=True, ignore=ignore, tol=1e-3, tol_bits=float("inf")))
    assert [row.label for row in rows] == names
    assert [row.pixels for row in rows] == [np.count_nonzero(labels == name) for name in names]
    assert [row.error for row in rows] == [None] * len(rows)
    assert {row.spacing for row in rows} == {"2 x 2 x 2" if path.suffix == ".gz" else None}


@pytest.mark.filterwarnings("ignore:__array__ implementation")  # pycocotools 2.0.11 with NumPy 2
@pytest.mark.parametrize("path", sorted(FOLDER.glob("*/*.json")))
def test_annotations_are_those_of_pycocotools(path: Path) -> None:
    content = json.loads(path.read_text())
    annotations = content if isinstance(content, list) else content["annotations"]
    sizes = {} if isinstance(content, list) else {one["id"]: one for one in content["images"]}
    sources = find_masks([path])
    assert len(sources) == len(annotations)
    for source, annotation in zip(sources, annotations, strict=True):
        packed = annotation["segmentation"]
        if isinstance(packed, list):
            image = sizes[annotation["image_id"]]
            packed = coco.merge(coco.frPyObjects(packed, image["height"], image["width"]))
        np.testing.assert_array_equal(read_source(source), coco.decode(packed) > 0)
