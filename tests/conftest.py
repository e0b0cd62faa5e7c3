"""Locations of the golden data, the foreign data and the reference pages."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import hypothesis
import pytest

# without a deadline: the first example compiles kernels
hypothesis.settings.register_profile("navstack", deadline=None, derandomize=True)
hypothesis.settings.register_profile("explore", deadline=None, print_blob=True)  # tools/explore.py
hypothesis.settings.load_profile("explore" if os.environ.get("NAVSTACK_EXPLORE") == "1" else "navstack")

SHARED = Path(__file__).resolve().parents[2] / "shared"
GOLDEN_PART = Path(__file__).resolve().parent / "golden" / "data"
"""The part of the golden data that is in the repository."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before workers start, which would compile the same ones at once.

    Let Ctrl-C through: processes that a script starts in the background ignore it, and so would all their children.
    """
    state = tempfile.TemporaryDirectory()  # where commands remember the last run
    config.add_cleanup(state.cleanup)
    os.environ["XDG_STATE_HOME"] = state.name
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None):
        uses = DEFAULT_KERNELS if config.getoption("markexpr") == "not slow" else ()
        subprocess.run([sys.executable, "-m", "navstack", "compile", *uses], stdout=subprocess.DEVNULL, check=False)


CI_PARTS = {
    "browser": "NAVSTACK_BROWSER_TESTS",
    "mqtt": "NAVSTACK_MQTT_TESTS",
    "ros1": "NAVSTACK_ROS1_TESTS",
    "ros2": "NAVSTACK_ROS2_TESTS",
}
"""Folders of tests that need real programs, by the variable that runs them."""


COMPILING_FILES = frozenset(
    [
        "behaviors/test_motions.py",
        "behaviors/test_nav2_behaviors.py",
        "cli/test_cover.py",
        "cli/test_dock.py",
        "contracts/test_localizer_contract.py",
        "core/test_collision.py",
        "core/test_footprint_overlap.py",
        "costmap/test_nav2_layers.py",
        "coverage/test_drive.py",
        "coverage/test_plan.py",
        "docking/test_docking.py",
        "explain/test_command.py",
        "explain/test_dwb_command.py",
        "explain/test_mppi_command.py",
        "global_planner/test_both_ends.py",
        "global_planner/test_constrained.py",
        "global_planner/test_curves.py",
        "global_planner/test_cusp_costs.py",
        "global_planner/test_line_cost.py",
        "global_planner/test_nav2_planners.py",
        "global_planner/test_pose_scenes.py",
        "global_planner/test_pose_search.py",
        "global_planner/test_random_plans.py",
        "global_planner/test_smac_hybrid.py",
        "global_planner/test_smac_lattice.py",
        "global_planner/test_smoothers.py",
        "golden/test_amcl.py",
        "golden/test_dwb.py",
        "golden/test_followers.py",
        "golden/test_mppi.py",
        "golden/test_nav2_layers.py",
        "golden/test_nav2_planners.py",
        "golden/test_nav2_safety.py",
        "golden/test_smac.py",
        "gym/test_levels.py",
        "gym/test_local_control.py",
        "gym/test_parallel.py",
        "gym/test_sb3.py",
        "gym/test_stack.py",
        "local_planner/test_cars.py",
        "local_planner/test_dwb.py",
        "local_planner/test_escape.py",
        "local_planner/test_followers.py",
        "local_planner/test_mppi.py",
        "local_planner/test_overlap.py",
        "local_planner/test_policy.py",
        "local_planner/test_velocity_sequences.py",
        "localization/test_ekf.py",
        "localization/test_inputs.py",
        "localization/test_lost.py",
        "localization/test_scan_matcher.py",
        "localization/test_scan_search.py",
        "logs/test_mapping.py",
        "move_base/test_occupied_cell.py",
        "properties/test_dwb.py",
        "properties/test_global_planner.py",
        "properties/test_global_planner_replanning.py",
        "properties/test_local_planner.py",
        "safety/test_chain.py",
        "safety/test_monitor.py",
        "safety/test_near_beams.py",
        "safety/test_run.py",
        "safety/test_velocity_smoother.py",
        "scenario/test_cars.py",
        "scenario/test_random_scenarios.py",
        "sim/test_camera.py",
        "sim/test_crowd.py",
        "sim/test_estimation.py",
        "sim/test_movers.py",
        "sim/test_orca.py",
        "sim/test_shapes_in_scenarios.py",
        "sim/test_sonar_stack.py",
    ]
)
"""Files of tests that compile kernels which the default robot does not use, two minutes of them: they count as slow."""
COMPILING_PLUGINS = re.compile(
    r"Test\w+_(amcl|ConstraintCritic|CostCritic|ObstacleFootprint|PathAlignCritic|constrained|dwb|ekf|graceful|mppi|nav2_\w+|policy|"
    r"plugin_container|regulated_pure_pursuit|rotation_shim|savitzky_golay|scan_matching|smac_\w+)"
)
"""Contract suites of plugins that do so."""
DEFAULT_KERNELS = ("astar", "dwa", "global_planner", "navfn", "trajectory_rollout")
"""The kernels that the other tests use."""


SAMPLED = 8
"""Cases of a `sampled` test that CI runs, evenly spaced, where the mark gives no count; the others are marked `exhaustive`."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by their folders, and skip those that need real programs unless they are wanted, as in CI."""
    tests = Path(__file__).parent
    families: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sampled"):
            families.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in families.values():
        mark = cases[0].get_closest_marker("sampled")
        count = int(mark.args[0]) if mark is not None and mark.args else SAMPLED
        kept = {round(i * (len(cases) - 1) / (count - 1)) for i in range(count)}
        for number, item in enumerate(cases):
            if number not in kept:
                item.add_marker(pytest.mark.exhaustive)
    for item in items:
        if not item.path.is_relative_to(tests):
            continue
        file = item.path.relative_to(tests)
        if file.as_posix() in COMPILING_FILES or COMPILING_PLUGINS.search(item.nodeid):
            item.add_marker(pytest.mark.slow)
        variable = CI_PARTS.get(file.parts[0])
        if variable is not None:
            item.add_marker(pytest.mark.real)
        if variable is not None and os.environ.get(variable) != "1":
            item.add_marker(pytest.mark.skip(reason=f"needs installed programs: set {variable}=1, as CI does"))


