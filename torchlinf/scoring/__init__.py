"""Masks in files and archives in, one row of numbers a mask out. A bad mask gives a row with an error.

All names are imported at their first use, so that the help of the command needs no torch. The list of them, which type
checkers read, is `__init__.pyi`. `torchlinf.scoring.ray` does the same on many machines; it needs the extra `ray`, and
is imported by its own name.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
