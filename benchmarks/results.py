"""What a benchmark hands back, how it is stored as JSON, and how it reads as Markdown."""

import dataclasses
import json
import math
import os
import platform
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

Cell = str | int | float | None


@dataclass(frozen=True)
class Target:
    """One row of the table of targets.

    Attributes:
        what: the quantity, in words.
        relation: ">=" or "<=": on which side of the target a good number lies.
        target: the number to reach; None where there is only an aim.
        aim: the number hoped for beyond it, if any.
        reached: what was measured.
        unit: behind the numbers: "x", "s", "" ...
        note: what a reader must know about the number.
    """

    what: str
    relation: str
    target: float | None
    aim: float | None
    reached: float
    unit: str = ""
    note: str = ""

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.aim is not None and self._holds(self.aim):
            return "aim met"
        if self.target is None:
            return "aim missed"
        return "met" if self._holds(self.target) else "missed"

    def _holds(self, limit: float) -> bool:
        return self.reached >= limit if self.relation == ">=" else self.reached <= limit


@dataclass(frozen=True)
class Table:
    """Rows of numbers under column names, which carry the units."""

    title: str
    columns: list[str]
    rows: list[list[Cell]]
    note: str = ""


@dataclass(frozen=True)
class Result:
    """The answer to one question.

    Attributes:
        name: of the benchmark.
        title: the question.
        targets: what it says about the targets.
        tables: what was measured.
        series: named numbers that the plots need.
        raw: times in seconds of every round, for whoever wants to look again.
        environment: where and with what it was measured.
    """

    name: str
    title: str
    targets: list[Target]
    tables: list[Table]
    series: dict[str, Any] = field(default_factory=dict)
    raw: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, Any] = field(default_factory=dict)


def environment(size: str) -> dict[str, Any]:
    """Processor, versions, and how busy the machine was when it was asked."""
    names = ["torch", "numpy", "scipy", "numba", "opencv-python-headless", "kornia"]
    return {
        "size": size,
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in names},
    }


def save(result: Result, folder: Path) -> None:
    """Write `folder/NAME.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_plain(dataclasses.asdict(result)), indent=1)
    (folder / f"{result.name}.json").write_text(text + "\n", encoding="utf-8")


def load(path: Path) -> Result:
    """Read what `save` wrote."""
    data = json.loads(path.read_text(encoding="utf-8"))
    targets = [Target(**target) for target in data.pop("targets")]
    tables = [Table(**table) for table in data.pop("tables")]
    return Result(targets=targets, tables=tables, **data)


def markdown(table: Table) -> str:
    """A table with its title and note."""
    lines = [f"**{table.title}**", "", _row(table.columns), _row(["---"] * len(table.columns))]
    lines += [_row([show(cell) for cell in row]) for row in table.rows]
    return "\n".join([*lines, *(["", table.note] if table.note else [])]) + "\n"


def target_table(results: list[Result]) -> str:
    """All targets with what was reached."""
    lines = [_row(["what", "target", "aim beyond", "reached", ""]), _row(["---"] * 5)]
    for target in (target for result in results for target in result.targets):
        relation = {">=": "≥", "<=": "≤"}[target.relation]
        goal, aim = (
            "" if limit is None else f"{relation} {show(limit)}{target.unit}" for limit in (target.target, target.aim)
        )
        reached = f"{show(target.reached)}{target.unit}"
        note = f" ({target.note})" if target.note else ""
        lines.append(_row([f"{target.what}{note}", goal, aim, f"**{reached}**", target.verdict]))
    return "\n".join(lines) + "\n"


def show(cell: Cell) -> str:
    """A number to three digits, with thousands separated; text as it is."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int) or (abs(cell) >= 100 and math.isfinite(cell)):
        return f"{round(cell):,}" if isinstance(cell, int) else f"{_digits(cell):,.0f}"
    return f"{cell:.3g}" if math.isfinite(cell) else "-"


def _digits(value: float) -> float:
    """Three digits are what a timing is worth."""
    return float(f"{value:.3g}")


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _plain(value: Any) -> Any:
    """The same without NaN and infinities, which JSON has not, and with floats to six digits."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
