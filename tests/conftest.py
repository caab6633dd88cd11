"""Settings that every test shares."""

import os

# Figures are drawn to memory or to files: no test may need a screen. Set before anything imports matplotlib.
os.environ.setdefault("MPLBACKEND", "Agg")
