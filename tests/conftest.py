"""Settings that every test shares."""

import os
import uuid
from pathlib import Path

import pytest
from photographs import write_photographs

# Figures are drawn to memory or to files: no test may need a screen. Set before anything imports matplotlib.
os.environ.setdefault("MPLBACKEND", "Agg")

# Ray asks for a token and would keep one in the home folder. A process remembers the first that it saw, so that all of
# its clusters must have the same.
os.environ.setdefault("RAY_AUTH_TOKEN", uuid.uuid4().hex * 2)


@pytest.fixture
def facades(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of photographs, as the studies of real images find it."""
    write_photographs(tmp_path)
    monkeypatch.setenv("TORCHLINF_FACADES", str(tmp_path))
    return tmp_path
