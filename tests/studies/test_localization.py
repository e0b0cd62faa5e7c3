"""Tuning of amcl: over a log and over simulated drives, with its own search space and held-out cases."""

from __future__ import annotations

import itertools
import pickle
from pathlib import Path

import pytest

from navstack.core import InputError, LogError, Transform2D
from navstack.parameters import load_configuration
from navstack.studies.comparison import Case, compare_outcomes
from navstack.studies.pipeline import TuneRequest, run_tuning
from navstack.studies.search_space_parser import default_space
from navstack.studies.setup import SearchOptions, prepare
from navstack.studies.suites import read_suite
from tests.localization.rooms import rooms
from tests.logs.carmen_files import circle, write_corrected_log

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "drive.log"
    return write_corrected_log(path, rooms(), circle(Transform2D(1.0, 4.5, 0.2), 130))


def test_parts_of_a_log(log_file: Path, tmp_path: Path) -> None:
    suite = read_suite(str(log_file))
    assert suite.localizes
    assert suite.names == tuple(f"part {i}" for i in range(1, 9))
    assert suite.held_out == ("part 2", "part 4", "part 6", "part 8")
    # the even scans, in order and without a gap
    ends = [0, 8, 16, 24, 32, 41, 49, 57, 65]
    assert [(p.first, p.last) for p in suite.parts] == list(itertools.pairwise(ends))
    short = write_corrected_log(tmp_path / "short.log", rooms(), circle(Transform2D(1.0, 4.5, 0.2), 8))
    with pytest.raises(LogError, match="has 4 scans with a reference pose; tuning needs 32"):
        read_suite(str(short))


def test_the_space_of_amcl() -> None:
    written = load_configuration(["turtlebot", {"amcl": {}}])
    names = {d.name for d in default_space(written, "localization")}
    assert {"amcl/laser_sigma_hit", "amcl/odom_alpha1", "amcl/laser_model_type"} <= names
    assert all(name.startswith("amcl/") for name in names)
    assert len(default_space(load_configuration(["turtlebot"]), "localization")) == 0


def test_a_tuning_over_a_log(log_file: Path, tmp_path: Path) -> None:
    """Noise that no wheel has: less of it is found, and is written as a section amcl."""
    options = SearchOptions(
        ("turtlebot",),
        str(log_file),
        param=("amcl/odom_alpha3=0.01:3.0:log", "amcl/odom_alpha1=0.01:3.0:log"),
        overrides=("amcl/odom_alpha3=3.0", "amcl/odom_alpha1=3.0", "amcl/resample_interval=1", "amcl/update_min_d=0.1"),
    )
    request = TuneRequest(prepare(options), tmp_path / "out", trials=6, workers=1)
    output = run_tuning(request)
    assert output.tuning.held_out is not None
    assert {m.name for m in output.tuning.held_out.measures} >= {"score", "success"}
    assert output.tuning.found
    tuned = load_configuration(list(output.params)).localization.amcl
    assert tuned is not None
    assert min(tuned.odom_alpha3, tuned.odom_alpha1) < 3.0
    assert (tmp_path / "out" / "held_out.png").stat().st_size > 0


def test_a_simulated_drive_is_the_same_for_every_candidate() -> None:
    setup = prepare(SearchOptions(("turtlebot",), "localization", count=2))
    assert setup.names == setup.suite.names
    assert len(setup.suite.held_out) == 1
    evaluation = setup.evaluation(setup.names[:1])
    first, recorder = evaluation.outcome(evaluation.cases[0], setup.base)
    assert recorder is None
    assert first.success, first.text
    assert 0.0 < first.error_m < 0.5
    assert first.score == pytest.approx(1.0 - first.error_m / 0.5)
    # in another process, and again
    again, _ = pickle.loads(pickle.dumps(evaluation)).outcome(evaluation.cases[0], setup.base)
    assert again == first
    blind = load_configuration(["turtlebot", *setup.environment, {"amcl": {"laser_max_beams": 1}}])
    other, _ = evaluation.outcome(evaluation.cases[0], blind)
    assert other.length_m == first.length_m
    assert other.error_m > first.error_m


def test_an_error_is_compared_where_both_succeed() -> None:
    cases = [Case("a", 0), Case("b", 0)]
    good = {"success": True, "score": 0.8, "time_s": 0.0, "clearance_m": 0.0, "jerk": 0.0, "error_m": 0.1}
    better = {**good, "score": 0.9, "error_m": 0.05}
    comparison = compare_outcomes(cases, {c.key: good for c in cases}, {c.key: better for c in cases})
    assert [m.name for m in comparison.measures] == ["score", "success", "position error"]
    assert comparison.measure("position error").difference.interval.value == pytest.approx(-0.05)


def test_a_log_that_is_not_there() -> None:
    with pytest.raises((InputError, LogError)):
        read_suite("no_such.log.gz")
