"""Run the property tests on random examples, with a seed that is printed.

    python tools/explore.py [--seed N] [PYTEST ARGUMENTS ..]

The default test run always draws the same examples, so that it does not depend on chance; this one draws others. With the
same seed it draws the same ones again. Hypothesis prints what fails: add it to the test as an `@example`.
"""

from __future__ import annotations

import argparse
import os
import secrets
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(2**31), help="of hypothesis [default: random]")
    args, further = parser.parse_known_args()
    files = [
        str(file.relative_to(ROOT))
        for file in sorted((ROOT / "tests").rglob("test_*.py"))
        if "@given(" in file.read_text(encoding="utf-8")
    ]
    print(f"seed {args.seed}, {len(files)} files", flush=True)
    command = [sys.executable, "-m", "pytest", "-q", "-m", "hypothesis", f"--hypothesis-seed={args.seed}"]
    environment = os.environ | {"NAVSTACK_EXPLORE": "1"}
    done = subprocess.run([*command, *further, *files], cwd=ROOT, env=environment, check=False)
    if done.returncode:
        print(f"to repeat it: python tools/explore.py --seed {args.seed}")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
