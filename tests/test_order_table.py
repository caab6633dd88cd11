"""A partial order as a table for people, in sentences, and as rows."""

import networkx as nx
import pytest

from torchlinf import complexity_profile, shapes
from torchlinf.cli.order_table import order_rows, print_order, summary
from torchlinf.order import dominance

MASKS = {
    "bow": shapes.superellipse(13, 0.6),
    "box": shapes.box(20, 50),
    "disc": shapes.disc(12),
    "square": shapes.square(32),
    "turned": shapes.disc(12).flip(0),
}


def test_on_a_terminal_people_read(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    profiles = {f"[{name}]": complexity_profile(mask, spatial_ndim=2) for name, mask in MASKS.items()}
    monkeypatch.setenv("COLUMNS", "120")
    print_order(dominance(profiles, windows=None, every_scale=True), profiles)
    out = capsys.readouterr().out
    assert "t in (0, 1]" in out
    assert all(f"[{name}]" in out for name in MASKS)  # brackets are no markup
    assert "Longest chain: [box] = [square] < " in out
    assert "Incomparable: 1 of 3 pairs: [bow] | [disc] = [turned]" in out


def test_chains_and_antichains_in_sentences() -> None:
    order = nx.transitive_closure(nx.DiGraph([(("a",), ("b", "c")), (("b", "c"), ("d",)), (("a",), ("e",))]))
    assert summary(order) == [
        "Longest chain: a < b = c < d",
        "Largest antichain: d, e; 2 chains hold all",
        "Incomparable: 2 of 6 pairs: b = c | e, d | e",
    ]
    assert summary(nx.DiGraph([(("a",), ("b",))])) == ["Longest chain: a < b"]


def test_rows_come_from_the_simplest_on_in_the_order_of_the_masks() -> None:
    order = nx.transitive_closure(nx.DiGraph([(("z",), ("y",)), (("z",), ("x",)), (("y",), ("w",))]))
    profiles = dict.fromkeys("wxyz", complexity_profile(MASKS["disc"], spatial_ndim=2))
    rows = list(order_rows(order, profiles))
    assert [(row["path"], row["rank"]) for row in rows] == [("z", 0), ("y", 1), ("x", 1), ("w", 2)]
    assert [row["incomparable"] for row in rows] == [[], ["x"], ["y", "w"], ["x"]]
    assert {row["complexity"] for row in rows} == {profiles["w"].mean().item()}
