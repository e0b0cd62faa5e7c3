"""Change the product at random, one place at a time, and see whether the tests notice.

    python tools/mutate.py --map build/calls        # once: which test calls which function (two processes)
    python tools/mutate.py [--calls build/calls] [--count 100] [--seed 0] [--processes 1] [--limit S] [--within PATH] [--list]

A mutation turns around a comparison, an operator of arithmetic, a sign, `and` or `or`, or changes a constant, in a copy of the
repository. The tests run there until one fails. With the calls known, these are the tests that call the changed function, at most
150: the quick ones first, and of these the ones that call the fewest functions. For code outside functions, and without known
calls, they are the files of tests that name the module, then its package's, then the golden data and the others that use its
package; those that need a browser or ROS run if their variables are set, as in CI (NAVSTACK_ROS1_TESTS=1). A mutation that no
test notices is a survivor; it is printed with file and line, before and after. A test that hangs has noticed it. Mutations that
cannot change a result (annotations, texts of errors) are not made.

Exit code 1 if more than five of a hundred survive.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

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
    absent = {
        folder for folder in ("browser", "ros1", "ros2") if os.environ.get(f"NAVSTACK_{folder.upper()}_TESTS") != "1"
    }
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        relative = test.relative_to(ROOT)
        text = test.read_text(encoding="utf-8")
        if relative.parts[1] in absent or test.name in ("test_architecture.py", "test_packaging.py"):
            continue
        if module in text or any(name in text for name in names):
            first.append(str(relative))
        elif relative.parts[1] == package:
            second.append(str(relative))
        elif f"navstack.{package}" in text or relative.parts[1] in ("golden", "contracts", "cli"):
            third.append(str(relative))
    return [*first, *second, *third]


# ----------------------------------------------------------------------------------------------------------------------
# Which test calls which function. This file is then a plugin of pytest.

CALLS_VARIABLE = "NAVSTACK_MUTATION_CALLS"
"""The folder into which the processes of pytest write the calls."""
_called: dict[str, set[str]] = {}
"""Test -> functions, as `navstack/core/poses.py:Pose2D.distance`."""
_current: set[str] = set()


def _names_of_kernel(kernel: Any, known: dict[int, frozenset[str]]) -> frozenset[str]:
    """Return the names of a kernel and of those that it calls, directly or not."""
    if id(kernel) not in known:
        known[id(kernel)] = frozenset()  # ends a recursion
        code = kernel.function.__code__
        names = {f"{_relative(code.co_filename)}:{code.co_qualname}"}
        for callee in kernel.callees.values():
            names |= _names_of_kernel(callee, known)
        known[id(kernel)] = frozenset(names)
    return known[id(kernel)]


def _relative(file: str) -> str:
    start = file.rfind("/navstack/")
    return file[start + 1 :] if start >= 0 else ""


def _record_kernels() -> None:
    """Record calls of compiled functions, which no profile sees."""
    from navstack.core.jit import Kernel

    compiled = Kernel.compiled
    known: dict[int, frozenset[str]] = {}
    recorders: dict[int, Any] = {}

    def recorder(self: Any) -> Any:
        if id(self) not in recorders:
            function = compiled(self)

            def call(*args: Any, **kwargs: Any) -> Any:
                _current.update(_names_of_kernel(self, known))
                return function(*args, **kwargs)

            recorders[id(self)] = call
        return recorders[id(self)]

    Kernel.compiled = recorder
    Kernel.__call__ = lambda self, *args, **kwargs: recorder(self)(*args, **kwargs)
    Kernel.dispatcher = property(compiled)  # type: ignore[assignment]


def pytest_configure() -> None:
    """Record kernels, where this file is a plugin."""
    if os.environ.get(CALLS_VARIABLE):
        _record_kernels()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Record the functions of the product that a test calls."""
    if not os.environ.get(CALLS_VARIABLE):
        yield
        return
    codes: set[Any] = set()

    def profile(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            codes.add(frame.f_code)

    _current.clear()
    sys.setprofile(profile)
    try:
        yield
    finally:
        sys.setprofile(None)
    names = {f"{file}:{code.co_qualname}" for code in codes if (file := _relative(code.co_filename))}
    _called[item.nodeid] = {name.split(".<locals>")[0] for name in names | _current}


def pytest_sessionfinish() -> None:
    """Write the calls of this process."""
    if folder := os.environ.get(CALLS_VARIABLE):
        text = json.dumps({test: sorted(names) for test, names in _called.items()})
        (Path(folder) / f"{os.getpid()}.json").write_text(text)


def record_calls(folder: Path) -> None:
    """Run the tests and write which functions each calls."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    environment = {**os.environ, CALLS_VARIABLE: str(folder.resolve()), "PYTHONPATH": f"{ROOT}:{ROOT / 'tools'}"}
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "-m", "not real", "-p", "mutate"],
        cwd=ROOT,
        env=environment,
        check=False,
    )


MOST_CALLERS = 150
"""Tests of a function that run first: a mutation that the most specific ones do not notice, the others do not either."""


def read_calls(folder: Path) -> dict[str, list[str]]:
    """Return the tests of each function, those first that call the fewest functions."""
    tests: dict[str, list[str]] = {}
    for file in sorted(folder.glob("*.json")):
        tests |= json.loads(file.read_text())
    found: dict[str, list[str]] = {}
    for test in sorted(tests, key=lambda name: (len(tests[name]), name)):
        for function in tests[test]:
            callers = found.setdefault(function, [])
            if len(callers) < MOST_CALLERS:
                callers.append(test)
    return found


def function_of(mutation: Mutation) -> str:
    """Return the function, method or class around a mutation, as the calls name it."""
    node: ast.AST = ast.parse(mutation.file.read_text(encoding="utf-8"))
    names: list[str] = []
    while True:
        inner = [
            child
            for child in ast.iter_child_nodes(node)
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.If | ast.With | ast.Try)
            and child.lineno <= mutation.line <= (child.end_lineno or 0)
        ]
        if not inner:
            break
        node = inner[0]
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.append(node.name)
        if not isinstance(node, ast.ClassDef | ast.If | ast.With | ast.Try):
            break
    return f"{mutation.file.relative_to(ROOT)}:{'.'.join(names)}"


def _run(command: list[str], folder: Path, cpu_s: float) -> tuple[int | None, str, float]:
    """Run pytest in a copy; return its exit code (None at the limit), its output, and the seconds of the processor that it took.

    Time of the processor, because other work on the machine must not decide; a mutation that waits ends by the clock.
    """
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT)
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (math.ceil(cpu_s), math.ceil(cpu_s) + 5))
        end = time.monotonic() + 10.0 * cpu_s
        while not (ended := os.wait4(process.pid, os.WNOHANG))[0]:
            if time.monotonic() > end:
                process.kill()
            time.sleep(0.1)
        process.returncode = os.waitstatus_to_exitcode(ended[1])
        output.seek(0)
        text = output.read()
    return None if process.returncode < 0 else process.returncode, text, ended[2].ru_utime + ended[2].ru_stime


def _hangs(mutation: Mutation, folder: Path, command: list[str], test: str, limit: float) -> str:
    """Return the test that ran at the limit if alone it takes ten times as long with the mutation as it may take without."""
    if not test or _run([*command, test], folder, limit)[0] is not None:
        return ""
    mutation.undo(folder)
    return f"HANGS {test}" if _run([*command, test], folder, limit / 10.0)[0] == 0 else ""


def _last_started(output: str) -> str:
    """Return the test that ran when pytest -v was stopped, or ""."""
    last = output.rpartition("\n")[2].strip()  # a line ends with the outcome
    return last if "::" in last else ""


def _lost(tests: list[str], output: str) -> set[str]:
    """Return the tests that pytest did not find: they changed since --map."""
    lines = [line for line in output.splitlines() if line.startswith("ERROR: ") and "not found: " in line]
    names = [line.partition("not found: ")[2].partition("[")[0] for line in lines]
    return {test for test in tests if "::" in test and any(name.endswith(test.partition("[")[0]) for name in names)}


def noticed(mutation: Mutation, folder: Path, limit: float, calls: dict[str, list[str]]) -> tuple[str, float]:
    """Run the tests on a mutation in a copy for `limit` seconds at most; return the test that failed, or "", and the seconds."""
    mutation.apply(folder)
    command = [sys.executable, "-u", "-m", "pytest", "-v", "-x", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command += ["-o", "addopts=--strict-markers"]
    callers = calls.get(function_of(mutation), [])
    files = tests_for(mutation.file)
    chosen, markers = (
        (callers, ("not slow", "slow")) if callers else (files, ("not slow and not real", "slow and not real", "real"))
    )
    rounds = [["-m", marker, *chosen] for marker in markers]  # most mutations are noticed by a quick test
    spent = 0.0
    try:
        while rounds:
            tests = rounds.pop(0)
            code, output, seconds = _run([*command, *tests], folder, max(1.0, limit - spent))
            spent += seconds
            if lost := _lost(tests, output):
                left = [test for test in tests if test not in lost]
                rounds[:0] = [left] if any("::" in test for test in left) else []
                continue
            if code is None:
                return _hangs(mutation, folder, command, _last_started(output), limit), spent
            if code not in (0, 5):
                failed = [line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return (failed or ["the tests do not start"])[0][:100], spent
        return "", spent
    finally:
        mutation.undo(folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--limit",
        type=float,
        default=600.0,
        help="seconds of the processor for the tests of a mutation; without a failure in them, it survives",
    )
    parser.add_argument("--within", type=Path, default=ROOT / "navstack")
    parser.add_argument("--map", type=Path, metavar="DIR", help="write which test calls which function, and stop")
    parser.add_argument("--calls", type=Path, metavar="DIR", help="what --map has written")
    parser.add_argument(
        "--only", type=int, nargs="*", metavar="N", help="run these of the chosen mutations, as after a fix"
    )
    parser.add_argument("--list", action="store_true", help="print the mutations, run no tests")
    args = parser.parse_args()
    if args.map is not None:
        record_calls(args.map)
        return
    calls = read_calls(args.calls) if args.calls is not None else {}
    chance = random.Random(args.seed)
    within = args.within.resolve()
    files = [within] if within.is_file() else sorted(within.rglob("*.py"))
    possible = [m for file in files if file.name != "__init__.py" for m in mutations_of(file, chance)]
    chosen = chance.sample(possible, min(args.count, len(possible)))
    print(f"{len(possible)} possible mutations, {len(chosen)} chosen with seed {args.seed}", flush=True)
    numbers = [n - 1 for n in args.only] if args.only else list(range(len(chosen)))
    if args.list:
        print("\n".join(f"{n + 1:4} {chosen[n]}" for n in numbers))
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
            for index in numbers[number :: args.processes]:
                test, seconds = noticed(chosen[index], folders[number], args.limit, calls)
                if not test:
                    survivors.append(chosen[index])
                word = "noticed " if test else "SURVIVED"
                print(f"{index + 1:4} {word} {seconds:6.0f} s  {chosen[index]}  {test}", flush=True)

        with ThreadPoolExecutor(args.processes) as pool:
            list(pool.map(work, range(args.processes)))
    print(f"{len(numbers) - len(survivors)} of {len(numbers)} noticed; survivors:")
    print("\n".join(map(str, survivors)) or "none")
    sys.exit(len(survivors) > 0.05 * len(numbers))


if __name__ == "__main__":
    main()
