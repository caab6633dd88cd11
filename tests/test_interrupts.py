"""Ctrl-C at any moment: no traceback, no abort, nothing of other libraries; what is scored is kept."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import torchlinf
from torchlinf.cli import app
from torchlinf.scoring import JOURNAL

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke


@pytest.fixture
def mask(tmp_path: Path) -> Path:
    Image.fromarray(np.pad(np.full((7, 12), 255, dtype=np.uint8), 3)).save(tmp_path / "a.png")
    return tmp_path / "a.png"


def raised_in_compiled_code() -> Iterator[None]:
    """What CPython makes of Ctrl-C in compiled code that goes on with an exception set."""
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise SystemError("<function f> returned a result with an exception set") from error
    yield


@pytest.mark.parametrize("out", [None, "scores.csv"])
def test_an_interrupt_that_became_another_exception(
    out: str | None, mask: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torchlinf.scoring.score_groups", lambda *_, **__: raised_in_compiled_code())
    result = run(app, ["score", str(mask), *(["--out", str(tmp_path / out)] if out else [])])
    assert result.exit_code == 130
    assert result.stderr == ("Stopped; the same command goes on where this one was.\n" if out else "")


def test_another_system_error_is_not_hidden(mask: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise SystemError("a fault of the program")

    monkeypatch.setattr("torchlinf.scoring.score_groups", fail)
    assert isinstance(run(app, ["score", str(mask)]).exception, SystemError)


@pytest.mark.skipif(os.name != "posix", reason="signals are sent as POSIX has them")
@pytest.mark.slow
def test_interrupts_at_many_moments(mask: Path, tmp_path: Path) -> None:
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        pytest.skip("the tests run in the background, where shells switch Ctrl-C off")
    for i in range(400):
        (tmp_path / f"{i}.png").symlink_to(mask)
    command = [sys.executable, "-m", "torchlinf", "score", str(tmp_path), "--workers", "1", "--out"]
    environment = {**os.environ, "PYTHONPATH": str(Path(torchlinf.__file__).parents[1])}
    begun = time.monotonic()
    subprocess.run([*command, str(tmp_path / "whole.csv")], check=True, env=environment)
    whole = time.monotonic() - begun
    assert not (tmp_path / f"whole.csv{JOURNAL}").exists()
    for share in np.linspace(0.05, 0.95, 12):
        with subprocess.Popen(
            [*command, str(tmp_path / "scores.csv")], env=environment, stderr=subprocess.PIPE, text=True
        ) as process:
            time.sleep(share * whole)
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=60)
        lines = [line for line in told.splitlines() if "are in" not in line and not line.startswith("Passed over")]
        assert process.returncode in (0, 130, -signal.SIGINT), told
        # Python itself starts, and imports, before the command can take care of anything.
        starting = share < 0.2 or "<frozen importlib" in told
        assert lines in ([], ["Stopped; the same command goes on where this one was."]) or starting, told
    assert run(app, ["score", str(tmp_path), "--out", str(tmp_path / "scores.csv")]).exit_code == 0
    rows = [sorted((tmp_path / name).read_text().splitlines()) for name in ("whole.csv", "scores.csv")]
    assert [len(one) for one in rows] == [402, 402]


@pytest.mark.skipif(os.name != "posix", reason="sends a signal as POSIX does")
@pytest.mark.slow
def test_an_interrupt_ends_the_solve_of_a_large_mask_within_a_second() -> None:
    """At three moments of a solve of 4096 x 4000 pixels; in processor time, whatever else the machine does."""
    script = """
import os, signal, threading, time
import numpy as np, torch, torchlinf
signal.signal(signal.SIGINT, signal.default_int_handler)
torch.set_num_threads(1)
y, x = np.ogrid[:4096, :4000]
mask = torch.from_numpy(np.sin(x / 97) + np.sin(y / 61) + np.sin((x + 2 * y) / 130) > 0.2)
torchlinf.complexity(mask[:1000, :900], spatial_ndim=2)
for moment in (0.2, 1.0, 2.0):
    sent = []
    def send():
        until = time.process_time() + moment
        while time.process_time() < until:
            time.sleep(0.01)
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)
    thread = threading.Thread(target=send)
    try:
        thread.start()
        torchlinf.complexity(mask, spatial_ndim=2)
        thread.join()
    except KeyboardInterrupt:
        print(time.process_time() - sent[0])
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(torchlinf.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    late = [float(line) for line in done.stdout.split()]
    assert len(late) == 3, done.stdout
    assert max(late) < 1.0
