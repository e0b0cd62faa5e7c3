"""Imports go down only, and cheap things stay cheap to import."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "navstack"

FLOORS = {
    "core": 0,
    "interfaces": 1,
    "plugins": 1,
    "params": 1,
    "map_io": 2,
    "costmap": 2,
    "global_planner": 2,
    "local_planner": 2,
    "recovery": 2,
    "sim": 2,
    "maps": 2,
    "move_base": 3,
    "configuration": 4,
    "navigator": 4,
    "itinerary": 4,
    "effective": 5,
    "record": 5,
    "scenario": 5,
    "scenario_file": 5,
    "success": 5,
    "suites": 5,
    "basic_navigator": 5,
    "tour": 5,
    "jobs": 5,
    "statistics": 5,
    "explain": 6,
    "plot": 6,
    "bench": 6,
    "tune": 6,
    "cli": 7,
}
# two files of one floor that are one thing in two parts: the classes and the list of them; parameters and their assembly;
# a scenario, its record and what counts as success; the file it is written in, and the suites made of them; a tour and the
# scenario it makes
SAME_FLOOR = {
    ("plugins", "interfaces"),
    ("navigator", "configuration"),
    ("scenario", "record"),
    ("scenario", "success"),
    ("success", "record"),
    ("scenario_file", "scenario"),
    ("scenario_file", "success"),
    ("suites", "scenario"),
    ("suites", "scenario_file"),
    ("suites", "success"),
    ("tour", "scenario"),
    ("tune", "plot"),  # its report shows runs
    ("tune", "bench"),  # it drives BARN's worlds by their rule
}


def room_of(file: Path) -> str:
    relative = file.relative_to(PACKAGE)
    return relative.parts[0].removesuffix(".py")


def imports_of(file: Path) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            base = node.module or ""
            if base == "navstack":
                found += [(f"navstack.{alias.name}", node.lineno) for alias in node.names]
            else:
                found.append((base, node.lineno))
    return found


FILES = [f for f in sorted(PACKAGE.rglob("*.py")) if f.parent != PACKAGE or f.stem in FLOORS]


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_imports_go_down_only(file: Path) -> None:
    room = room_of(file)
    assert room in FLOORS, f"{room} has no floor yet: give it one here and in the documentation"
    for module, line in imports_of(file):
        parts = module.split(".")
        if parts[0] != "navstack" or len(parts) < 2 or parts[1].startswith("_"):
            continue
        other = parts[1]
        if other == room:
            continue
        assert other in FLOORS, f"{file}:{line}: {module}"
        allowed = FLOORS[other] < FLOORS[room] or (room, other) in SAME_FLOOR
        assert allowed, f"{file}:{line}: {room} (floor {FLOORS[room]}) imports {module} (floor {FLOORS[other]})"


def imported_after(statement: str, *modules: str) -> list[str]:
    code = f"import sys\n{statement}\nprint([m for m in {modules!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return ast.literal_eval(out.stdout.strip().splitlines()[-1])


@pytest.mark.parametrize(
    ("statement", "banned"),
    [
        ("import navstack.params", ("numba", "matplotlib", "scipy")),
        ("import navstack.cli", ("numba", "matplotlib", "scipy", "numpy", "pydantic", "shapely")),
        ("import navstack.configuration as c; c.load_configuration(['turtlebot'])", ("numba", "matplotlib")),
    ],
)
def test_what_an_import_does_not_pull_in(statement: str, banned: tuple[str, ...]) -> None:
    assert imported_after(statement, *banned) == []


def test_numba_is_imported_by_the_kernel_wrapper_only() -> None:
    for file in PACKAGE.rglob("*.py"):
        if file.name == "jit.py":
            continue
        assert not [m for m, _ in imports_of(file) if m.split(".")[0] == "numba"], file


def test_no_module_hides_a_public_name() -> None:
    # importing navstack.x sets the attribute x of the package, whatever stood there
    import navstack

    modules = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert not modules & set(navstack.__all__)


def test_contributing_tells_the_floors() -> None:
    text = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    told = text[text.index("floors): ") :].split(".\n")[0].split(" < ")
    floors = [set(re.findall(r"`(\w+)`", floor)) for floor in told]
    assert floors == [{room for room, at in FLOORS.items() if at == floor} for floor in range(len(told))]
