"""The structure of the product: levels, faces, circles, kernels, data, and what an import costs.

Sizes are reported by `tools/code_metrics.py`; no test limits them.
"""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tools.docs.architecture_page import LEVELS, PAGE, page

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "navstack"
LEVEL_OF = {name: level for level, names in enumerate(LEVELS) for name in names}
WIDE_KERNELS = {
    "navstack.global_planner.theta_star:lazy_theta_star",
    "navstack.local_planner.critics.obstacle:obstacle_scores",
}
"""Kernels with more than 12 arguments, as `module:function`; at most three. The obstacle critic takes arrays of the cycle that
other critics share: a record of them would be filled in each cycle. Nav2's Theta* takes the scratch memory of a search."""


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_of(file): file for file in sorted(PACKAGE.rglob("*.py"))}
FACES = [f"navstack.{folder.name}" for folder in sorted(PACKAGE.iterdir()) if (folder / "__init__.py").exists()]


def package_of(module: str) -> str:
    """Return `costmap` for `navstack.costmap.voxel_layer`; an empty string for `navstack` itself."""
    return module.split(".")[1] if "." in module else ""


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text(encoding="utf-8"))


@cache
def imports_of(module: str) -> list[tuple[str, str, int]]:
    """Return all imports of navstack in a module, also those in functions and for types: (module, name, line)."""
    found: list[tuple[str, str, int]] = []
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            found += [(alias.name, "", node.lineno) for alias in node.names if alias.name.split(".")[0] == "navstack"]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{FILES[module]}:{node.lineno}: relative import"
            if node.module and node.module.split(".")[0] == "navstack":
                found += [(node.module, alias.name, node.lineno) for alias in node.names]
    return found


def across() -> Iterator[tuple[str, str, str, int]]:
    """Yield the imports between packages: (importing module, module, name, line)."""
    for module in FILES:
        for other, name, line in imports_of(module):
            target = f"navstack.{name}" if other == "navstack" else other
            if package_of(target).startswith("_") or (target not in FILES and other == "navstack"):
                continue  # navstack._lazy; names of the face of navstack itself
            if module not in ("navstack", "navstack.__main__") and package_of(target) != package_of(module):
                yield module, target, name, line


def where(module: str, line: int) -> str:
    return f"{FILES[module].relative_to(ROOT)}:{line}"


def test_every_package_has_a_level() -> None:
    there = {package_of(module) for module in FILES} - {""}
    assert {name for name in there if not name.startswith("_")} == set(LEVEL_OF)


