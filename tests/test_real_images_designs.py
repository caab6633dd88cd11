"""That the designs of a term in training do what they are called, on toy images and numbers known by hand."""

import json
import sys
from functools import partial
from itertools import combinations
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.nn import functional

import torchlinf

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

from benchmarks.regulariser.real_images import data, designs, pulls, training  # noqa: E402
from benchmarks.regulariser.real_images.carrying import mean_cosine, of_flips  # noqa: E402
from benchmarks.regulariser.real_images.network import UNet  # noqa: E402
from benchmarks.regulariser.real_images.pulls import Design, Step  # noqa: E402
from benchmarks.regulariser.real_images.training import State  # noqa: E402


def a_step(progress: float = 0.0) -> Step:
    """A block with a bump of which the prediction is not sure, and which the truth has; averaged, the bump is gone."""
    logits = torch.full((1, 1, 40, 50), -5.0)
    logits[..., 10:30, 10:35] = 5.0
    averaged = logits.clone()
    bump = torch.zeros_like(logits, dtype=torch.bool)
    bump[..., 18:21, 35:38] = True
    logits[bump] = 0.1
    averaged[bump] = -0.1
    first = logits > 1
    return Step(progress, logits, logits > 0, first, lambda: averaged)


def test_the_pull_is_the_gradient_of_a_cross_entropy() -> None:
    torch.manual_seed(0)
    logits = torch.randn(2, 1, 5, 7, requires_grad=True)
    target, counted = torch.rand(2, 1, 5, 7) < 0.5, torch.rand(2, 1, 5, 7) < 0.3
    each = functional.binary_cross_entropy_with_logits(logits, target.float(), reduction="none")
    each[counted].sum().div(70).backward()
    torch.testing.assert_close(pulls.towards(target, logits.detach(), counted), logits.grad)


def test_doubt_is_one_where_both_are_as_likely() -> None:
    odds = torch.tensor([0.0, float(torch.log(torch.tensor(3.0))), 40.0, -40.0])
    torch.testing.assert_close(pulls.doubt(odds), torch.tensor([1.0, 0.75, 0.0, 0.0]))


def test_in_place_of_the_truth_simplified_predictions_pull_on_all_pixels() -> None:
    step = a_step()
    assert torch.equal(pulls.instead(step) < 0, step.first)
    assert not torch.equal(step.first, step.truth)


def test_an_area_that_is_kept_takes_from_what_is_in_doubt_what_the_pull_gives() -> None:
    logits = torch.randn(2, 1, 6, 8, generator=torch.Generator().manual_seed(0))
    logits[..., :3] = 60.0  # certain
    pull = torch.zeros_like(logits)
    pull[0, 0, 2, 5], pull[1, 0, 4, 6] = 0.7, -0.2
    kept = pulls.balanced(pull, logits)
    torch.testing.assert_close(kept.sum((1, 2, 3)), torch.zeros(2))
    assert not kept[..., :3].any()
    assert (kept[0, 0, :2, 3:] < 0).all()
    assert (kept[1, 0, :2, 3:] > 0).all()
    torch.testing.assert_close(
        kept[0, 0, 0, 4] / kept[0, 0, 1, 7], pulls.doubt(logits)[0, 0, 0, 4] / pulls.doubt(logits)[0, 0, 1, 7]
    )


def test_targets_made_anew_are_of_the_network_or_of_the_averaged_one() -> None:
    step = a_step()
    assert torch.equal(pulls.anew(step) > 0, step.truth & ~step.first)  # the bump falls
    assert not pulls.anew(step, averaged=True).any()  # a block is as simple as can be


def test_a_falling_price_falls_from_the_first_to_the_usual_one(monkeypatch: pytest.MonkeyPatch) -> None:
    prices = []
    plain = torchlinf.simplify

    def noted(*args: Tensor, **options: float) -> torchlinf.Simplification:
        prices.append(options["weight"])
        return plain(*args, **options)

    monkeypatch.setattr(torchlinf, "simplify", noted)
    for progress in (0.0, 0.5, 1.0):
        pulls.anew(a_step(progress), falling=True)
    assert prices == pytest.approx([100.0, 1000.0**0.5, 10.0])


def test_the_pull_of_the_loss_is_the_gradient_of_the_loss() -> None:
    step = a_step()
    logits = step.logits.clone().requires_grad_()
    torchlinf.losses.ShapeComplexityLoss(activation="sigmoid", per="object")(logits).backward()
    torch.testing.assert_close(pulls.loss(step), logits.grad)
    torch.testing.assert_close(pulls.loss(step, by_doubt=True), logits.grad * pulls.doubt(step.logits))


