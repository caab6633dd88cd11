"""From folders to rows: which masks are found, what a row says, and that nothing stops the others."""

import csv
import dataclasses
import io
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import torchlinf
from tests.mask_files import noise
from torchlinf import ComplexityProfile, Measure, complexity, shapes
from torchlinf.scoring import Score, Source, find_masks, score_mask, score_masks, score_source
from torchlinf.scoring import score as score_module
from torchlinf.scoring.rows import csv_line


def save(path: Path, mask: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(path)
    return path


def names(sources: list[Source], folder: Path) -> list[str]:
    return [os.path.relpath(source.name, folder) for source in sources]


def untimed(row: Score) -> Score:
    return dataclasses.replace(row, seconds=None)


def test_folders_are_searched_in_order(tmp_path: Path) -> None:
    for name in ("b.png", "a.TIF", "deep/er/c.npy", "deep/d.jpeg", "notes.txt", ".hidden.png", ".cache/e.png", "a.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")
    found = names(find_masks([tmp_path]), tmp_path)
    assert found == ["a.TIF", "b.png", "deep/d.jpeg", "deep/er/c.npy"]
    # What is named is taken, whatever its name, and in the order it is named.
    named = [tmp_path / "notes.txt", tmp_path / "deep", tmp_path / "gone.png"]
    assert names(find_masks(named), tmp_path) == ["notes.txt", "deep/d.jpeg", "deep/er/c.npy", "gone.png"]
    assert find_masks([tmp_path / ".cache", tmp_path / "deep" / "er"])  # a hidden folder that is named is searched
    assert find_masks([]) == []


def test_links_do_not_lead_in_circles(tmp_path: Path) -> None:
    save(tmp_path / "masks" / "a.png", noise(0, 5, 7))
    save(tmp_path / "elsewhere" / "b.png", noise(1, 5, 7))
    (tmp_path / "masks" / "loop").symlink_to(tmp_path / "masks", target_is_directory=True)
    (tmp_path / "masks" / "link").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    (tmp_path / "elsewhere" / "back").symlink_to(tmp_path / "masks", target_is_directory=True)
    (tmp_path / "masks" / "broken.png").symlink_to(tmp_path / "nowhere.png")
    assert names(find_masks([tmp_path / "masks"]), tmp_path / "masks") == ["a.png", "broken.png", "link/b.png"]


def test_a_folder_that_cannot_be_searched_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path / "open.png", noise(0, 5, 7))
    (tmp_path / "closed").mkdir()
    search = os.scandir

    def refuse(path: str) -> object:  # permissions would not stop a superuser who runs the tests
        if os.path.basename(path) == "closed":
            raise PermissionError(13, "Permission denied", path)
        return search(path)

    monkeypatch.setattr(os, "scandir", refuse)
    rows = list(score_masks(find_masks([tmp_path])))
    assert [(os.path.basename(row.path), row.error) for row in rows] == [
        ("closed", "cannot be searched (Permission denied)"),
        ("open.png", None),
    ]


def test_the_arrays_of_an_archive_are_masks_of_their_own(tmp_path: Path) -> None:
    first, second = noise(0, 6, 9), noise(1, 4, 5, 6)
    np.savez_compressed(tmp_path / "two.npz", first=first, second=second)
    np.savez(tmp_path / "one.npz", only=first)
    rows = list(score_masks(find_masks([tmp_path]), volume=True))
    assert [os.path.basename(row.path) for row in rows] == ["one.npz", "two.npz:first", "two.npz:second"]
    assert [row.pixels for row in rows] == [first.sum(), first.sum(), second.sum()]
    assert [(row.depth, row.height, row.width) for row in rows] == [(None, 6, 9), (None, 6, 9), (4, 5, 6)]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
