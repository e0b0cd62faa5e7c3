"""Imports go down only, and cheap things stay cheap to import."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "navstack"

# Imports go down only: a package may import packages of a lower level. Names of the packages, levels from the bottom up.
LEVELS: tuple[tuple[str, ...], ...] = (
    ("core",),
    ("interfaces",),
    ("plugins",),
    ("parameters",),
    ("plugin", "map_io", "costmap", "global_planner", "local_planner", "recovery", "sim"),
    ("testing",),
    ("move_base",),
    ("bringup",),
    ("places", "basic_navigator"),
    ("record", "jobs", "statistics"),
    ("scenario",),
    ("plot", "explain", "bench"),
    ("tune",),
    ("cli",),
)
LEVEL_OF = {name: level for level, names in enumerate(LEVELS) for name in names}
SAME_LEVEL: set[tuple[str, str]] = set()
"""Exceptions: (importing package, imported package). At most three."""


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


FILES = [f for f in sorted(PACKAGE.rglob("*.py")) if f.parent != PACKAGE or f.stem in LEVEL_OF]


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_imports_go_down_only(file: Path) -> None:
    room = room_of(file)
    assert room in LEVEL_OF, f"{room} has no level: give it one here and in CONTRIBUTING.md"
    for module, line in imports_of(file):
        parts = module.split(".")
        if parts[0] != "navstack" or len(parts) < 2 or parts[1].startswith("_"):
            continue
        other = parts[1]
        if other == room:
            continue
        assert other in LEVEL_OF, f"{file}:{line}: {module}"
        allowed = LEVEL_OF[other] < LEVEL_OF[room] or (room, other) in SAME_LEVEL
        assert allowed, f"{file}:{line}: {room} (level {LEVEL_OF[room]}) imports {module} (level {LEVEL_OF[other]})"


def imported_after(statement: str, *modules: str) -> list[str]:
    code = f"import sys\n{statement}\nprint([m for m in {modules!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return ast.literal_eval(out.stdout.strip().splitlines()[-1])


@pytest.mark.parametrize(
    ("statement", "banned"),
    [
        ("import navstack.parameters", ("numba", "matplotlib", "scipy")),
        ("import navstack.cli", ("numba", "matplotlib", "scipy", "numpy", "pydantic", "shapely")),
        ("import navstack.parameters.configuration as c; c.load_configuration(['turtlebot'])", ("numba", "matplotlib")),
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


def test_at_most_three_exceptions() -> None:
    assert len(SAME_LEVEL) <= 3


def test_contributing_lists_the_levels() -> None:
    text = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = text[text.index("levels): ") :].split(".\n")[0].split(" < ")
    assert [tuple(re.findall(r"`(\w+)`", level)) for level in listed] == list(LEVELS)
