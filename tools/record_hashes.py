"""Hash the records of eight runs: compare two states of the code.

    python tools/record_hashes.py [--write FILE | --compare FILE] [NAME ..]

Drives three shipped scenarios, the three goals on the map of Willow Garage, one BARN world, one scenario of the suite
`crowd`, one run with TrajectoryPlannerROS, and one with voxel layers and moving obstacles. For each it prints
two hashes: of the file `run.npz`, and of its arrays only (a change of wording changes the former, not the latter).
`--compare FILE` exits with 1 if an array hash differs from the one in FILE.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

from navstack.core import Pose2D
from navstack.map_io import load_map
from navstack.parameters import load_configuration
from navstack.record import RunRecorder
from navstack.scenario import Scenario, load_suite, load_worlds, read_scenario, run_scenario, shipped_scenarios
from navstack.studies.barn import barn_configuration, barn_scenario

DATA = Path(os.environ.get("NAVSTACK_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


def _shipped(name: str, *overrides: str) -> Scenario:
    return read_scenario(shipped_scenarios()[name]).build(overrides=list(overrides))


def _willow() -> Scenario:
    folder = DATA / "maps" / "turtlebot_apps__willow-2010-02-18-0.10"
    goals = (Pose2D(27.35, 10.55, 1.57), Pose2D(34.45, 15.25, 0.0), Pose2D(26.25, 3.45, 3.14))
    return Scenario(
        load_map(folder / "willow-2010-02-18-0.10.yaml"),
        load_configuration([str(DATA / "params" / "turtlebot2" / "param")]),
        Pose2D(29.75, 7.95, 0.0),
        goals,
    )


def _barn() -> Scenario:
    configuration = barn_configuration([str(DATA / "params" / "jackal_barn")])
    return barn_scenario(load_worlds(DATA / "barn" / "worlds.npz")[3], configuration)


RUNS: dict[str, Callable[[], Scenario]] = {
    "office_tour": lambda: _shipped("office_tour"),
    "noise": lambda: _shipped("noise"),
    "maze_lanes": lambda: _shipped("maze_lanes"),
    "willow": _willow,
    "barn": _barn,
    "crowd": lambda: load_suite("crowd", count=3)[2].build(),
    "trajectory_rollout": lambda: _shipped(
        "warehouse_aisle", "base_local_planner=base_local_planner/TrajectoryPlannerROS"
    ),
    "voxels": lambda: _shipped("moving_discs"),
}


def hashes(recorder: RunRecorder) -> dict[str, str]:
    """SHA-256 of a record's file and of its arrays alone."""
    with tempfile.TemporaryDirectory() as folder:
        recorder.save(Path(folder))
        content = (Path(folder) / "run.npz").read_bytes()
    arrays = hashlib.sha256()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for name in sorted(name for name in archive.namelist() if name.endswith(".npy")):
            arrays.update(name.encode())
            arrays.update(archive.read(name))
    return {"file": hashlib.sha256(content).hexdigest(), "arrays": arrays.hexdigest()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(RUNS)}; all by default")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--compare", type=Path)
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in RUNS]
    if unknown:
        parser.error(f'no run "{unknown[0]}"; use some of: {", ".join(RUNS)}')
    expected = json.loads(args.compare.read_text()) if args.compare else {}
    found: dict[str, dict[str, str]] = {}
    different = False
    for name in args.names or RUNS:
        result = run_scenario(RUNS[name]())
        assert result.recorder is not None
        found[name] = hashes(result.recorder)
        line = f"{name:20} arrays {found[name]['arrays'][:16]}  file {found[name]['file'][:16]}"
        if args.compare:
            for part in ("arrays", "file"):
                same = found[name][part] == expected[name][part]
                line += f"  {part} {'same' if same else 'DIFFERENT'}"
                different |= part == "arrays" and not same
        states = ",".join(goal.state for goal in result.goals)
        print(f"{line}  {result.simulated_s:.1f} s  {states}", flush=True)
    if args.write:
        args.write.write_text(json.dumps(found, indent=1) + "\n")
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
