"""Velocity smoother and collision monitor against tables of Nav2's own C++: `tables.npz`.

Equal to the last bit, but for the simulated motion, where the order of a sum may differ (1e-15).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Twist2D
from navstack.parameters import VelocitySmootherParams
from navstack.safety import VelocitySmoother, zones
from navstack.safety import approach as contact
from navstack.safety import velocity_smoother as smoother
from tests.conftest import golden_nav2_files

FILES = golden_nav2_files("tables*.npz")
pytestmark = [
    pytest.mark.skipif(not FILES, reason="no golden data of Nav2: set NAVSTACK_GOLDEN_NAV2 to their folder"),
    pytest.mark.parametrize("file", FILES or [Path()], ids=lambda f: f.name),
]
RATE_HZ = 20.0
RADIUS = 0.4
NO_CORNERS = np.empty((0, 2))


@cache
def tables(file: Path) -> dict[str, NDArray[Any]]:
    with np.load(file) as data:
        return {key: data[key] for key in data.files if key.startswith(("in/vs", "in/cm", "vs_", "cm_"))}


def test_share_of_a_change_that_the_accelerations_allow(file: Path) -> None:
    data = tables(file)
    rows = data["in/vs"]
    found = [smoother.eta_constraint(*row[:4].tolist(), RATE_HZ) for row in rows]
    np.testing.assert_array_equal(found, data["vs_eta"])


def test_velocity_after_a_step(file: Path) -> None:
    data = tables(file)
    found = [smoother.apply_constraints(*row[:4].tolist(), RATE_HZ, float(row[4])) for row in data["in/vs"]]
    np.testing.assert_array_equal(found, data["vs_applied"])


@pytest.mark.parametrize(
    ("number", "changes"),
    [(0, {}), (1, {"scale_velocities": True}), (2, {"deadband_velocity": [0.05, 0.05, 0.1]})],
    ids=["plain", "scaled", "deadband"],
)
def test_stream_of_commands(file: Path, number: int, changes: dict[str, Any]) -> None:
    data = tables(file)
    params = VelocitySmootherParams(
        max_velocity=[0.5, 0.3, 2.0],
        min_velocity=[-0.3, -0.3, -2.0],
        max_accel=[1.0, 0.8, 2.0],
        max_decel=[-1.5, -0.8, -3.0],
        nav2_compatible=True,
        **changes,
    )
    node = VelocitySmoother(params)
    for (t, arrives, *command), (published, *wanted) in zip(
        data["in/vs_stream"].tolist(), data[f"vs_stream_out{number}"].tolist(), strict=True
    ):
        if arrives:
            node.command(Twist2D(*command), t)
        step = node.step(t)
        assert (step is not None) == bool(published), t
        if step is not None:
            assert list(step.twist) == wanted, t


def test_points_in_a_polygon_and_a_circle(file: Path) -> None:
    data = tables(file)
    polygon = np.ascontiguousarray(data["in/cm_polygon"])
    points = data["in/cm_points"].tolist()
    found = [zones.in_shape(polygon, 0.0, x, y) for x, y in points]
    np.testing.assert_array_equal(found, data["cm_in_polygon"] != 0)
    found = [zones.in_shape(NO_CORNERS, RADIUS, x, y) for x, y in points]
    np.testing.assert_array_equal(found, data["cm_in_circle"] != 0)


@pytest.mark.parametrize("shape", ["polygon", "circle"])
def test_time_to_a_collision(file: Path, shape: str) -> None:
    data = tables(file)
    corners = np.ascontiguousarray(data["in/cm_polygon"]) if shape == "polygon" else NO_CORNERS
    points = data["in/cm_points"]
    wanted = data[f"cm_time_{shape}"]
    size = len(points) // len(wanted)
    for chunk, row in enumerate(wanted):
        some = points[chunk * size : (chunk + 1) * size]
        some = np.ascontiguousarray(some[np.hypot(some[:, 0], some[:, 1]) > 0.6])
        found = [
            contact.stepped_contact(some, corners, RADIUS, 2, velocity.copy(), 2.0, 0.1)
            for velocity in data["in/cm_velocities"]
        ]
        np.testing.assert_array_equal(found, row)


def test_simulated_motion(file: Path) -> None:
    data = tables(file)
    for (dt, *state), wanted in zip(data["in/cm_kinematics"].tolist(), data["cm_kinematics_out"], strict=True):
        pose, velocity = np.array(state[:3]), np.array(state[3:])
        contact.project_state(pose, velocity, dt)
        found = [*pose, *velocity, *contact.seen_from(pose, 0.7, -0.2)]
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-15)
