from __future__ import annotations

import itertools

import numpy as np
import pytest

from navstack.plot import colors
from tests.plot.colorblind import VISION, difference, lab

LINES = {"driven path": colors.DRIVEN, "plan": colors.PLAN, "start": colors.START, "goal": colors.GOAL}
MARKS = {"start": colors.START, "goal": colors.GOAL, "recovery": colors.RECOVERY, "collision": colors.COLLISION}
BANDS = {
    "free": colors.FREE_RGB,
    "inflated": colors.HIGH_RGB,
    "inscribed": colors.INSCRIBED_RGB,
    "lethal": colors.LETHAL_RGB,
    "unknown": colors.UNKNOWN_RGB,
}


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("group", [LINES, MARKS, BANDS], ids=["lines", "marks", "bands"])
def test_told_apart_at_a_glance(group, vision):
    for (a, one), (b, other) in itertools.combinations(group.items(), 2):
        assert difference(one, other, vision) > 12.0, f"{a} and {b} look alike with {vision}"


@pytest.mark.parametrize("vision", VISION)
def test_paths_stand_out_from_where_a_robot_can_be(vision):
    for band in ("free", "inflated", "unknown"):
        for name, color in LINES.items():
            assert difference(BANDS[band], color, vision) > 25.0, f"{name} on {band} with {vision}"


def test_plans_side_by_side(vision="deuteranopia"):
    for a, b in itertools.combinations(colors.PLANS, 2):
        assert difference(a, b, vision) > 12.0


def test_the_ramp_darkens_with_every_cost_band():
    table = colors.cost_colors()
    lightness = np.array([lab(tuple(int(v) for v in rgb))[0] for rgb in table[:255]])
    assert (np.diff(lightness) <= 1e-9).all()
    assert lightness[0] - lightness[1] > 3.0  # where inflation begins is seen
    assert lightness[252] - lightness[253] > 10.0  # and where it ends
    assert lightness[253] - lightness[254] > 10.0


def test_cells_are_painted_by_value():
    costs = np.array([[0, 253], [254, 255]], np.uint8)
    assert colors.paint_costs(costs).tolist() == [
        [list(colors.FREE_RGB), list(colors.INSCRIBED_RGB)],
        [list(colors.LETHAL_RGB), list(colors.UNKNOWN_RGB)],
    ]
    cells = np.array([[0, 100], [-1, 50]], np.int8)
    painted = colors.paint_occupancy(cells)
    assert painted[0].tolist() == [list(colors.FREE_RGB), list(colors.LETHAL_RGB)]
    assert painted[1, 0].tolist() == list(colors.UNKNOWN_RGB)
    assert colors.LETHAL_RGB[0] < painted[1, 1, 0] < 255


def test_the_palette_has_room_for_shades():
    assert len(colors.exact_colors()) < 200
