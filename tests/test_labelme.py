"""labelme's JSON: each object is what labelme draws of it, by closed forms."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from torchlinf.scoring import Score, find_masks, read_source, score_masks

HEIGHT, WIDTH = 30, 44
ROW, COLUMN = np.mgrid[:HEIGHT, :WIDTH]


def shape(points: list[list[float]], kind: str | None = "polygon", label: str = "cat", **more: Any) -> dict[str, Any]:
    return {"label": label, "points": points, "group_id": None, "shape_type": kind, "flags": {}, **more}


def write(folder: Path, *shapes: Any, **more: Any) -> Path:
    content = {"version": "5.5.0", "flags": {}, "shapes": shapes, "imagePath": "cat.jpg", "imageData": None}
    path = folder / "cat.json"
    path.write_text(json.dumps(content | {"imageHeight": HEIGHT, "imageWidth": WIDTH} | more))
    return path


def masks(path: Path) -> list[np.ndarray]:
    return [read_source(source) for source in find_masks([path])]


def rows(path: Path) -> list[Score]:
    return list(score_masks(find_masks([path])))


def test_polygons_and_rectangles_hold_their_outline(tmp_path: Path) -> None:
    triangle = shape([[4, 3], [24, 3], [4, 23]])
    corners = [[30, 25], [12, 20]]  # the second one first: people draw from any corner
    path = write(tmp_path, triangle, shape(corners, "rectangle", "dog"), shape([[4, 3], [24, 3], [4, 23]], None))
    first, second, third = masks(path)
    expected = (COLUMN >= 4) & (ROW >= 3) & (COLUMN + ROW <= 27)
    np.testing.assert_array_equal(first, expected)
    np.testing.assert_array_equal(second, (COLUMN >= 12) & (COLUMN <= 30) & (ROW >= 20) & (ROW <= 25))
    np.testing.assert_array_equal(third, expected)  # old files name no kind
    scored = rows(path)
    assert [row.path for row in scored] == [f"{path}:{i}" for i in range(3)]
    assert [(row.category, row.image, row.inside, row.error) for row in scored] == [
        ("cat", "cat.jpg", "outline", None), ("dog", "cat.jpg", "outline", None), ("cat", "cat.jpg", "outline", None)
    ]  # fmt: skip
    assert scored[1]["complexity"] == 0.0


def test_a_circle_is_a_centre_and_a_point_of_its_rim(tmp_path: Path) -> None:
    (circle,) = masks(write(tmp_path, shape([[20, 14], [20 + 6, 14 - 8]], "circle")))
    distance = np.hypot(ROW - 14, COLUMN - 20)
    assert circle[distance <= 9.5].all()
    assert not circle[distance >= 10.6].any()


def test_shapes_of_one_group_are_one_object(tmp_path: Path) -> None:
    left, right = [[2, 2], [6, 9]], [[20, 2], [26, 12]]
    path = write(
        tmp_path,
        shape(left, "rectangle", group_id=1),
        shape(right, "rectangle", "dog", group_id=1),  # the same number, another label: another object
        shape(right, "rectangle", group_id=1),
        shape([[5, 5], [30, 6]], "line", group_id=1),  # beside an area a line does not count
        shape(left, "rectangle"),
    )
    assert [row.path.rpartition(":")[2] for row in rows(path)] == ["0", "1", "4"]
    assert [row.pixels for row in rows(path)] == [5 * 8 + 7 * 11, 7 * 11, 5 * 8]
    assert [row.components for row in rows(path)] == [2, 1, 1]


def test_a_stored_mask_lies_at_its_corners(tmp_path: Path) -> None:
    stored = np.random.default_rng(0).random((7, 11)) > 0.4
    file = io.BytesIO()
    Image.fromarray(stored.astype(np.uint8)).save(file, "PNG")
    text = base64.b64encode(file.getvalue()).decode()
    path = write(
        tmp_path,
        shape([[5.0, 8.0], [15.0, 14.0]], "mask", mask=text),
        shape([[-3, 26], [7, 32]], "mask", mask=text),  # it leaves the image at the left and below
        shape([[5, 8], [16, 14]], "mask", mask=text),
        shape([[5, 8], [15, 14]], "mask", mask="?"),
    )
    first, second = (read_source(source) for source in find_masks([path])[:2])
    expected = np.zeros((HEIGHT, WIDTH), dtype=bool)
    expected[8:15, 5:16] = stored
    np.testing.assert_array_equal(first, expected)
    expected[:] = False
    expected[26:, :8] = stored[:4, 3:]
    np.testing.assert_array_equal(second, expected)
    assert all("must be a PNG in base64" in row.error for row in rows(path)[2:])


def test_the_image_tells_its_size_where_the_file_does_not(tmp_path: Path) -> None:
    box = shape([[2, 2], [6, 9]], "rectangle")
    path = write(tmp_path, box, imageHeight=None, imageWidth=None)
    (row,) = rows(path)
    assert "no imageHeight and imageWidth" in row.error
    Image.new("RGB", (WIDTH + 1, HEIGHT)).save(tmp_path / "cat.jpg")
    assert rows(path)[0].width == WIDTH + 1
    file = io.BytesIO()
    Image.new("L", (WIDTH + 2, HEIGHT)).save(file, "PNG")
    write(tmp_path, box, imageHeight=None, imageData=base64.b64encode(file.getvalue()).decode())
    assert rows(path)[0].width == WIDTH + 2


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (shape([[1, 1], [5, 5]], "line"), "a line encloses no area"),
        (shape([[1, 1]], "point"), "a point encloses no area"),
        (shape([[1, 1], [5, 5]]), "three or more points; got 2"),
        (shape([[1, 1]], "circle"), "must have 2 points; got 1"),
        (shape([[1, 1], [5, 5], [7, float("nan")]]), "finite coordinates"),
        (shape([[1, 1, 1]] * 3), "pairs x, y"),
        (shape([[1, 1], [5, 5], [7, 1]], "spline"), "got spline"),
        (17, "not an object"),
        (shape([[50, 50], [60, 60]], "rectangle"), "no pixel is inside"),
    ],
)
def test_what_is_no_shape_is_a_row(one: Any, words: str, tmp_path: Path) -> None:
    bad, good = rows(write(tmp_path, one, shape([[2, 2], [6, 9]], "rectangle")))
    assert words in bad.error
    assert good.pixels == 40