def test_names_that_are_no_text(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/caf\xe9,\n.png"
    save(Path(os.fsdecode(path)), noise(0, 5, 7))
    (row,) = score_masks(find_masks([tmp_path]))
    assert row.error is None
    assert next(csv.reader(io.StringIO(csv_line(row.cells().values()))))[0] == f"{tmp_path}/caf\\xe9,\n.png"
    row.path.encode()


@pytest.mark.parametrize("size", [(13, 22), (5, 8, 11)])
def test_a_row_says_what_the_core_says(size: tuple[int, ...]) -> None:
    mask = np.pad(noise(3, *size), [(i, 7 - i) for i in range(len(size))])
    row = score_mask(mask, spatial_ndim=mask.ndim)
    profile = torchlinf.complexity_profile(torch.from_numpy(mask), spatial_ndim=mask.ndim)
    levels = profile.levels()
    assert row["pixels"] == mask.sum()
    assert row["radius"] == profile.radius == len(levels) >= 2
    assert row["complexity"] == float(profile.mean()) > 0
    assert row["complexity_low"] == float(profile.mean(0, 0.25))
    assert row["complexity_high"] == float(profile.mean(0.25, 1))
    assert row["peak"] == float(levels.max()) == float(levels[math.ceil(row["peak_scale"] * len(levels) - 1e-9) - 1])
    assert 0 <= row["field_error_bound"] <= 1e-9
    assert tuple(row[name] for name in ("depth", "height", "width")[-mask.ndim :]) == mask.shape
    assert (row["depth"] is None) == (mask.ndim == 2)


@pytest.mark.parametrize(
    "options",
    [
        {"low": 0.1, "high": 0.6},
        {"windows": None},
        {"windows": {"fine": (0, 0.25), "all": (0, 1)}, "bins": 64},
        {"estimator": "std", "rho": 3.5, "tol": 1e-6, "high": 0.5},
    ],
)
def test_every_function_takes_the_options_of_the_measure(options: dict[str, object], tmp_path: Path) -> None:
    mask = noise(3, 13, 22)
    source = find_masks([save(tmp_path / "a.png", mask)])[0]
    measure = Measure(**options)
    plain = {name: value for name, value in options.items() if name != "windows"}
    expected = {
        name: complexity(torch.from_numpy(mask), spatial_ndim=2, **plain | {"low": low, "high": high}).item()
        for name, (low, high) in measure.named_windows().items()
    }
    row = score_source(source, **options)
    assert row.values == expected
    assert list(expected) == (["fine", "all"] if options.get("windows") else ["complexity"])
    assert row.measure == measure.settings()
    assert row.version == torchlinf.__version__
    assert [untimed(one) for one in score_masks([source], **options)] == [untimed(row)]
    numbers = score_mask(mask, **options)
    assert {name: numbers[name] for name in expected} == expected


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"bins": 0}, ValueError, "bins must be an integer of 1 or more; got 0"),
        ({"rho": torch.tensor([1.0])}, TypeError, "rho must be None or one number here; got a tensor"),
        ({"windows": {"pixels": (0, 1)}}, ValueError, "windows must have names that no other column has; got 'pixels'"),
        ({"windows": {"a": (0, 1)}, "low": 0.5}, ValueError, "windows must stand instead of low and high"),
        ({"colour": "red"}, TypeError, "colour is not an option here"),
    ],
)
def test_wrong_options_are_no_rows(options: dict[str, object], error: type, words: str, tmp_path: Path) -> None:
    source = find_masks([save(tmp_path / "a.png", noise(0, 5, 7))])[0]
    for call in (
        lambda: score_mask(noise(0, 5, 7), **options),
        lambda: score_masks([source], **options),
        lambda: score_source(source, **options),
    ):
        with pytest.raises(error, match=words):
            call()


def test_settings_of_reading_are_checked() -> None:
    with pytest.raises(TypeError, match="threshold must be a number or None; got '127'"):
        score_masks([], threshold="127")
    with pytest.raises(ValueError, match="max_pixels must be an integer of 1 or more; got 0"):
        score_masks([], max_pixels=0)


