"""`python -m torchlinf` is the command `torchlinf`."""

from torchlinf.cli import main

if __name__ == "__main__":
    main()
