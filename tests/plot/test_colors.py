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
def test_groups_are_distinguishable(group, vision):
    for (a, one), (b, other) in itertools.combinations(group.items(), 2):
        assert difference(one, other, vision) > 12.0, f"{a} and {b} look alike with {vision}"


@pytest.mark.parametrize("vision", VISION)
def test_paths_contrast_with_low_costs(vision):
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
    assert lightness[0] - lightness[1] > 3.0  # the edge of inflation is visible
    assert lightness[252] - lightness[253] > 10.0  # so is the inscribed band
    assert lightness[253] - lightness[254] > 10.0


def test_cells_are_painted_by_value():
    costs = np.array([[0, 253], [254, 255]], np.uint8)
    assert colors.COSTS(costs)[..., :3].tolist() == [
        [list(colors.FREE_RGB), list(colors.INSCRIBED_RGB)],
        [list(colors.LETHAL_RGB), list(colors.UNKNOWN_RGB)],
    ]
    assert (colors.COSTS(costs)[..., 3] == 255).all()
    assert colors.COSTS(costs, clear=0)[..., 3].tolist() == [[0, 255], [255, 255]]
    cells = np.array([[0, 100], [-1, 50]], np.int8)
    painted = colors.OCCUPANCY(cells)[..., :3]
    assert painted[0].tolist() == [list(colors.FREE_RGB), list(colors.LETHAL_RGB)]
    assert painted[1, 0].tolist() == list(colors.UNKNOWN_RGB)
    assert colors.LETHAL_RGB[0] < painted[1, 1, 0] < 255


def test_every_value_of_a_cell_has_its_color():
    costs = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(colors.COSTS(costs)[..., :3].reshape(-1, 3), colors.cost_colors())
    cells = np.arange(-128, 128).astype(np.int8).reshape(16, 16)
    painted = colors.OCCUPANCY(cells)[..., :3].reshape(-1, 3)
    assert (painted[:128] == colors.UNKNOWN_RGB).all()  # -1, and values that map_server never sends
    assert (np.diff(painted[128:229].astype(int), axis=0) <= 0).all()


def test_the_highest_rank_wins_a_shared_pixel():
    costs = np.zeros((7, 7), np.uint8)
    costs[0, 0], costs[1, 1], costs[4, 4], costs[6, 6] = 255, 7, 254, 255
    costs[3, 3] = 253
    blocks = colors.COSTS(costs, block=3)[..., :3]
    table = colors.cost_colors()
    assert blocks.shape == (3, 3, 3)
    assert blocks[0, 0].tolist() == table[7].tolist()
    assert blocks[1, 1].tolist() == table[254].tolist()
    assert blocks[2, 2].tolist() == table[255].tolist()
    assert blocks[0, 2].tolist() == table[0].tolist()


def test_the_palette_has_room_for_shades():
    assert len(colors.exact_colors()) < 200
