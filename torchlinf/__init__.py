"""Multi-scale complexity of discrete shapes from the screened L-infinity field, on PyTorch tensors.

All names and modules are imported at their first use (SPEC 1), so that `import torchlinf` is light. The list of them,
which type checkers read, is `__init__.pyi`.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
