"""The refinement: the calibration of the odometry, and poses that the matches of their time left off."""

import numpy as np
import pytest

from navstack.core import Transform2D
from navstack.mapping import Mapper, MapperParams
from navstack.mapping.refinement import calibrate, refine
from tests.mapping.simulated import lap


def chained(steps: np.ndarray) -> np.ndarray:
    """Return the poses (n + 1, 3) along steps (n, 3)."""
    poses = [Transform2D()]
    for step in steps.tolist():
        poses.append(poses[-1] @ Transform2D(*step))
    return np.array(poses)


def test_systematic_errors_of_an_odometry_are_found_in_spite_of_slips() -> None:
    rng = np.random.default_rng(3)
    true = np.column_stack((rng.uniform(0.2, 0.4, 400), np.zeros(400), rng.normal(0.0, 0.3, 400)))
    # as `corrected` undoes it: distances 4 % too long, turns 3 % too small, a pull of 0.01 rad/m to the right
    told = true.copy()
    told[:, 0] /= 0.96
    told[:, 2] = (true[:, 2] - 0.01 * told[:, 0]) / 1.03
    told += rng.normal(0.0, [0.004, 0.002, 0.002], true.shape)
    told[::25, 0] += 0.3  # slips
    found = calibrate(told, chained(true), np.ones(400, np.bool_))
    assert found.scale == pytest.approx(0.96, abs=0.003)
    assert found.turn_scale == pytest.approx(1.03, abs=0.01)
    assert found.curve == pytest.approx(0.01, abs=0.003)
    # white noise of 4 mm; the slips and the arcs add to it
    assert 0.002 < found.noise[0] < 0.012
    corrected = found.corrected(told)
    assert np.median(np.abs(corrected - true)[:, 0]) < 0.005


def test_few_steps_do_not_calibrate() -> None:
    steps = np.full((5, 3), 0.1)
    found = calibrate(steps, chained(steps * 2.0), np.ones(5, np.bool_))
    assert found.steps == 0
    assert np.array_equal(found.corrected(steps), steps)


@pytest.mark.slow
def test_keyframes_that_are_off_come_back_to_the_truth() -> None:
    mapper = Mapper(MapperParams(refinement_passes=0))
    for frame, _ in lap()[:130]:
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan)
    mapper.finish()
    assert mapper.final_graph is None
    known = {frame.scan.stamp: pose for frame, pose in lap()}
    poses = [known[stamp] for stamp in mapper.keyframes.stamps]
    truth = np.array([poses[0].inverse() @ pose for pose in poses])
    off = truth.copy()
    off[20:, 0] += 0.12
    off[30:, 2] += 0.02
    odometry, matched = (np.array([getattr(step, name) for step in mapper.steps]) for name in ("odometry", "matched"))
    found = refine(off, lambda k: mapper.keyframes.surface(k, 30.0), odometry, matched, [], 2)
    assert np.hypot(*(found.poses - truth)[:, :2].T).max() < 0.04
    assert len(found.edges) > 2 * len(truth)
    # the odometry of the lap: 3 % too long, turns 2 % too large
    assert found.calibration.scale == pytest.approx(1.0 / 1.03, abs=0.01)
