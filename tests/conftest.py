"""Settings that every test shares."""

import os
import uuid

# Figures are drawn to memory or to files: no test may need a screen. Set before anything imports matplotlib.
os.environ.setdefault("MPLBACKEND", "Agg")

# Ray asks for a token and would keep one in the home folder. A process remembers the first that it saw, so that all of
# its clusters must have the same.
os.environ.setdefault("RAY_AUTH_TOKEN", uuid.uuid4().hex * 2)