class TestTraining:
    @pytest.fixture
    def images(self, facades: Path) -> data.Images:
        images = data.load("facades", "train")
        return data.Images(images.images, torch.cat([images.masks, images.masks], dim=1))

    @pytest.fixture
    def start(self) -> State:
        torch.manual_seed(0)
        return UNet("facades").state_dict()

    def test_no_term_is_the_second_run_of_the_study(
        self, images: data.Images, start: State, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(training, "MORE_STEPS", 2)
        alike = data.Images(images.images, images.masks[:, :1])
        expected = training.second_run("facades", alike, 3, start, None).state_dict()
        found = pulls.train("facades", images, 3, start, Design(), 2).state_dict()
        for name, values in expected.items():
            torch.testing.assert_close(found[name], values)

    @pytest.mark.parametrize("warm", [True, False])
    def test_a_warm_up_begins_without_the_pull(self, images: data.Images, start: State, warm: bool) -> None:
        def upwards(step: Step) -> Tensor:
            return -torch.ones_like(step.logits)

        plain = pulls.train("facades", images, 0, start, Design(), 1).state_dict()
        found = pulls.train("facades", images, 0, start, Design(upwards, 10.0, warm=warm), 1).state_dict()
        assert torch.equal(found["head.bias"], plain["head.bias"]) == warm

    def test_only_each_step_of_that_number_has_the_pull(self, images: data.Images, start: State) -> None:
        seen = []

        def noted(step: Step) -> Tensor:
            seen.append((step.progress, step.truth.shape, int((step.first != step.truth).sum())))
            return torch.zeros_like(step.logits)

        pulls.train("facades", images, 0, start, Design(noted, every=2), 3)
        assert [progress for progress, _, _ in seen] == pytest.approx([0.0, 2 / 3])
        assert all(shape == (3, 1, 160, 160) and not apart for _, shape, apart in seen)  # mirrored together

    @pytest.mark.parametrize("alone", [True, False])
    def test_a_pull_alone_has_no_data_term_beside_it(self, images: data.Images, start: State, alone: bool) -> None:
        nothing = Design(lambda step: torch.zeros_like(step.logits), alone=alone)
        found = pulls.train("facades", images, 0, start, nothing, 1).state_dict()["head.bias"]
        unmoved = torch.allclose(found, start["head.bias"], rtol=1e-5, atol=1e-7)  # by the decay of weights: 5e-6
        assert unmoved == alone


def test_a_pull_is_as_large_as_the_data_term() -> None:
    sizes = pulls._Sizes()
    data_gradient, pull = torch.full((3, 4), 2.0), torch.zeros(3, 4)
    pull[0, 0] = 5.0
    assert sizes.ratio(data_gradient, pull) * pull.norm() == pytest.approx(float(data_gradient.norm()))
    assert sizes.ratio(data_gradient, 2 * pull) == pytest.approx(48**0.5 / 5.5)  # running means: 0.9 of 5, 0.1 of 10
    assert pulls._Sizes().ratio(data_gradient, 0 * pull) == 0


def test_shares_of_flips_of_known_masks() -> None:
    logits = torch.tensor([[[[2.0, 2.0, 0.0, -1.0, -1.0]]]]) + 0.0
    logits[..., 2] = 1.0
    target = torch.tensor([[[[True, False, True, True, False]]]])
    truth = torch.tensor([[[[True, True, True, True, False]]]])
    found = of_flips(logits, target, truth)
    inside = torch.sigmoid(torch.tensor([2.0, -1.0]))
    expected = float((1 - inside[0]) + inside[1]) / 2
    assert found == pytest.approx({"of the objects": 2 / 3, "removed": 1 / 2, "right": 1 / 2, "expected": expected})


def test_the_mean_cosine_is_that_of_all_pairs() -> None:
    rows = torch.randn(5, 8, generator=torch.Generator().manual_seed(0))
    pairs = [float(a @ b / (a.norm() * b.norm())) for a, b in combinations(rows, 2)]
    assert mean_cosine(rows) == pytest.approx(sum(pairs) / len(pairs), abs=1e-6)


def test_the_comparison_runs_is_not_repeated_and_writes_its_tables(
    facades: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(training, "STEPS", {"facades": 30})
    monkeypatch.setattr(training, "MORE_STEPS", 2)
    monkeypatch.setattr(training, "CROPS", 2)
    few = {
        "no term": Design(),
        "instead": Design(pulls.instead, alone=True, times=2),
        "anew": Design(partial(pulls.anew, averaged=True)),
        "loss": Design(partial(pulls.loss, by_doubt=True), warm=True),
    }
    monkeypatch.setattr(designs, "DESIGNS", few)
    monkeypatch.setattr(designs, "FINAL", ("instead",))
    arguments = ["--seeds", "0", "1"]
    for option in ("states", "results", "out"):
        arguments += [f"--{option}", str(tmp_path / "study" / option)]
    designs.main(arguments)
    printed = capsys.readouterr().out
    assert [line for line in printed.splitlines() if line.startswith("facades")] == [
        *(f"facades 0 {what}" for what in ("truth", *few, designs.TARGETS, "carrying over")),
        *(f"facades 1 {what}" for what in ("truth", "no term", "instead")),
    ]
    choosing, held_out, flips, gradients = printed.split("**Facades: ")[1:]
    assert all(f"| {name} |" in choosing for name in few)
    assert "| instead |" in held_out
    assert "| anew |" not in held_out
    assert "| choose, 30 |" in flips
    assert "| data term | " in gradients
    assert (tmp_path / "study/out/regulariser_designs.inc").read_text(encoding="utf-8") in printed
    kept = json.loads((tmp_path / "study/results/facades_0.json").read_text(encoding="utf-8"))
    assert {part: len(values["IoU"]) for part, values in kept["instead"].items()} == {
        "seen": 2,
        "choose": 2,
        "held-out": 3,
        "held-out, simplified": 3,
    }
    designs.main(arguments)
    assert not [line for line in capsys.readouterr().out.splitlines() if line.startswith("facades")]
