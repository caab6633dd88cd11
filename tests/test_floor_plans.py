import pytest
import torch

from torchlinf import complexity_profile
from torchlinf.shapes import floor_plan, rooms


def picture(rows: int, columns: int, side: int, wall: int, aperture: int, obstacle: tuple[int, int]) -> torch.Tensor:
    """Room by room and aperture by aperture, as slices."""
    pitch = side + wall
    plan = torch.zeros(rows * pitch - wall, columns * pitch - wall, dtype=torch.bool)
    start = (side - aperture) // 2
    for i in range(rows):
        for j in range(columns):
            top, left = i * pitch, j * pitch
            plan[top : top + side, left : left + side] = True
            if j + 1 < columns:
                plan[top + start : top + start + aperture, left + side : left + pitch] = True
            if i + 1 < rows:
                plan[top + side : top + pitch, left + start : left + start + aperture] = True
    top, left = ((side - length) // 2 for length in obstacle)
    left += (columns - 1) * pitch
    plan[top : top + obstacle[0], left : left + obstacle[1]] = False
    return plan


@pytest.mark.parametrize(
    ("rows", "columns", "side", "wall", "aperture", "obstacle"),
    [(1, 1, 5, 1, 0, (0, 0)), (2, 3, 8, 2, 3, (0, 0)), (3, 2, 9, 1, 9, (4, 2)), (1, 4, 7, 3, 2, (7, 1))],
)
def test_rooms_against_a_drawing_in_slices(
    rows: int, columns: int, side: int, wall: int, aperture: int, obstacle: tuple[int, int]
) -> None:
    found = _rooms(rows, columns, side, wall, aperture, obstacle)
    assert found.dtype == torch.bool
    assert torch.equal(found, picture(rows, columns, side, wall, aperture, obstacle))


def _rooms(rows: int, columns: int, side: int, wall: int, aperture: int, obstacle: tuple[int, int]) -> torch.Tensor:
    return rooms(rows, columns, side=side, wall=wall, aperture=aperture, obstacle=obstacle)


@pytest.mark.parametrize(
    ("number", "last"),
    # The last level that is not zero. Half of an aperture is the level at which a joint ends: 32 / 2 and 80 / 2. Beside
    # the obstacle, 4 wide in a room of 128, the deepest pixels have distance (128 - 4) / 4.
    [(0, 0), (1, 16), (2, 31), (3, 40)],
)
def test_the_scale_at_which_a_plan_becomes_simple(number: int, last: int) -> None:
    profile = complexity_profile(floor_plan(number, margin=1), scales=[0.63], spatial_ndim=2)
    levels = profile.levels()
    assert int(profile.radius) == 64
    assert (levels[:last] > 0).all()
    assert (levels[last:] == 0).all()
    assert profile.values[0] == 0  # the paper's statement about plan 3: zero at scale 0.63


def test_messages() -> None:
    with pytest.raises(ValueError, match=r"number must be from 0 to 3; got 4. Pass 0"):
        floor_plan(4)
    with pytest.raises(ValueError, match=r"aperture must fit into a room of side 8; got 9. Pass 8 or less."):
        rooms(1, 2, side=8, aperture=9)
    with pytest.raises(TypeError, match=r"obstacle must be an integer of 0 or more; got 1.5"):
        rooms(1, 2, side=8, obstacle=(1.5, 1))
    with pytest.raises(ValueError, match=r"columns must be an integer of 1 or more; got 0"):
        rooms(1, 0)
