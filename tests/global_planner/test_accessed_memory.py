"""A query in a corner of a huge map does not access the rest of the map, nor the rest of the planner's arrays.

The system call `mincore` reports which pages of a mapping have been read or written. The map is an anonymous mapping, whose
pages do not exist before the first access.
"""

from __future__ import annotations

import ctypes
import mmap
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import AStarPlanner, GlobalPlannerROS, NavfnROS, ThetaStarPlanner
from navstack.global_planner._search.cells import navfn_costs
from navstack.global_planner._search.propagation import propagate_navfn
from navstack.global_planner._search.wavefront import Wavefront
from navstack.plugins import GlobalPlanner

SIDE = 10_000  # 1e8 cells
START, GOAL = (60, 70), (180, 140)
CORNER = 600
"""Rows and columns that such a query may access, including the margin of its window."""


def accessed_pages(array: NDArray[Any]) -> NDArray[np.bool_]:
    """For each page of the memory of `array`: whether it was read or written."""
    libc = ctypes.CDLL(None, use_errno=True)
    first = array.ctypes.data // mmap.PAGESIZE * mmap.PAGESIZE
    length = array.ctypes.data + array.nbytes - first
    pages = np.zeros(-(-length // mmap.PAGESIZE), np.uint8)
    result = libc.mincore(ctypes.c_void_p(first), ctypes.c_size_t(length), ctypes.c_void_p(pages.ctypes.data))
    assert result == 0, ctypes.get_errno()
    return (pages & 1).astype(bool)


def test_pages_are_counted() -> None:
    """A read and a write of one byte are reported as one page each."""
    with mmap.mmap(-1, 64 * mmap.PAGESIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as memory:
        memory.madvise(mmap.MADV_NOHUGEPAGE)
        array = np.frombuffer(memory, np.uint8)
        assert not accessed_pages(array).any()
        assert array[5 * mmap.PAGESIZE + 7] == 0
        array[40 * mmap.PAGESIZE] = 1
        assert np.flatnonzero(accessed_pages(array)).tolist() == [5, 40]
        del array


@pytest.mark.parametrize(
    "planner",
    [NavfnROS(), GlobalPlannerROS(), AStarPlanner(), ThetaStarPlanner()],
    ids=["navfn", "global_planner", "astar", "theta_star"],
)
def test_the_rest_of_a_huge_map_is_not_accessed(planner: GlobalPlanner) -> None:
    memory = mmap.mmap(-1, SIDE * SIDE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    memory.madvise(mmap.MADV_NOHUGEPAGE)
    cells = np.frombuffer(memory, np.uint8)
    costmap = Costmap(GridGeometry(SIDE, SIDE, 0.05), cells.reshape(SIDE, SIDE))
    g = costmap.geometry
    for _ in range(2):  # the second time with allocated arrays and a cached plan
        plan = planner.make_plan(costmap, Pose2D(*g.cell_to_world(*START)), Pose2D(*g.cell_to_world(*GOAL)))
        assert plan.path.length > 5.0
    accessed = np.flatnonzero(accessed_pages(cells))
    assert 0 < accessed.size <= CORNER * 2  # a row of cells takes two and a half pages
    assert (accessed + 1).max() * mmap.PAGESIZE <= CORNER * SIDE


def test_the_rest_of_the_arrays_is_not_accessed() -> None:
    """With huge pages (2 MiB, 52 rows here) those that contain the rows of the corner are accessed."""
    wave = Wavefront()
    costmap = Costmap(GridGeometry(SIDE, SIDE, 0.05))
    propagate_navfn(wave, costmap, navfn_costs(True), root=START, target=GOAL)
    assert wave.potential_of(*GOAL) > 0.0
    assert accessed_pages(wave.pot).mean() < 1.1 * CORNER / SIDE
