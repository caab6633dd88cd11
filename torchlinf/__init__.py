"""Multi-scale complexity of discrete shapes from the screened L-infinity field, on PyTorch tensors."""

__version__ = "0.1.0"
