"""Compiled CPU kernels: the only files that know numba.

Every kernel is single-threaded, releases the GIL and works on the flat view of one shape's cropped box, padded by
one ring of outside pixels, so that a neighbour is always `x + offset` and never needs a bounds check.
"""
