"""Every function that draws accepts and returns matplotlib axes, and draws into a figure that notebooks display."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import navstack as nav
from navstack import explain, plot
from navstack.core import InputError
from navstack.parameters import load_configuration
from navstack.plot.benchmarks import plot_pairs, plot_success, plot_times
from navstack.record import Record
from tests.explain.conftest import scenario

WORLDS = [{"world": 1, "optimal_time_s": 5.0, "runs": 2, "success": 1, "collision": 1, "other": 0, "time_s": 12.0}]
PANELS = {"goals": 4, "inflation": 1}


@pytest.fixture(scope="module")
def record() -> Record:
    recorder = nav.run_scenario(scenario()).recorder
    assert recorder is not None
    return recorder.record()


@pytest.fixture(scope="module")
def drawings(record: Record) -> dict[str, Callable[..., Any]]:
    configuration = load_configuration(["turtlebot"])
    grid, places = nav.load_map(nav.map_path("office")), nav.load_places("office")
    found = nav.plan_on_map(configuration, grid, places.start, places.goals[0])
    command, goals = explain.explain_command(record, 2.0), explain.explain_goals(record)
    passages = explain.find_passages(configuration, grid, narrowest=0.4, widest=0.6)
    curves = explain.inflation_curves(configuration)
    return {
        "map": lambda **to: plot.plot_map(grid, places=places.places, **to),
        "plan": lambda **to: plot.plot_plan(
            found.costmap.master, found.plan, start=places.start, goal=places.goals[0], **to
        ),
        "run": lambda **to: plot.plot_run(record, **to),
        "costmap": lambda **to: plot.plot_costmap_at(record, "local", 2.0, **to),
        "command": lambda **to: plot.plot_command(command, **to),
        "goals": lambda **to: plot.plot_goal_reports(goals, record=record, **to),
        "passages": lambda **to: plot.plot_passage_report(passages, name="office", **to),
        "inflation": lambda **to: plot.plot_inflation_curves(curves, **to),
        "states": lambda **to: plot.plot_states(**to),
        "pairs": lambda **to: plot_pairs([(10.0, 12.0), (9.0, None)], title="t", names=("a", "b"), **to),
        "success": lambda **to: plot_success(WORLDS, title="t", **to),
        "times": lambda **to: plot_times(WORLDS, title="t", **to),
    }


NAMES = [
    "map",
    "plan",
    "run",
    "costmap",
    "command",
    "goals",
    "passages",
    "inflation",
    "states",
    "pairs",
    "success",
    "times",
]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_picture_is_drawn_into_given_axes(drawings: dict[str, Callable[..., Any]], name: str) -> None:
    ax = Figure(figsize=(7.0, 5.0)).subplots()
    panels = drawings[name](ax=ax)
    if name in PANELS:
        assert len(panels) == PANELS[name]
        assert all(panel.figure is ax.figure for panel in panels)
    else:
        assert panels is ax
    out = io.BytesIO()
    ax.figure.savefig(out, format="png")
    assert len(out.getvalue()) > 5000


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_file_is_returned_and_not_mixed_with_axes(
    drawings: dict[str, Callable[..., Any]], name: str, tmp_path: Path
) -> None:
    file = tmp_path / "picture.png"
    assert drawings[name](path=file) == file
    assert file.stat().st_size > 5000
    with pytest.raises(InputError, match="ax="):
        drawings[name](path=file, ax=Figure().subplots())


def test_legends_have_no_entries_without_marks() -> None:
    lost = [{**WORLDS[0], "success": 0, "collision": 2, "cpp_outcome": "success", "cpp_time_s": 9.0}]
    for function, entries in ((plot_success, {"collision", "C++: success"}), (plot_times, {"C++, one run"})):
        axes = function(lost, title="t", ax=Figure().subplots())
        assert {text.get_text() for text in axes.get_legend().get_texts()} == entries


@pytest.mark.parametrize("name", ["goals", "inflation"])
def test_panels_can_be_given_one_by_one(drawings: dict[str, Callable[..., Any]], name: str) -> None:
    axes = list(np.ravel(Figure().subplots(PANELS[name], 1)))
    assert drawings[name](ax=axes) == axes
    with pytest.raises(InputError, match="panels"):
        drawings[name](ax=[*axes, *axes])


NOTEBOOK = """
import io
import matplotlib
matplotlib.use("agg")
import matplotlib.pyplot as plt
import navstack as nav
from navstack import plot

# what the inline backend does at the end of a cell: it shows every figure that pyplot has open, cut to its contents
places = nav.load_places("office")
for draw in (
    lambda: plot.plot_map(nav.load_map(nav.map_path("office")), places=places.places),
    plot.plot_states,
):
    axes = draw()
    (number,) = plt.get_fignums()
    assert plt.figure(number) is axes.figure
    out = io.BytesIO()
    axes.figure.canvas.print_figure(out, format="png", bbox_inches="tight")
    assert out.getvalue().startswith(b"\\x89PNG") and len(out.getvalue()) > 10000
    plt.close("all")
"""


@pytest.mark.slow
def test_a_picture_without_a_file_is_shown_by_notebooks(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-W", "error", "-c", NOTEBOOK], cwd=tmp_path, check=True)
