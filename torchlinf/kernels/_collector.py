"""The garbage collector at rest while numba is loaded."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Collect no garbage meanwhile, then take what is new for old.

    To load numba makes hundreds of thousands of objects that stay, at which the collector would walk through them, and
    through all of torch's, time and again: a quarter of the first call. Objects that someone has frozen stay frozen.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() == 0:
            gc.freeze()
            gc.unfreeze()  # moves all objects to the oldest generation, without a look at them
        if enabled:
            gc.enable()
