"""Tables that other programs have saved, or that are in another format: the rows are the same, or the message says why.

What pandas writes is what pandas writes here; the rest is written by hand as those programs do it.
"""

import csv
import gzip
import io
import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from torchlinf import Measure
from torchlinf.cli import app
from torchlinf.scoring import (
    COLUMNS,
    JOURNAL,
    WINDOWS,
    NoTableError,
    Pair,
    Score,
    open_table,
    read_table,
    write_pairs,
    write_table,
)

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke

SETTINGS = {"version": "0.0.1", "measure": Measure(windows=WINDOWS).settings()}
FORMULAS = (
    "=1+1.png",
    "+a.png",
    "-a.png",
    "@a.png",
    "\ta.png",
    "\ra.png",
    "\na.png",
    "'=a.png",
    "''-a",
    "'a'",
    "\uff1da",
)


def row(path: str, complexity: float | None, **cells: object) -> Score:
    values = dict(zip(WINDOWS, (complexity, -1.5, 0.1 + 0.2) if complexity is not None else (None,) * 3, strict=True))
    return Score(path, values=values, **cells, **SETTINGS)


ROWS = [
    row("a, b.png", 2.5, height=31, width=44, pixels=100, radius=4, components=1, error_bound=0.0, category="17"),
    row('ü "q".png', 1 / 3, height=5, width=7, pixels=12, radius=2, components=2, error_bound=1e-12, inside="> 127"),
    row("none.png", None, error="no foreground: no pixel is inside", category="none"),
    *(row(name, float(i)) for i, name in enumerate(FORMULAS)),
]
# As others write them: without apostrophes of guarded cells, and without the line breaks that pandas does not keep.
PLAIN = [*ROWS[:3], *(one for one in ROWS[3:] if one.path.isprintable() and not one.path.startswith("'"))]