def _folder(variable: str, default: Path) -> Path:
    return Path(os.environ.get(variable) or default)


def _golden() -> Path:
    """NAVSTACK_GOLDEN, else the whole set next to the repository, else the part in the repository."""
    whole = _folder("NAVSTACK_GOLDEN", SHARED / "golden")
    return whole if whole.is_dir() else GOLDEN_PART


@pytest.fixture(scope="session")
def golden_dir() -> Path:
    """The folder of the golden data (outputs of the C++ stack)."""
    return _golden()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of foreign maps, parameters and problems; skips if it is absent."""
    folder = _folder("NAVSTACK_DATA", SHARED / "data")
    if not folder.is_dir():
        pytest.skip("no foreign data: set NAVSTACK_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def reference_dir() -> Path:
    """The folder of reference pages about the ROS stack; skips if it is absent."""
    folder = _folder("NAVSTACK_REFERENCE", SHARED / "reference")
    if not folder.is_dir():
        pytest.skip("no reference pages: set NAVSTACK_REFERENCE to their folder")
    return folder


def golden_files(pattern: str) -> list[Path]:
    """Golden cases by name pattern, for parametrize."""
    return sorted(_golden().glob(pattern))


def golden_ros1_files(pattern: str) -> list[Path]:
    """Golden cases of ROS 1's localization and trajectory rollout by name pattern; empty if the folder is absent."""
    return sorted(_folder("NAVSTACK_GOLDEN_ROS1", SHARED / "golden_ros1").glob(pattern))


def data_files(pattern: str) -> list[Path]:
    """Foreign data by name pattern, for parametrize; empty if the folder is absent."""
    return sorted(_folder("NAVSTACK_DATA", SHARED / "data").glob(pattern))


def golden_nav2_files(pattern: str) -> list[Path]:
    """Golden cases of Nav2 by name pattern, for parametrize; empty if the folder is absent."""
    return sorted(_folder("NAVSTACK_GOLDEN_NAV2", SHARED / "golden_nav2").glob(pattern))