def test_known_rows() -> None:
    square = score_mask(np.ones((12, 12), dtype=bool))
    assert [square[name] for name in ("complexity", "complexity_low", "complexity_high", "peak")] == [0.0] * 4
    disc = score_mask(shapes.disc(32, margin=3).numpy())
    assert disc["complexity"] == pytest.approx(2.378, abs=5e-4)
    assert disc["peak"] == pytest.approx(3.114, abs=5e-4)
    assert (disc["radius"], disc["height"]) == (23, 71)


def test_components_connect_at_corners() -> None:
    mask = np.kron(np.eye(3, dtype=bool), np.ones((3, 4), dtype=bool))
    assert score_mask(mask)["components"] == 1
    mask[3:6] = np.roll(mask[3:6], 1, axis=1)
    assert score_mask(mask)["components"] == 2


def test_every_file_gives_its_row_in_order_whatever_the_workers(tmp_path: Path) -> None:
    for i in range(40):
        save(tmp_path / f"{i:02}.png", noise(i, 9 + i % 7, 16))
    (tmp_path / "07.png").write_bytes(b"")
    (tmp_path / "23.png").write_bytes(b"no image")
    save(tmp_path / "31.png", np.zeros((4, 6), dtype=bool))
    rows = list(score_masks(find_masks([tmp_path]), workers=1))
    assert [os.path.basename(row.path) for row in rows] == [f"{i:02}.png" for i in range(40)]
    assert [i for i, row in enumerate(rows) if row.error] == [7, 23, 31]
    assert all(row.seconds is not None and row.seconds > 0 for row in rows)
    assert len({row["complexity"] for row in rows}) > 30
    parallel = score_masks(iter(find_masks([tmp_path])), workers=3)
    assert [untimed(row) for row in parallel] == [untimed(row) for row in rows]


def test_a_mask_without_foreground_says_so(tmp_path: Path) -> None:
    (row,) = score_masks(find_masks([save(tmp_path / "black.png", np.zeros((4, 6), dtype=bool))]))
    assert (row.height, row.width, row.pixels, row.radius, row.components) == (4, 6, 0, 0, 0)
    assert set(row.values.values()) == {None}
    assert row.version == torchlinf.__version__
    assert "no foreground" in row.error


@pytest.mark.parametrize("error", [RuntimeError("field 0\ndid not converge"), MemoryError(), ZeroDivisionError("?")])
def test_the_unexpected_is_a_row_too(error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = score_module.ragged_profile

    def fail_on_the_second(mask_at: Callable[[int], np.ndarray], count: int, measure: Measure) -> ComplexityProfile:
        if mask_at(0).shape == (5, 8):
            raise error
        return real(mask_at, count, measure)

    monkeypatch.setattr(score_module, "ragged_profile", fail_on_the_second)
    paths = [save(tmp_path / f"{width}.png", noise(width, 5, width)) for width in (7, 8, 9)]
    rows = list(score_masks(find_masks(paths)))
    assert [row.error is None for row in rows] == [True, False, True]
    assert rows[1].error.startswith(type(error).__name__)
    assert "\n" not in rows[1].error


def test_an_interrupt_is_no_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(score_module, "ragged_profile", interrupt)
    with pytest.raises(KeyboardInterrupt):
        list(score_masks(find_masks([save(tmp_path / "a.png", noise(0, 5, 7))])))


@pytest.mark.skipif("TORCHLINF_MPEG7" not in os.environ, reason="TORCHLINF_MPEG7 names no folder of silhouettes")
def test_real_silhouettes() -> None:
    rows = {Path(row.path).stem: row for row in score_masks(find_masks([os.environ["TORCHLINF_MPEG7"]]), workers=2)}
    assert len(rows) == 40
    assert all(row.error is None and row.field_error_bound <= 1e-9 for row in rows.values())
    assert rows["bat-10"]["complexity"] == pytest.approx(5.26800, abs=5e-6)
    assert rows["bat-20"]["complexity"] == pytest.approx(5.61955, abs=5e-6)


@pytest.mark.parametrize("workers", [1, 2])
def test_paths_are_no_sources(workers: int) -> None:
    with pytest.raises(TypeError, match=r"got 'a\.png'\. Pass find_masks\(paths\)"):
        list(score_masks(["a.png"], workers=workers))