def frame(rows: list[Score] = PLAIN) -> pd.DataFrame:
    """The table as pandas has it after read_csv."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerows([COLUMNS, *(one.cells().values() for one in rows)])
    return pd.read_csv(io.StringIO(text.getvalue()), dtype={"category": str}, keep_default_na=False, na_values=[""])


def written(path: Path, rows: list[Score] = ROWS) -> Path:
    with open_table(path) as put:
        for one in rows:
            put(one)
    return path


FORMATS = ("csv", "tsv", "txt", "jsonl", "ndjson", "parquet", "csv.gz", "tsv.gz", "jsonl.gz")


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_rows_back_and_is_resumed(suffix: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"scores.{suffix}", ROWS[:2])
    with pytest.raises(KeyboardInterrupt), open_table(path, resume=True) as put:  # noqa: PT012
        put(ROWS[2])
        raise KeyboardInterrupt
    assert sorted(os.listdir(tmp_path)) == [f"scores.{suffix}", f"scores.{suffix}{JOURNAL}"]
    with open_table(path, resume=True) as put:
        assert list(put.done) == [one.path for one in ROWS[:3]]
        for one in ROWS[3:]:
            put(one)
    assert list(read_table(path)) == ROWS
    assert os.listdir(tmp_path) == [f"scores.{suffix}"]
    assert list(read_table(tmp_path)) == ROWS if suffix != "txt" else True
    start = path.read_bytes()[:2]
    assert (start == b"\x1f\x8b") == suffix.endswith("gz")
    if "tsv" in suffix:
        text = gzip.decompress(path.read_bytes()) if suffix.endswith("gz") else path.read_bytes()
        assert text.split(b"\n")[0].split(b"\t") == [name.encode() for name in COLUMNS]
        read = pd.read_csv(path, sep="\t")
        assert read["pixels"].tolist()[:2] == [100, 12]


def test_equal_tables_are_equal_files(tmp_path: Path) -> None:
    first, second = (written(tmp_path / name).read_bytes() for name in ("a.csv.gz", "b.csv.gz"))
    assert first == second


@pytest.mark.parametrize(
    "name", ["s.xlsx", "s.xls", "s.ods", "s.feather", "s.csv.bz2", "s.csv.zip", "s.parquet.gz", "s.x"]
)
def test_other_formats_are_refused_before_the_work(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with (
        pytest.raises(ValueError, match=r"a table must be \.csv.*got .*Pass for example scores\.csv"),
        open_table(path),
    ):
        pass
    with pytest.raises(ValueError, match=r"a table must be \.csv"):
        write_table(path, ROWS, columns=COLUMNS)
    result = run(app, ["score", str(tmp_path / "no masks"), "--out", str(path)])
    assert result.exit_code == 2
    assert "a table must be .csv, .tsv or .jsonl" in " ".join(result.stderr.replace("│", " ").split())
    assert os.listdir(tmp_path) == []


TOUCHES = {
    "to_csv": lambda table: table.to_csv(index=False).encode(),
    "to_csv with its index": lambda table: table.to_csv().encode(),
    "to_csv twice": lambda table: pd.read_csv(io.StringIO(table.to_csv())).to_csv().encode(),
    "path as the index": lambda table: table.set_index("path").to_csv().encode(),
    "a named index": lambda table: table.rename_axis("row").to_csv().encode(),
    "NaN in words": lambda table: table.to_csv(index=False, na_rep="NaN").encode(),
    "everything quoted": lambda table: table.to_csv(index=False, quoting=csv.QUOTE_ALL).encode(),
    "semicolons": lambda table: table.to_csv(index=False, sep=";").encode(),
    "tabs": lambda table: table.to_csv(index=False, sep="\t").encode(),
    "a byte order mark": lambda table: table.to_csv(index=False, encoding="utf-8-sig").encode("utf-8-sig"),
    "CRLF": lambda table: table.to_csv(index=False, lineterminator="\r\n").encode(),
    "Excel's Unicode text": lambda table: table.to_csv(index=False, sep="\t", lineterminator="\r\n").encode("utf-16"),
    "empty lines at the end": lambda table: table.to_csv(index=False).encode() + b"," * 21 + b"\r\n\r\n",
    "columns of others": lambda table: table.assign(note="mine, =x", fold=3).to_csv(index=False).encode(),
    "a column in the middle": lambda table: _inserted(table).to_csv(index=False).encode(),
    "another order": lambda table: table[list(table.columns)[::-1]].to_csv(index=False).encode(),
    "gzip": lambda table: gzip.compress(table.to_csv().encode()),
    "to_json of lines": lambda table: table.to_json(orient="records", lines=True, double_precision=15).encode(),
    "to_json of records": lambda table: table.to_json(orient="records", double_precision=15).encode(),
}


def _inserted(table: pd.DataFrame) -> pd.DataFrame:
    table = table.copy()
    table.insert(7, "note", "mine")
    return table


@pytest.mark.parametrize("touch", TOUCHES)
def test_tables_of_other_programs_hold_the_same_rows(touch: str, tmp_path: Path) -> None:
    path = tmp_path / ("scores.json" if "json" in touch else "scores.csv")
    path.write_bytes(TOUCHES[touch](frame()))
    read = list(read_table(path))
    assert len(read) == len(PLAIN)
    for found, expected in zip(read, PLAIN, strict=True):
        for name, value in expected.cells().items():
            if isinstance(value, float):
                assert found[name] == pytest.approx(value, rel=1e-14, abs=1e-14), name
            elif touch == "NaN in words" and value is None and name in ("inside", "category", "image"):
                assert found[name] == "NaN"  # words of the user, who may have such a class
            elif not (touch == "to_csv twice" and name == "category"):
                assert (found[name], type(found[name])) == (value, type(value)), name


@pytest.mark.parametrize("index", [False, True])
def test_parquet_of_pandas(index: bool, tmp_path: Path) -> None:
    table = frame().assign(note=[["a", "list"]] * len(PLAIN))
    table.index = [f"row {i}" for i in range(len(table))]
    table.to_parquet(tmp_path / "scores.parquet", index=index)
    assert pyarrow.parquet.read_schema(tmp_path / "scores.parquet").field("height").type == "double"
    assert list(read_table(tmp_path / "scores.parquet")) == PLAIN


def test_a_part_of_the_columns_can_be_compared(tmp_path: Path) -> None:
    table = frame(PLAIN[:2])
    table[["complexity", "path"]].to_csv(tmp_path / "old.csv")
    table.assign(complexity=table["complexity"] + [0.5, 0.0])[
        ["path", "note", "complexity"] if 0 else ["path", "complexity"]
    ].to_csv(tmp_path / "new.csv", sep=";", index=False)
    result = run(app, ["compare", str(tmp_path / "old.csv"), str(tmp_path / "new.csv"), "--out", "-"])
    assert result.exit_code == 0
    assert list(csv.reader(io.StringIO(result.stdout)))[1] == ["a, b.png", "compared", "2.5", "3.0", "0.5"]
    assert "2 compared" in result.stderr
    assert "largest changes" in result.stderr


def test_windows_of_the_measure_are_found_among_other_columns(tmp_path: Path) -> None:
    windows = {"fine": (0.0, 0.25), "gross": (0.25, 1.0)}
    one = Score("a.png", values={"fine": 0.5, "gross": 0.25}, measure=Measure(windows=windows).settings())
    with open_table(tmp_path / "scores.csv", windows=windows) as put:
        put(one)
    table = pd.read_csv(tmp_path / "scores.csv").assign(difference=0.25)
    table[["note", *table.columns] if "note" in table else ["difference", *table.columns[:-1]]].to_csv(
        tmp_path / "x.csv"
    )
    (read,) = read_table(tmp_path / "x.csv")
    assert read == one


REFUSED = {
    "decimal commas": (lambda table: csv_of(table, sep=";", decimal=","), "line 2.*decimal comma"),
    "Latin-1": (
        lambda table: csv_of(table).decode().encode("latin-1", "replace"),
        "not text in UTF-8.*save it as CSV UTF-8",
    ),
    "a workbook": (lambda table: b"PK\x03\x04" + bytes(40), "workbook.*save it as CSV UTF-8"),
    "an old workbook": (lambda table: b"\xd0\xcf\x11\xe0" + bytes(40), "workbook"),
    "a cut .gz": (lambda table: gzip.compress(csv_of(table))[:-20], "damaged .gz"),
    "no paths": (lambda table: csv_of(table.drop(columns="path")), "no path"),
    "no complexity": (lambda table: csv_of(table[["path", "pixels"]]), "none of them is a complexity"),
    "a column twice": (lambda table: csv_of(table).replace(b"radius", b"pixels", 1), "'pixels' is there twice"),
    "a word": (lambda table: csv_of(table.assign(peak="high")), "line 2: column peak: 'high'"),
    "half a pixel": (lambda table: csv_of(table.assign(pixels=0.5)), "column pixels: 0.5 is not a whole"),
    "a truth": (lambda table: b'{"path": "a", "complexity": true}', "True is not a number"),
    "a list": (lambda table: b'[["path", "a"]]', "not an object"),
}


def csv_of(table: pd.DataFrame, **options: str) -> bytes:
    return table.to_csv(index=False, **options).encode()


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_read_says_what_to_do(what: str, tmp_path: Path) -> None:
    make, words = REFUSED[what]
    path = tmp_path / "scores.csv"
    path.write_bytes(make(frame()))
    with pytest.raises(NoTableError, match=words):
        list(read_table(path))
    for command in (["compare", str(path), str(path)], ["report", str(path), "--out", str(tmp_path / "r.html")]):
        result = run(app, command)
        assert result.exit_code == 2
        assert result.stderr.startswith(f"{path} is not a table of `torchlinf score`: it"), result.stderr
        assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("touch", ["to_csv", "to_csv with its index", "a byte order mark", "CRLF", "another order"])
def test_a_touched_table_is_continued(touch: str, tmp_path: Path) -> None:
    path = tmp_path / "scores.csv"
    path.write_bytes(TOUCHES[touch](frame(PLAIN[:2])))
    with open_table(path, resume=True) as put:
        assert list(put.done) == [one.path for one in PLAIN[:2]]
        put(ROWS[3])
    assert list(read_table(path)) == [*PLAIN[:2], ROWS[3]]
    assert path.read_text().split("\n")[0] == ",".join(COLUMNS)


def test_columns_of_others_are_not_dropped_by_a_run_that_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "scores.csv"
    for table, words in (
        (frame().assign(note="mine"), "its columns note were added by others, and would be lost"),
        (frame().drop(columns=["seconds", "peak"]), "there is no peak, seconds"),
        (frame().drop(columns=["complexity_low"]), "there is no complexity_low"),
    ):
        table.to_csv(path, index=False)
        before = path.read_bytes()
        with pytest.raises(NoTableError, match=words), open_table(path, resume=True):
            pass
        assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["scores.csv"]


# Spreadsheets.


@pytest.mark.parametrize("suffix", ["csv", "tsv"])
def test_no_cell_is_a_formula(suffix: str, tmp_path: Path) -> None:
    rows = [*(row(name, -1.5, inside=name, category=name, image=name, error=name) for name in FORMULAS)]
    path = written(tmp_path / f"scores.{suffix}", rows)
    with path.open(newline="", encoding="utf-8") as file:
        cells = list(csv.reader(file, delimiter="\t" if suffix == "tsv" else ","))
    for line, name in zip(cells[1:], FORMULAS, strict=True):
        assert line[0] == (name if name == "'a'" else f"'{name}")
        assert line[COLUMNS.index("complexity")] == "-1.5"  # numbers stay numbers
        texts = [cell for cell, head in zip(line, COLUMNS, strict=True) if head not in WINDOWS]
        assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d")) for cell in texts)
    assert list(read_table(path)) == rows


TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1)


@pytest.mark.parametrize("suffix", ["csv", "tsv.gz", "jsonl"])
@given(paths=st.lists(TEXT | TEXT.map("'=".__add__), min_size=1, max_size=4), words=TEXT)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_text_comes_back(suffix: str, paths: list[str], words: str, tmp_path: Path) -> None:
    rows = [row(path, 0.5, inside=words, image=path, category=words[::-1]) for path in paths]
    write_table(tmp_path / f"scores.{suffix}", rows, columns=COLUMNS)
    assert list(read_table(tmp_path / f"scores.{suffix}")) == rows


def test_formulas_in_pairs_and_titles(tmp_path: Path) -> None:
    write_pairs(tmp_path / "changes.csv", [Pair("=a", "compared", -1.0, -3.5), Pair("b", "only in old", 1.0, None)])
    with (tmp_path / "changes.csv").open(newline="") as file:
        assert list(csv.reader(file))[1:] == [
            ["'=a", "compared", "-1.0", "-3.5", "-2.5"],
            ["b", "only in old", "1.0", "", ""],
        ]
    windows = {"=x": (0.0, 1.0)}
    one = Score("a.png", values={"=x": 0.5}, measure=Measure(windows=windows).settings())
    with open_table(tmp_path / "scores.csv", windows=windows) as put:
        put(one)
    assert ",'=x," in (tmp_path / "scores.csv").read_text().split("\n")[0]
    assert list(read_table(tmp_path / "scores.csv")) == [one]


@pytest.mark.parametrize("name", ["changes.tsv", "changes.csv.gz"])
def test_pairs_in_other_formats(name: str, tmp_path: Path) -> None:
    old = written(tmp_path / "old.csv", PLAIN[:2])
    result = run(app, ["compare", str(old), str(old), "--out", str(tmp_path / name)])
    assert result.exit_code == 0
    read = pd.read_csv(tmp_path / name, sep="\t" if "tsv" in name else ",")
    assert read["mask"].tolist() == [one.path for one in PLAIN[:2]]
    assert read["change"].tolist() == [0.0, 0.0]


def test_a_journal_line_holds_all_rows_of_a_source(tmp_path: Path) -> None:
    path = tmp_path / "scores.csv"
    with open_table(path) as put:
        put(ROWS[0])
        put(*ROWS[1:4])
        lines = (tmp_path / f"scores.csv{JOURNAL}").read_text().splitlines()
        assert [len(json.loads(line).get("rows", [0])) for line in lines] == [1, 3]
        assert list(read_table(tmp_path / f"scores.csv{JOURNAL}")) == ROWS[:4]
    assert list(read_table(path)) == ROWS[:4]


def test_a_dash_is_standard_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", np.tri(9, 13))

    def numbers(*options: str) -> list[list[str]]:
        result = run(app, ["score", "a.npy", *options])
        assert (result.exit_code, result.stderr) == (0, "")
        rows = list(csv.reader(io.StringIO(result.stdout)))
        return [[cell for cell, name in zip(cells, COLUMNS, strict=True) if name != "seconds"] for cells in rows]

    assert numbers("--out", "-") == numbers()
    result = run(app, ["score", "a.npy", "gone.npy", "--out", "-", "--json"])
    assert [json.loads(line)["path"] for line in result.stdout.splitlines()] == ["a.npy", "gone.npy"]
    assert result.stderr == "1 of 2 masks failed; the column 'error' says why.\n"
    for options in (["--out", "-", "--overwrite"], ["--out", "-", "--retry"], ["--out", "-", "--ray", "local"]):
        assert run(app, ["score", "a.npy", *options]).exit_code == 2
    assert os.listdir(tmp_path) == ["a.npy"]


@pytest.mark.parametrize("name", ["scores.tsv", "scores.csv.gz", "scores.parquet", "scores.txt"])
def test_json_lines_are_not_written_under_another_name(name: str, tmp_path: Path) -> None:
    result = run(app, ["score", "a.npy", "--json", "--out", str(tmp_path / name)])
    assert result.exit_code == 2
    assert "leave --json out" in " ".join(result.stderr.replace("│", " ").split())
