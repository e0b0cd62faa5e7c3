"""Report the size and the structure of the code. Nothing is limited here: `tests/test_architecture.py` tests structure.

    python tools/code_metrics.py [--root FOLDER] [PACKAGE ..]

First a row per package: modules, lines, mean and 90th percentile of the lines per file and per function, kernels and their
largest number of arguments. Then the whole house: packages, levels of imports, imports between modules, imports past the face
of a package, imports inside functions, uses of `Any`, modules with one importer, lines of tests, test functions.
`--root` measures another checkout.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path


@dataclass
class Module:
    """A module of the product and its imports."""

    name: str
    file: Path
    tree: ast.Module
    lines: int
    imports: set[str] = field(default_factory=set)
    """Modules that it imports, faces resolved to the modules behind them."""
    past_faces: int = 0
    local: int = 0
    """Import statements inside functions."""

    @property
    def package(self) -> str:
        """`costmap` for navstack.costmap.voxel_layer."""
        return self.name.split(".")[1] if "." in self.name else ""


@dataclass(frozen=True)
class Function:
    """A function or method: its lines without docstring and decorators, and its arguments."""

    lines: int
    arguments: int
    is_kernel: bool


def functions_of(tree: ast.Module) -> Iterator[Function]:
    """Yield every function and method, nested ones included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {d.id if isinstance(d, ast.Name) else getattr(d, "attr", "") for d in node.decorator_list}
            lines = (node.end_lineno or 0) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                lines -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            arguments = len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs)
            yield Function(lines, arguments, bool({"kernel", "plain_kernel"} & decorators))


def modules_of(root: Path) -> dict[str, Module]:
    """Read the product below `root`, with its imports."""
    found: dict[str, Module] = {}
    for file in sorted((root / "navstack").rglob("*.py")):
        parts = file.relative_to(root).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        text = file.read_text(encoding="utf-8")
        found[name] = Module(name, file, ast.parse(text), len(text.splitlines()))

    @cache
    def origin(module: str, name: str) -> str:
        inner = f"{module}.{name}"
        if inner in found:
            return inner
        if found[module].file.name == "__init__.py":
            for node in ast.walk(found[module].tree):
                if isinstance(node, ast.ImportFrom) and node.module in found and node.module != module:
                    for alias in node.names:
                        if (alias.asname or alias.name) == name:
                            return origin(node.module, alias.name)
        return module

    for module in found.values():
        inside = {
            id(node)
            for function in ast.walk(module.tree)
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
            for node in ast.walk(function)
        }
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Import | ast.ImportFrom) and id(node) in inside:
                module.local += 1
            if isinstance(node, ast.ImportFrom) and node.module in found:
                other = node.module.split(".")
                if len(other) > 2 and other[1] != module.package:
                    module.past_faces += 1
                module.imports |= {origin(node.module, alias.name) for alias in node.names} - {module.name}
    return found


def levels_of(graph: dict[str, set[str]]) -> int:
    """Return the number of levels of a graph of imports; modules of a circle share one."""
    depth: dict[str, int] = {}

    def visit(name: str, path: tuple[str, ...]) -> int:
        if name in path:
            return 0
        if name not in depth:
            depth[name] = 1 + max((visit(other, (*path, name)) for other in graph.get(name, ())), default=0)
        return depth[name]

    return max((visit(name, ()) for name in graph), default=0)


def percentile(values: list[int], share: float) -> int:
    """Return the value below which `share` of the values are."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else 0


def mean(values: list[int]) -> float:
    """Return the mean, 0 without values."""
    return sum(values) / len(values) if values else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="*")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    args = parser.parse_args()
    modules = modules_of(args.root)
    rooms: dict[str, list[Module]] = {}
    for module in modules.values():
        rooms.setdefault(module.package or "(top)", []).append(module)
    print(
        f"{'package':16}{'modules':>8}{'lines':>8}{'mean':>6}{'p90':>6}{'functions':>10}{'mean':>6}{'p90':>5}"
        f"{'kernels':>8}{'args':>5}{'levels':>7}"
    )
    rows = [(name, group) for name, group in sorted(rooms.items()) if not args.packages or name in args.packages]
    for name, group in [*rows, *([("all", list(modules.values()))] if not args.packages else [])]:
        functions = [f for module in group for f in functions_of(module.tree)]
        plain = [f.lines for f in functions if not f.is_kernel]
        kernels = [f.arguments for f in functions if f.is_kernel]
        lengths = [module.lines for module in group]
        inner = {m.name for m in group if m.file.name != "__init__.py"}
        graph = {m.name: {o for o in m.imports if o in inner} for m in group if m.name in inner}
        print(
            f"{name:16}{len(group):8}{sum(lengths):8}{mean(lengths):6.0f}{percentile(lengths, 0.9):6}{len(plain):10}"
            f"{mean(plain):6.1f}{percentile(plain, 0.9):5}{len(kernels):8}{max(kernels, default=0):5}{levels_of(graph):7}"
        )
    if args.packages:
        return
    packages: dict[str, set[str]] = {name: set() for name in rooms if name != "(top)"}
    importers: dict[str, int] = {}
    for module in modules.values():
        for other in module.imports:
            importers[other] = importers.get(other, 0) + 1
            if module.package in packages and modules[other].package not in ("", module.package):
                packages[module.package].add(modules[other].package)
    tests = [file.read_text(encoding="utf-8") for file in (args.root / "tests").rglob("*.py")]
    text = [module.file.read_text(encoding="utf-8") for module in modules.values()]
    any_uses = sum(
        isinstance(node, ast.Name) and node.id == "Any" for module in modules.values() for node in ast.walk(module.tree)
    )
    figures = {
        "modules": len(modules),
        "packages": sum(
            (module.file.name == "__init__.py" and module.name.count(".") == 1) for module in modules.values()
        ),
        "levels of packages": levels_of(packages),
        "imports between modules": sum(len(module.imports) for module in modules.values()),
        "imports past a face": sum(module.past_faces for module in modules.values()),
        "imports inside functions": sum(module.local for module in modules.values()),
        "modules with one importer": sum(count == 1 for count in importers.values()),
        "uses of Any": any_uses,
        "lines of the product": sum(len(content.splitlines()) for content in text),
        "lines of tests": sum(len(content.splitlines()) for content in tests),
        "test functions": sum(
            node.name.startswith("test_")
            for content in tests
            for node in ast.walk(ast.parse(content))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        ),
    }
    print()
    for name, value in figures.items():
        print(f"{name:28}{value:8}")


if __name__ == "__main__":
    main()
