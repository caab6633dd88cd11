"""Families of shapes that the paper compares, as mappings of names to shapes, in the paper's order."""

from collections.abc import Sequence

from torch import Tensor

from torchlinf._helpers.checks import count, integer
from torchlinf.shapes.appendages import Appendage, cube_with_appendages, with_appendages
from torchlinf.shapes.bands import band, diagonal_pair
from torchlinf.shapes.basic import rectangle, square

SIDES = ("right", "left", "top", "bottom")

# The faces of a cube that come first: in opposite pairs, or around a corner.
OPPOSITE = ("left", "right", "top", "bottom", "front", "back")
ADJACENT = ("left", "top", "front", "right", "bottom", "back")


def nested_appendages(side: int = 128, depth: int = 48, *, margin: int = 0) -> dict[str, Tensor]:
    """S0 to S3: a square with none to three appendages, each narrower than the one before.

    Their widths are 3/4 of the side on the right (S1), 1/2 on top (S2) and 1/4 on the left (S3). So S1, S2 and S3 are
    equal at scales above 1/2, S2 and S3 above 1/4, and all are zero above 3/4.

    Args:
        side: side of the square in pixels, a multiple of 4.
        depth: how far each appendage reaches out in pixels, 1 or more.
        margin: outside pixels around each shape, 0 or more.

    Returns:
        Four bool tensors, each of its own size.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small, or `side` is not a multiple of 4.

    Example:
        >>> {name: tuple(shape.shape) for name, shape in nested_appendages(16, 6).items()}
        {'S0': (16, 16), 'S1': (16, 22), 'S2': (22, 22), 'S3': (22, 28)}
    """
    _quarters(side)
    ladder = [Appendage(face, side * n // 4, depth) for face, n in (("right", 3), ("top", 2), ("left", 1))]
    return {f"S{n}": with_appendages((side, side), ladder[:n], margin=margin) for n in range(4)}


def appendage_places(side: int = 128, depth: int = 32, *, margin: int = 0) -> dict[str, Tensor]:
    """A square with four appendages of a quarter of its side, in five arrangements.

    Args:
        side: side of the square in pixels, a multiple of 4.
        depth: how far each appendage reaches out in pixels, 1 or more.
        margin: outside pixels around each shape, 0 or more.

    Returns:
        Five bool tensors, each of its own size. All are zero at scales above 1/4.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small, or `side` is not a multiple of 4.

    Example:
        >>> list(appendage_places(16, 4))
        ['centred', 'shifted', 'at the corners', 'two on two sides', 'three and one']
    """
    _quarters(side)
    width = side // 4
    high = side - width
    places: dict[str, list[tuple[str, int | None]]] = {
        "centred": [(face, None) for face in SIDES],
        "shifted": [(face, width // 2) for face in SIDES],
        "at the corners": [("right", 0), ("left", high), ("top", 0), ("bottom", high)],
        "two on two sides": [("right", 0), ("right", high), ("top", 0), ("top", high)],
        "three and one": [("right", 0), ("right", high // 2), ("right", high), ("left", None)],
    }
    return {
        name: with_appendages((side, side), [Appendage(face, width, depth, at) for face, at in there], margin=margin)
        for name, there in places.items()
    }


def appendage_dictionary(
    side: int = 128,
    depth: int = 32,
    *,
    numbers: Sequence[int] = (1, 2, 4),
    widths: Sequence[int] = (32, 80),
    margin: int = 0,
) -> dict[str, Tensor]:
    """Squares with appendages of every number, width and position: twelve shapes by default.

    By default the widths are 1/4 and 5/8 of the side.

    Args:
        side: side of the square in pixels, 1 or more.
        depth: how far each appendage reaches out in pixels, 1 or more.
        numbers: how many appendages, one on each side, from 0 to 4.
        widths: their contact widths in pixels, from 1 to `side`.
        margin: outside pixels around each shape, 0 or more.

    Returns:
        Bool tensors by names such as "4 x 80 flush": the number, the width, and whether the appendages are centred on
        their sides or flush with a corner. The widths vary slowest, then the numbers.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of range.

    Example:
        >>> list(appendage_dictionary(16, 4, numbers=(1, 4), widths=(4,)))
        ['1 x 4 centred', '1 x 4 flush', '4 x 4 centred', '4 x 4 flush']
    """
    for name, values in (("numbers", numbers), ("widths", widths)):
        if not isinstance(values, Sequence):
            raise TypeError(f"{name} must be a sequence of integers; got {values!r}. Pass for example ({values!r},).")
    if any(integer(number, "numbers", 0) > len(SIDES) for number in numbers):
        raise ValueError(f"numbers must be integers from 0 to 4; got {list(numbers)}. Pass at most one for each side.")
    return {
        f"{number} x {width} {position}": with_appendages(
            (side, side), [Appendage(face, width, depth, offset) for face in SIDES[:number]], margin=margin
        )
        for width in widths
        for number in numbers
        for position, offset in (("centred", None), ("flush", 0))
    }


def cube_family(side: int = 64, appendage_side: int = 16, *, margin: int = 0) -> dict[str, Tensor]:
    """A cube without and with smaller cubes on one to six of its faces: ten choices of faces, no two equal by rotation.

    Two, three and four faces can be chosen in two ways: opposite ones preferred, or adjacent ones.

    Args:
        side: side of the body in voxels, 1 or more.
        appendage_side: side of every appended cube in voxels, from 1 to `side`.
        margin: outside voxels around each shape, 0 or more.

    Returns:
        Ten bool tensors (depth, height, width), each of its own size.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is out of range.

    Example:
        >>> list(cube_family(8, 2))
        ['0', '1', '2 opposite', '2 adjacent', '3 opposite', '3 adjacent', '4 opposite', '4 adjacent', '5', '6']
    """
    ways = {"opposite": OPPOSITE, "adjacent": ADJACENT}
    chosen = {"0": OPPOSITE[:0], "1": OPPOSITE[:1]}
    chosen |= {f"{number} {way}": faces[:number] for number in (2, 3, 4) for way, faces in ways.items()}
    chosen |= {"5": OPPOSITE[:5], "6": OPPOSITE}
    return {name: cube_with_appendages(side, appendage_side, faces, margin=margin) for name, faces in chosen.items()}


def zero_complexity(side: int = 32, *, margin: int = 0) -> dict[str, Tensor]:
    """Shapes whose complexity is exactly 0 at every scale: a square, and seven others.

    Args:
        side: side of the square, and width of the bands, in pixels, 1 or more.
        margin: outside pixels around each shape, 0 or more.

    Returns:
        Eight bool tensors, each of its own size.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small.

    Example:
        >>> list(zero_complexity(4))
        ['square', 'rectangle', 'overlap', 'touch', 'corner', 'frame', 'meander', 'diagonal']
    """
    w = count(side, "side")
    lines = {
        "corner": [(0, 0), (2 * w, 0), (2 * w, 2 * w)],
        "frame": [(0, 0), (2 * w, 0), (2 * w, 3 * w), (0, 3 * w), (0, 0)],
        "meander": [(0, 2 * w), (0, 0), (2 * w, 0), (2 * w, 2 * w), (4 * w, 2 * w), (4 * w, 0)],
        "diagonal": [(0, 0), (0, w), (2 * w, 3 * w)],
    }
    return {
        "square": square(w, margin=margin),
        "rectangle": rectangle(w, 3 * w, margin=margin),
        "overlap": diagonal_pair(w, w // 2, margin=margin),
        "touch": diagonal_pair(w, w, margin=margin),
        **{name: band(line, w, margin=margin) for name, line in lines.items()},
    }


def _quarters(side: int) -> None:
    if count(side, "side") % 4:
        raise ValueError(f"side must be a multiple of 4; got {side}. Pass for example 128.")
