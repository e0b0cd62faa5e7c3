"""Write `navstack/core/kernels.json`, the list of specializations that commands use: `python tools/record_kernels.py [USE ..]`.

Runs each command below and notes the kernels that Python calls, and those that they call. A use is what changes the kernels: a
command or a plugin. Named uses replace their rows only. Takes minutes when kernels must be compiled.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

PLAN: Final = ("plan", "office", "--start", "0.8,7.45", "--goal", "16.9,9.6")
DRIVE: Final = ("simulate", "office")

PLANS: Final[dict[str, tuple[str, ...]]] = {
    "navfn": PLAN,
    **{
        name: (*PLAN, "--planner", name) for name in ("global_planner", "astar", "theta_star", "smac_2d", "smac_hybrid")
    },
    **{name: (*PLAN, "--smoother", name) for name in ("simple", "savitzky_golay", "constrained")},
}
DRIVES: Final[dict[str, tuple[str, ...]]] = {
    "dwa": DRIVE,
    "trajectory_rollout": (*DRIVE, "--params", "turtlebot_rollout"),
    "dwb": (*DRIVE, "--params", "turtlebot_dwb"),
    "mppi": (*DRIVE, "--params", "turtlebot_mppi"),
    "regulated_pure_pursuit": (*DRIVE, "--params", "turtlebot_rpp"),
    "graceful": (*DRIVE, "--params", "turtlebot_graceful"),
    "rotation_shim": (*DRIVE, "--params", "turtlebot_shim"),
}
"""Commands by the plugin whose use they record. Those of controllers plan with navfn; its kernels are taken out again."""

RUN: Final = """
import json, sys
from navstack.cli.app import run
from navstack.core import jit
from navstack.core.kernel_cache import describe
file, *command = sys.argv[1:]
run(command)
rows = set()
for kernel in jit.imported_kernels():
    if kernel._compiled is not None:
        for types, calls in kernel.dispatcher.calls.items():
            rows.add((kernel.name, describe(types), 0))
            rows |= {(*call, 1) for call in calls}
open(file, "w").write(json.dumps(sorted(rows)))
"""

Row = tuple[str, str, int]


def record(command: tuple[str, ...]) -> set[Row]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rows.json"
        out = () if command[0] == "plan" else ("--out", folder)
        subprocess.run([sys.executable, "-c", RUN, str(file), *command, *out], check=True, stdout=subprocess.DEVNULL)
        return {tuple(row) for row in json.loads(file.read_text())}


def main() -> int:
    from navstack.core.compilation import MANIFEST

    commands = PLANS | DRIVES
    chosen = sys.argv[1:] or list(commands)
    rows: dict[str, set[Row]] = {}
    if MANIFEST.exists():
        old = json.loads(MANIFEST.read_text())
        for kernel, specializations in old["kernels"].items():
            for types, inner, uses in specializations:
                for use in uses:
                    rows.setdefault(old["uses"][use], set()).add((kernel, types, inner))
    for use in chosen:
        print(use, flush=True)
        rows[use] = record(commands[use])
        if use in DRIVES:
            rows[use] -= rows["navfn"]
    write(MANIFEST, rows)
    return 0


def write(file: Path, rows: dict[str, set[Row]]) -> None:
    uses = sorted(rows)
    kernels: dict[str, Any] = {}
    for name, types, inner in sorted(set().union(*rows.values())):
        numbers = [i for i, use in enumerate(uses) if (name, types, inner) in rows[use]]
        kernels.setdefault(name, []).append((types, inner, numbers))
    lines = [
        f"{json.dumps(name)}: [\n    " + ",\n    ".join(map(json.dumps, each)) + "\n  ]"
        for name, each in kernels.items()
    ]
    file.write_text(f'{{\n"uses": {json.dumps(uses)},\n"kernels": {{\n  ' + ",\n  ".join(lines) + "\n}\n}\n")


if __name__ == "__main__":
    sys.exit(main())
