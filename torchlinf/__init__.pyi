from . import (
    decompose as decompose,
)
from . import (
    labels as labels,
)
from . import (
    losses as losses,
)
from . import (
    metrics as metrics,
)
from . import (
    order as order,
)
from . import (
    plot as plot,
)
from . import (
    polygons as polygons,
)
from . import (
    regions as regions,
)
from . import (
    samplers as samplers,
)
from . import (
    scoring as scoring,
)
from . import (
    shapes as shapes,
)
from . import (
    transforms as transforms,
)
from .field import (
    FieldSolution as FieldSolution,
)
from .field import (
    Status as Status,
)
from .field import (
    chessboard_distance as chessboard_distance,
)
from .field import (
    linf_field as linf_field,
)
from .field import (
    soft_chessboard_distance as soft_chessboard_distance,
)
from .field import (
    soft_linf_field as soft_linf_field,
)
from .field import (
    solve_field as solve_field,
)
from .losses import (
    Simplification as Simplification,
)
from .losses import (
    simplify as simplify,
)
from .measure import (
    ComplexityProfile as ComplexityProfile,
)
from .measure import (
    Measure as Measure,
)
from .measure import (
    complexity as complexity,
)
from .measure import (
    complexity_map as complexity_map,
)
from .measure import (
    complexity_profile as complexity_profile,
)
from .measure import (
    equal_spacing as equal_spacing,
)
from .measure import (
    soft_complexity as soft_complexity,
)
from .warming import warm_up as warm_up

__version__: str