@pytest.mark.slow
def test_imports_go_down_only() -> None:
    wrong = [
        f"{where(module, line)}: {package_of(module)} imports {target}"
        for module, target, _, line in across()
        if LEVEL_OF[package_of(target)] >= LEVEL_OF[package_of(module)]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_packages_import_faces_only() -> None:
    wrong = [f"{where(module, line)}: {target}" for module, target, _, line in across() if target.count(".") > 1]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_no_private_name_crosses_a_package() -> None:
    wrong = [f"{where(module, line)}: {name}" for module, _, name, line in across() if name.startswith("_")]
    assert not wrong, "\n".join(wrong)


@cache
def origin_of(module: str, name: str) -> str:
    """Return the module that a name of a face comes from, or the module itself."""
    inner = f"{module}.{name}"
    if inner in FILES:
        return inner
    if FILES[module].name == "__init__.py":
        for other, imported, _ in imports_of(module):
            if imported == name and other != module:
                return origin_of(other, name)
    return module


@pytest.mark.slow
def test_no_import_circles_also_for_types() -> None:
    graph: dict[str, set[str]] = {}
    for module in FILES:
        if FILES[module].name == "__init__.py" or module == "navstack.__main__":
            continue
        found = {origin_of(other, name) if name and other in FILES else other for other, name, _ in imports_of(module)}
        graph[module] = {other for other in found if other in FILES and FILES[other].name != "__init__.py"}
    done: set[str] = set()
    path: list[str] = []
    circles: list[str] = []

    def visit(module: str) -> None:
        if module in path:
            circles.append(" -> ".join([*path[path.index(module) :], module]))
            return
        if module in done:
            return
        path.append(module)
        for other in sorted(graph.get(module, ())):
            visit(other)
        path.pop()
        done.add(module)

    for module in graph:
        visit(module)
    assert not circles, "\n".join(circles)


def test_faces_hold_names_only() -> None:
    for face in FACES:
        body = tree_of(face).body
        assert ast.get_docstring(tree_of(face)), face
        for node in body[1:]:
            assert isinstance(node, ast.ImportFrom | ast.If), f"{FILES[face]}:{node.lineno}"


@pytest.mark.slow
def test_every_name_of_a_face_is_there() -> None:
    for face in FACES:
        module = importlib.import_module(face)
        for name in getattr(module, "__all__", ()):
            assert getattr(module, name) is not None, f"{face}.{name}"


@pytest.mark.slow
def test_no_module_hides_a_name_of_a_face() -> None:
    import navstack

    # importing navstack.x sets the attribute x of the package, whatever stood there
    assert not ({package_of(module) for module in FILES} - {"logs"}) & set(
        navstack.__all__
    )  # `nav.logs` is the package
    for face in FACES:
        inner = {module.split(".")[2] for module in FILES if module.startswith(f"{face}.")}
        assert not inner & set(getattr(importlib.import_module(face), "__all__", ())), face


def imported_after(statement: str, *modules: str) -> list[str]:
    code = f"import sys\n{statement}\nprint([m for m in {modules!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return ast.literal_eval(out.stdout.strip().splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("statement", "banned"),
    [
        ("import navstack", ("numpy", "numba", "matplotlib", "scipy", "pydantic", "typer")),
        ("import navstack.parameters", ("numba", "matplotlib", "scipy")),
        ("import navstack.cli", ("numba", "matplotlib", "scipy", "numpy", "pydantic", "shapely")),
        ("import navstack; navstack.load_configuration(['turtlebot'])", ("numba", "matplotlib")),
    ],
)
def test_what_an_import_does_not_load(statement: str, banned: tuple[str, ...]) -> None:
    assert imported_after(statement, *banned) == []


@pytest.mark.slow
def test_numba_is_imported_by_the_kernel_wrapper_only() -> None:
    for module, file in FILES.items():
        if module in ("navstack.core.jit", "navstack.core.kernel_cache", "navstack.core.compilation"):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] == "numba"], file


def kernels() -> Iterator[tuple[str, ast.FunctionDef]]:
    for module in FILES:
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.FunctionDef):
                decorators = {d.id if isinstance(d, ast.Name) else getattr(d, "attr", "") for d in node.decorator_list}
                if decorators & {"kernel", "plain_kernel"}:
                    yield module, node


@pytest.mark.slow
def test_kernels_take_positional_arguments_and_few_of_them() -> None:
    wide: set[str] = set()
    for module, function in kernels():
        arguments = function.args
        at = f"{FILES[module]}:{function.lineno} {function.name}"
        assert not (arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.defaults), at
        if len(arguments.args) > 12:
            wide.add(f"{module}:{function.name}")
    assert wide == WIDE_KERNELS
    assert len(WIDE_KERNELS) <= 3


@pytest.mark.slow
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


def test_data_are_packaged_and_hold_no_code() -> None:
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]
    assert {"params", "maps"} <= set(build["targets"]["wheel"]["only-include"])
    for folder in ("params", "maps"):
        assert list((ROOT / folder).iterdir())
        assert not list((ROOT / folder).rglob("*.py"))


def test_the_architecture_page_is_generated_from_the_tree() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python tools/docs/architecture_page.py"


def test_layout_of_the_repository() -> None:
    expected = {"pyproject.toml", "README.md", "navstack", "params", "maps", "tests", "tools", "docs", "examples"}
    assert {path.name for path in ROOT.iterdir()} >= expected
