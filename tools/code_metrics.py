"""Print the size of the code by package: files, functions, kernel arguments.

    python tools/code_metrics.py [--offenders] [PACKAGE ..]

For each package: files, lines, median lines per file, functions, median, 90th percentile and maximum of the lines per
function (kernels apart), the largest number of arguments of a kernel. `--offenders` lists everything above the limits that
`tests/test_architecture.py` checks.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "navstack"

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60
MAX_KERNEL_LINES = 120
MAX_KERNEL_ARGUMENTS = 12


@dataclass(frozen=True)
class Function:
    """A function or method: its length without docstring and decorators, and its arguments without self."""

    file: Path
    line: int
    name: str
    lines: int
    arguments: int
    is_kernel: bool


def functions_of(file: Path) -> Iterator[Function]:
    """Every function and method in a file, nested ones included."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        decorators = {d.id if isinstance(d, ast.Name) else getattr(d, "attr", "") for d in node.decorator_list}
        first = node.lineno
        body = node.body
        if ast.get_docstring(node) is not None:
            lines = node.end_lineno - first + 1 - (body[0].end_lineno - body[0].lineno + 1)
        else:
            lines = node.end_lineno - first + 1
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        yield Function(
            file, first, node.name, lines, len(arguments), bool({"kernel", "plain_kernel"} & set(decorators))
        )


def _percentile(values: list[int], share: float) -> int:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="*")
    parser.add_argument("--offenders", action="store_true")
    args = parser.parse_args()
    rooms: dict[str, list[Path]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        relative = file.relative_to(PACKAGE)
        rooms.setdefault(relative.parts[0].removesuffix(".py") if len(relative.parts) > 1 else "(top)", []).append(file)
    rows: list[tuple[str, list[Path]]] = [(r, f) for r, f in rooms.items() if not args.packages or r in args.packages]
    if not args.packages:
        rows.append(("all", [f for _, files in rows for f in files]))
    print(
        f"{'package':16}{'files':>6}{'lines':>7}{'median':>7}{'max':>6}{'functions':>10}{'median':>7}{'p90':>5}{'max':>5}"
        f"{'kernels':>8}{'max':>5}{'args':>5}"
    )
    for room, files in rows:
        lengths = [len(f.read_text(encoding="utf-8").splitlines()) for f in files]
        functions = [f for file in files for f in functions_of(file)]
        plain = [f.lines for f in functions if not f.is_kernel]
        kernels = [f for f in functions if f.is_kernel]
        print(
            f"{room:16}{len(files):6}{sum(lengths):7}{_percentile(lengths, 0.5):7}{max(lengths):6}{len(plain):10}"
            f"{_percentile(plain, 0.5):7}{_percentile(plain, 0.9):5}{max(plain, default=0):5}"
            f"{len(kernels):8}{max((k.lines for k in kernels), default=0):5}{max((k.arguments for k in kernels), default=0):5}"
        )
    if args.offenders:
        for file in (f for _, files in rows for f in files if _ != "all"):
            lines = len(file.read_text(encoding="utf-8").splitlines())
            if lines > MAX_FILE_LINES:
                print(f"{file.relative_to(PACKAGE)}: {lines} lines")
            for f in functions_of(file):
                where = f"{file.relative_to(PACKAGE)}:{f.line} {f.name}"
                if f.lines > (MAX_KERNEL_LINES if f.is_kernel else MAX_FUNCTION_LINES):
                    print(f"{where}: {f.lines} lines")
                if f.is_kernel and f.arguments > MAX_KERNEL_ARGUMENTS:
                    print(f"{where}: kernel with {f.arguments} arguments")


if __name__ == "__main__":
    main()
