"""Draw the success of policies on held-out worlds against the time of their training.

    python examples/learning/curve.py policy_0.csv policy_1.csv policy_2.csv --out curve.png

The tables are those that `train.py` writes beside each policy.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from matplotlib.figure import Figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("curve.png"))
    options = parser.parse_args()
    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    by_time, by_steps = figure.subplots(1, 2, sharey=True)
    for table in options.tables:
        with table.open(newline="") as file:
            rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
        success = [row["success"] for row in rows]
        by_time.plot([row["minutes"] for row in rows], success, marker=".", label=table.stem.replace("_", " "))
        by_steps.plot([row["steps"] / 1e6 for row in rows], success, marker=".")
    by_time.set_xlabel("training (min)")
    by_steps.set_xlabel("steps (million)")
    by_time.set_ylabel("success on held-out worlds")
    by_time.set_ylim(0.0, 1.02)
    by_time.legend(frameon=False, loc="lower right")
    for axes in (by_time, by_steps):
        axes.grid(alpha=0.3)
        axes.set_xlim(left=0.0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(options.out, dpi=150)


if __name__ == "__main__":
    main()
