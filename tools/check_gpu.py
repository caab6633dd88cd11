"""All checks that need a GPU: the tests marked `gpu`, then the benchmark. Without a GPU it says so and is done."""

import subprocess
import sys
from pathlib import Path

import torch

ROOT = Path(__file__).parents[1]


def main() -> int:
    if not torch.cuda.is_available():
        print("Nothing was checked: torch finds no CUDA device here.")
        return 0
    for module in (["pytest", "-m", "gpu", "tests"], ["benchmarks.gpu"]):
        done = subprocess.run([sys.executable, "-m", *module], cwd=ROOT, check=False)
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
