"""Mutate maps, records, scenarios, parameters, launch files, logs and trees, and read them: no traceback, no hang, little memory.

    python tools/fuzz_inputs.py [--count N] [--seed S] [--kind KIND ..] [--processes P] [--commands SHARE] [--keep FOLDER]
    python tools/fuzz_inputs.py --seed S --only I          # one input again, with its traceback

Each input is a valid file with seeded changes: bytes, lines and encodings; nodes of YAML, JSON and XML documents replaced,
exchanged, nested or repeated by aliases and substitutions; headers of arrays, archives and images forged; pipes, devices, links
and folders in the place of files. It is read by the reader that the commands use, a share of the inputs by a whole command.
`--kind mapping` builds maps from mutated logs of scans; each takes 0.1 s, so it is not among the kinds that are made by default.

Anything but a result or a NavError counts as a traceback. Also counted: reads over 5 s (without the time in which other
processes had the processor), and reads during which the memory of the process grows by more than 1 GB; both are measured for
each input. `--keep` stores the offending inputs. Exit code 1 if
there is any.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from tools.fuzz.inputs import KINDS, SLOW_KINDS  # noqa: E402
from tools.fuzz.run import MAX_BYTES, MAX_SECONDS, Counts, Plan, fuzz_in_processes  # noqa: E402


def print_counts(counts: Counts, seconds: float) -> None:
    """Print the offending inputs, a row per reader, and the sum."""
    for text in counts.failures[:200]:
        print(text)
    print(
        f"{'reader':<14}{'inputs':>10}{'accepted':>10}{'mean ms':>9}{'slowest s':>11}{'input':>9}{'most MB':>10}{'input':>9}"
    )
    for reader, of_reader in sorted(counts.readers.items()):
        print(
            f"{reader:<14}{of_reader.inputs:>10}{of_reader.accepted:>10}"
            f"{1000.0 * of_reader.seconds / of_reader.inputs:>9.2f}{of_reader.slowest[0]:>11.2f}{of_reader.slowest[1]:>9}"
            f"{of_reader.largest[0] / 1e6:>10.0f}{of_reader.largest[1]:>9}"
        )
    print(
        f"{counts.inputs} inputs, {counts.accepted} accepted; {len(counts.tracebacks)} tracebacks, {len(counts.slow)} over "
        f"{MAX_SECONDS:g} s, {len(counts.large)} over {MAX_BYTES / 1e9:g} GB; {seconds:.0f} s"
    )


def _read_one(plan: Plan, number: int) -> int:
    import random
    import tempfile

    from navstack.core import NavError
    from tools.fuzz.inputs import Inputs
    from tools.fuzz.measure import measured

    with tempfile.TemporaryDirectory(prefix="navstack_fuzz_") as name:
        kind = plan.kinds[number % len(plan.kinds)]
        made = Inputs(Path(name), commands=plan.commands).make(kind, random.Random(f"{plan.seed}/{number}"))
        wall, seconds, grown, failure = measured(made.read)
        print(f"{kind} ({made.reader}): {seconds:.2f} s ({wall:.2f} s with other processes), {grown / 1e6:.0f} MB")
        if failure is not None and not isinstance(failure, NavError):
            raise failure
        print(f"{type(failure).__name__}: {failure}" if failure is not None else "accepted")
    return 0


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--only", type=int, help="read this input alone")
    parser.add_argument("--kind", choices=KINDS + SLOW_KINDS, action="append")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--commands", type=float, default=0.001, help="share of the inputs that a whole command reads")
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    plan = Plan(given.seed, tuple(given.kind or KINDS), given.commands, given.keep)
    if given.only is not None:
        return _read_one(plan, given.only)
    started = time.monotonic()
    shown = [started]
    known: set[str] = set()

    def progress(counts: Counts) -> None:
        for text in counts.failures:
            if text not in known:
                known.add(text)
                print(text, file=sys.stderr, flush=True)
        if time.monotonic() - shown[0] > 60.0:
            shown[0] = time.monotonic()
            print(
                f"{counts.inputs} of {given.count} inputs, {len(counts.failures)} failures", file=sys.stderr, flush=True
            )

    counts = fuzz_in_processes(plan, given.count, given.processes, first=given.first, progress=progress)
    print_counts(counts, time.monotonic() - started)
    return 1 if counts.failures else 0


if __name__ == "__main__":
    sys.exit(main())
