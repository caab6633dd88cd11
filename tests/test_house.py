"""The house rules of the package: imports go downward, rooms keep their private files, the import stays light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import networkx as nx

import torchlinf

PACKAGE = Path(torchlinf.__file__).parent

# From the top down. A room may import from rooms on lower lines only.
FLOORS = (
    {"__main__"},
    {"cli"},
    {"plot", "report", "warming"},
    {"regions", "scoring"},
    {"polygons"},
    {"decompose", "labels", "losses", "metrics", "order", "transforms"},
    {"samplers", "shapes"},
    {"measure"},
    {"field"},
    {"kernels"},
    {"_helpers"},
)


def imports(file: Path) -> Iterator[tuple[str, str]]:
    """Modules of torchlinf that a file names in its imports, with the name taken from each ("" for all)."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.startswith("torchlinf."))
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "torchlinf":
            yield from ((node.module, alias.name) for alias in node.names)


def room_of(file: Path) -> str:
    """The room at the top of the package that a file stands in."""
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def arrows() -> Iterator[tuple[Path, str, str, str]]:
    """(file, room it imports from, module, name) for every import from another room."""
    for file in sorted(PACKAGE.rglob("*.py")):
        for module, name in imports(file):
            parts = module.split(".")[1:] or [name]  # "from torchlinf import shapes" names a room
            if parts[0] != room_of(file) and not parts[0].startswith("__"):
                yield file, parts[0], module, name


def test_every_room_is_on_a_floor() -> None:
    rooms = {room_of(file) for file in PACKAGE.rglob("*.py")} - {"__init__"}
    assert rooms == set().union(*FLOORS)
    assert len(rooms) <= 20


def test_imports_go_downward() -> None:
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    upward = [(file.name, room) for file, room, *_ in arrows() if floor[room] <= floor[room_of(file)]]
    assert not upward


def test_no_room_reaches_into_the_files_of_another() -> None:
    """A package's files are private to it; the kernels are the exception, their files are what they offer."""
    reached = [
        (str(file.relative_to(PACKAGE)), module)
        for file, room, module, _ in arrows()
        if len(module.split(".")) > 2 and room not in {"kernels", "_helpers"} and module != "torchlinf.scoring.ray"
    ]
    assert not reached


def test_what_a_package_offers_is_in_its_list_of_names() -> None:
    for file, room, module, name in arrows():
        offered = getattr(__import__(module, fromlist=["__all__"]), "__all__", None)
        if offered is not None and module == f"torchlinf.{room}" and room != "kernels":
            assert name in offered, f"{file.name} takes {name} from {module}"


def test_files_import_each_other_without_a_circle() -> None:
    graph = nx.DiGraph()
    for file in PACKAGE.rglob("*.py"):
        own = ".".join(("torchlinf", *file.relative_to(PACKAGE).with_suffix("").parts))
        # An __init__ collects what its files offer; these import each other directly.
        if file.name != "__init__.py":
            graph.add_edges_from((own, module) for module, _ in imports(file))
    assert nx.is_directed_acyclic_graph(graph), nx.find_cycle(graph)


def test_only_kernels_know_the_compiler() -> None:
    naming = {room_of(file) for file in PACKAGE.rglob("*.py") if "import numba" in file.read_text(encoding="utf-8")}
    assert naming == {"kernels"}


def test_kernels_know_neither_infinity_nor_nan() -> None:
    """They are compiled as if there were none, so that a comparison with one may have any result."""
    found = []
    for file in (PACKAGE / "kernels").glob("*.py"):
        for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef) and {"kernel", "inlined"} & {
                ast.unparse(decorator) for decorator in function.decorator_list
            }:
                names = {node.attr for node in ast.walk(function) if isinstance(node, ast.Attribute)}
                found += [f"{file.name}: {name}" for name in names & {"inf", "nan", "isnan", "isinf", "isfinite"}]
    assert not found


def loaded(code: str) -> set[str]:
    """Top-level packages in memory after some code has run in a process of its own."""
    code += "\nimport sys; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_import_loads_no_other_library_before_it_is_used() -> None:
    assert not loaded("import torchlinf") & {
        "torch",
        "numpy",
        "numba",
        "scipy",
        "skimage",
        "matplotlib",
        "typer",
        "PIL",
    }
    heavy = {"numba", "skimage", "matplotlib", "typer", "rich", "PIL", "torchmetrics", "networkx"}
    assert not loaded("import torchlinf; torchlinf.complexity, torchlinf.losses, torchlinf.shapes") & heavy
