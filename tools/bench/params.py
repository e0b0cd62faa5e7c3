"""Time to load parameters.

    python tools/bench/params.py [PARAMS ..]

Prints the best and the median of loading each source (after imports), and the longest time to check a megabyte of random text
of several alphabets: CPU time (ms).
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

from navstack.parameters import check_parameters, load_configuration

ALPHABETS = ("ab:- \n", "[]{},: \n", "&a*b: \n", "\ta: b\n", "0123456789.e:\n ", "'\"|>#\n a:")


def timed(job: object) -> float:
    assert callable(job)
    started = time.process_time()
    job()
    return (time.process_time() - started) * 1e3


def main() -> None:
    for source in sys.argv[1:] or ["turtlebot"]:
        times = [timed(lambda source=source: load_configuration([source])) for _ in range(20)]
        print(f"{source}: best {min(times):.1f} ms, median {statistics.median(times):.1f} ms")
    rng = random.Random(7)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "move_base_params.yaml"
        longest = 0.0
        for alphabet in ALPHABETS:
            path.write_text("".join(rng.choices(alphabet, k=990_000)))
            longest = max(longest, timed(lambda: check_parameters([str(path)])))
        for text in ("key_{0}: {0}\n", "space_{0}: {{max_vel_x: {0}}}\n"):
            path.write_text("".join(text.format(i) for i in range(4_500)))
            longest = max(longest, timed(lambda: check_parameters([str(path)])))
    print(f"a megabyte of random text: {longest:.0f} ms at most")


if __name__ == "__main__":
    main()
