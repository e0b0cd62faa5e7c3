"""Imports go down only, and cheap things stay cheap to import."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "navstack"
KERNEL_EXCEPTIONS: set[str] = set()
"""Kernels with more than 12 arguments, as `file:function`. At most three, each with the measured loss as a comment."""
TOP_LEVEL = {"pyproject.toml", "README.md", "navstack", "params", "maps", "tests", "tools", "docs", "examples"}

# Imports go down only: a package may import packages of a lower level. Names of the packages, levels from the bottom up.
LEVELS: tuple[tuple[str, ...], ...] = (
    ("core",),
    ("interfaces", "kinematics", "curves", "lattice", "logs"),
    ("plugins",),
    ("parameters",),
    (
        "plugin",
        "map_io",
        "costmap",
        "global_planner",
        "smoother",
        "local_planner",
        "recovery",
        "motion",
        "safety",
        "sim",
    ),
    ("localization",),
    ("testing",),
    ("move_base",),
    ("bringup",),
    ("plan_once",),
    ("places", "basic_navigator"),
    ("record", "jobs", "statistics"),
    ("scenario",),
    ("replay", "drives"),
    ("plot", "explain", "bench"),
    ("tune", "live"),
    ("ros1",),
    ("cli",),
)
LEVEL_OF = {name: level for level, names in enumerate(LEVELS) for name in names}
SAME_LEVEL: set[tuple[str, str]] = set()
"""Exceptions: (importing package, imported package). At most three."""


def package_of(file: Path) -> str:
    relative = file.relative_to(PACKAGE)
    return relative.parts[0].removesuffix(".py")


@cache
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
    package = package_of(file)
    assert package in LEVEL_OF, f"{package} has no level: give it one here and in CONTRIBUTING.md"
    for module, line in imports_of(file):
        parts = module.split(".")
        if parts[0] != "navstack" or len(parts) < 2 or parts[1].startswith("_"):
            continue
        other = parts[1]
        if other == package:
            continue
        assert other in LEVEL_OF, f"{file}:{line}: {module}"
        allowed = LEVEL_OF[other] < LEVEL_OF[package] or (package, other) in SAME_LEVEL
        assert allowed, (
            f"{file}:{line}: {package} (level {LEVEL_OF[package]}) imports {module} (level {LEVEL_OF[other]})"
        )


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


# --- sizes ------------------------------------------------------------------------------------------------------------


@cache
def metrics() -> ModuleType:
    """`tools/code_metrics.py`, which prints the same figures by package."""
    spec = importlib.util.spec_from_file_location("code_metrics", ROOT / "tools" / "code_metrics.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@cache
def functions_of(file: Path) -> list[Any]:
    """The functions of a file (`code_metrics.Function`)."""
    return list(metrics().functions_of(file))


ALL_FILES = sorted(PACKAGE.rglob("*.py"))
each_file = pytest.mark.parametrize("file", ALL_FILES, ids=lambda f: str(f.relative_to(PACKAGE)))


@each_file
def test_files_functions_and_argument_lists_are_short(file: Path) -> None:
    limits = metrics()
    assert len(file.read_text(encoding="utf-8").splitlines()) <= limits.MAX_FILE_LINES
    for function in functions_of(file):
        limit = limits.MAX_KERNEL_LINES if function.is_kernel else limits.MAX_FUNCTION_LINES
        assert function.lines <= limit, f"{file}:{function.line} {function.name}"
        name = f"{file.relative_to(PACKAGE)}:{function.name}"
        if function.is_kernel and name not in KERNEL_EXCEPTIONS:
            assert function.arguments <= limits.MAX_KERNEL_ARGUMENTS, name


def test_at_most_three_kernels_are_exceptions() -> None:
    assert len(KERNEL_EXCEPTIONS) <= 3
    there = {f"{f.file.relative_to(PACKAGE)}:{f.name}" for file in ALL_FILES for f in functions_of(file)}
    assert there >= KERNEL_EXCEPTIONS


def test_no_record_type_begins_as_another_and_error_codes_are_unique() -> None:
    """numba would call a kernel compiled for the shorter record with the longer one, with a warning."""
    code = """
import importlib, pkgutil, numpy, navstack
records, errors = {}, {}
for module in pkgutil.walk_packages(navstack.__path__, "navstack."):
    if not module.name.endswith("__main__"):
        for name, value in vars(importlib.import_module(module.name)).items():
            if isinstance(value, numpy.dtype) and value.names:
                records[id(value)] = name, [(n, *value.fields[n][:2]) for n in value.names]
records, classes = list(records.values()), [navstack.NavError]
for error in classes:
    classes += error.__subclasses__()
    errors.setdefault(vars(error).get("code"), set()).add(error.__qualname__)
errors.pop(None, None)
print([(code, names) for code, names in errors.items() if len(names) > 1], end=" ")
print([(a, b) for a, x in records for b, y in records if x is not y and y[:len(x)] == x], len(records))
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found, count = out.stdout.rsplit(maxsplit=1)
    assert found == "[] []"
    assert int(count) > 5


# --- modules ----------------------------------------------------------------------------------------------------------


def module_of(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def runtime_imports(file: Path, modules: set[str]) -> set[str]:
    """Those of `modules` that are imported when this one is: not those below TYPE_CHECKING or inside functions."""
    found: set[str] = set()
    body = list(ast.parse(file.read_text(encoding="utf-8")).body)
    while body:
        node = body.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            body += node.orelse
        elif isinstance(node, ast.If | ast.Try):
            body += [*node.body, *node.orelse]
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in modules else node.module)
    return found & modules


def test_no_import_circles() -> None:
    modules = {module_of(file) for file in ALL_FILES}
    graph = {module_of(file): runtime_imports(file, modules) for file in ALL_FILES}
    done: set[str] = set()
    path: list[str] = []

    def visit(module: str) -> None:
        assert module not in path, " -> ".join([*path[path.index(module) :], module])
        if module in done:
            return
        path.append(module)
        for other in sorted(graph[module]):
            visit(other)
        path.pop()
        done.add(module)

    for module in graph:
        visit(module)


@each_file
def test_nothing_private_is_imported_from_another_package(file: Path) -> None:
    here = package_of(file)
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not (isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("navstack.")):
            continue
        parts = node.module.split(".")
        if parts[1] == here:
            continue
        names = [*parts[1:], *(alias.name for alias in node.names)]
        private = [name for name in names if name.startswith("_") and not name.startswith("__")]
        assert not private, f"{file}:{node.lineno}: {private}"


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("__init__.py")), ids=module_of)
def test_init_files_hold_public_names_only(file: Path) -> None:
    if file.parent == PACKAGE:
        return  # imports its names at first use
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        is_all = isinstance(target, ast.Name) and target.id == "__all__"
        assert isinstance(node, ast.Import | ast.ImportFrom) or is_docstring or is_all, f"{file}:{node.lineno}"


def test_layout_of_the_repository() -> None:
    assert {path.name for path in ROOT.iterdir()} >= TOP_LEVEL
    assert not list((ROOT / "params").rglob("*.py"))
    assert not list((ROOT / "maps").rglob("*.py"))
