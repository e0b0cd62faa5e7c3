"""Change the product at random, one place at a time, and see whether the tests notice.

    python tools/mutate.py [--count 100] [--seed 0] [--processes 1] [--limit S] [--within navstack/core] [--list]

A mutation turns around a comparison, an operator of arithmetic, a sign, `and` or `or`, or changes a constant, in a copy of the
repository. The tests of the changed module run there until one fails: those that name it first, then its package's, then the
golden data and the other tests that use its package. A mutation that no test notices is a survivor; it is printed with file and
line, before and after. Mutations that cannot change a result (annotations, texts of errors) are not made.

Exit code 1 if more than five of a hundred survive.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMPARISONS = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
TURNED = {ast.Lt: ">", ast.LtE: ">", ast.Gt: "<", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="}
ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*"}


@dataclass(frozen=True)
class Mutation:
    """One change of a file: the text of a node is replaced."""

    file: Path
    line: int
    column: int
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}:{self.column + 1}: {self.old}  ->  {self.new}"

    def apply(self, root: Path) -> None:
        """Write the changed file below `root`."""
        target = root / self.file.relative_to(ROOT)
        lines = self.file.read_bytes().split(b"\n")
        line = lines[self.line - 1]
        lines[self.line - 1] = line[: self.column] + self.new.encode() + line[self.end :]
        target.write_bytes(b"\n".join(lines))

    def undo(self, root: Path) -> None:
        """Restore the file below `root`."""
        shutil.copyfile(self.file, root / self.file.relative_to(ROOT))


def _skipped(tree: ast.Module) -> set[int]:
    """Return the nodes of annotations, `__all__`, and of blocks for type checkers."""
    found: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST] = []
        if isinstance(node, ast.AnnAssign) or (isinstance(node, ast.arg) and node.annotation is not None):
            parts.append(node.annotation)
        elif isinstance(node, ast.FunctionDef) and node.returns is not None:
            parts.append(node.returns)
        elif (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)) or isinstance(
            node, ast.Assert | ast.JoinedStr | ast.Raise
        ):
            parts.append(node)
        for part in parts:
            found |= {id(inner) for inner in ast.walk(part)}
    return found


def mutations_of(file: Path, chance: random.Random) -> Iterator[Mutation]:
    """Yield the possible mutations of a file, one per place."""
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    skipped = _skipped(tree)
    for node in ast.walk(tree):
        if id(node) in skipped or getattr(node, "lineno", 0) != getattr(node, "end_lineno", -1):
            continue
        new: ast.expr | None = None
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARISONS:
            table = chance.choice((COMPARISONS, TURNED))
            new = _with(
                node, f"({ast.unparse(node.left)} {table[type(node.ops[0])]} {ast.unparse(node.comparators[0])})"
            )
        elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC and not _is_text(node):
            new = _with(node, f"({ast.unparse(node.left)} {ARITHMETIC[type(node.op)]} {ast.unparse(node.right)})")
        elif isinstance(node, ast.BoolOp):
            word = " or " if isinstance(node.op, ast.And) else " and "
            new = _with(node, "(" + word.join(f"({ast.unparse(value)})" for value in node.values) + ")")
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            new = node.operand
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            value = (not node.value) if isinstance(node.value, bool) else node.value + 1
            new = ast.Constant(value)
        if new is not None and isinstance(node, ast.expr):
            yield Mutation(
                file,
                node.lineno,
                node.col_offset,
                node.end_col_offset or 0,
                ast.get_source_segment(text, node) or "",
                ast.unparse(new) if not isinstance(new, ast.Name) or new.id[:1] != "(" else new.id,
            )


def _with(node: ast.expr, text: str) -> ast.expr:
    """Return the expression in `text`."""
    del node
    return ast.Name(text)


def _is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(part, ast.JoinedStr | ast.List | ast.Tuple) or _is_string(part) for part in (node.left, node.right)
    )


def _is_string(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def tests_for(file: Path) -> list[str]:
    """Return the tests of a file: those that name it, its package's, then the others that use the package."""
    parts = file.relative_to(ROOT / "navstack").with_suffix("").parts
    package, module = parts[0], ".".join(("navstack", *parts))
    names = {
        node.name
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
    }
    first: list[str] = []
    second: list[str] = []
    third: list[str] = []
    slow = {"browser", "ros1", "ros2"}
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        relative = test.relative_to(ROOT)
        text = test.read_text(encoding="utf-8")
        if relative.parts[1] in slow or test.name in ("test_architecture.py", "test_packaging.py"):
            continue
        if module in text or any(name in text for name in names):
            first.append(str(relative))
        elif relative.parts[1] == package:
            second.append(str(relative))
        elif f"navstack.{package}" in text or relative.parts[1] in ("golden", "contracts", "cli"):
            third.append(str(relative))
    return [*first, *second, *third]


def noticed(mutation: Mutation, folder: Path, limit: float) -> tuple[bool, float]:
    """Run the tests on a mutation in a copy for `limit` seconds at most; return whether one failed, and the seconds."""
    began = time.monotonic()
    mutation.apply(folder)
    try:
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist"]
        command += ["-o", "addopts=--strict-markers", *tests_for(mutation.file)]
        environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        for marker in ("not slow", "slow"):  # most mutations are noticed by a quick test
            left = limit - (time.monotonic() - began)
            done = subprocess.run(
                [*command, "-m", marker], cwd=folder, env=environment, capture_output=True, timeout=left, check=False
            )
            if done.returncode not in (0, 5):
                return True, time.monotonic() - began
        return False, time.monotonic() - began
    except subprocess.TimeoutExpired:
        return False, time.monotonic() - began
    finally:
        mutation.undo(folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--limit", type=float, default=600.0, help="seconds for the tests of a mutation; without a failure, it survives"
    )
    parser.add_argument("--within", type=Path, default=ROOT / "navstack")
    parser.add_argument("--list", action="store_true", help="print the mutations, run no tests")
    args = parser.parse_args()
    chance = random.Random(args.seed)
    within = args.within.resolve()
    files = [within] if within.is_file() else sorted(within.rglob("*.py"))
    possible = [m for file in files if file.name != "__init__.py" for m in mutations_of(file, chance)]
    chosen = chance.sample(possible, min(args.count, len(possible)))
    print(f"{len(possible)} possible mutations, {len(chosen)} chosen with seed {args.seed}", flush=True)
    if args.list:
        print("\n".join(map(str, chosen)))
        return
    ignore = shutil.ignore_patterns(".git", ".venv", "build", "__pycache__", ".pytest_cache", "navstack_*")
    survivors: list[Mutation] = []
    with tempfile.TemporaryDirectory() as scratch:
        folders = []
        for number in range(args.processes):
            folders.append(Path(scratch) / f"copy{number}" / "main")
            shutil.copytree(ROOT, folders[-1], ignore=ignore)
            if (shared := ROOT.parent / "shared").is_dir():
                (folders[-1].parent / "shared").symlink_to(shared)

        def work(number: int) -> None:
            for index in range(number, len(chosen), args.processes):
                found, seconds = noticed(chosen[index], folders[number], args.limit)
                if not found:
                    survivors.append(chosen[index])
                print(
                    f"{index + 1:4} {'noticed ' if found else 'SURVIVED'} {seconds:6.0f} s  {chosen[index]}", flush=True
                )

        with ThreadPoolExecutor(args.processes) as pool:
            list(pool.map(work, range(args.processes)))
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} noticed; survivors:")
    print("\n".join(map(str, survivors)) or "none")
    sys.exit(len(survivors) > 0.05 * len(chosen))


if __name__ == "__main__":
    main()
