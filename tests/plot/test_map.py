"""The picture of a map."""

from __future__ import annotations

import json

import pytest
from matplotlib.figure import Figure

import navstack as nav
from navstack.cli.app import run
from navstack.plot import plot_map


def test_a_map_shows_its_places_and_coordinates() -> None:
    places = nav.load_places("office").places
    axes = plot_map(nav.load_map(nav.map_path("office")), places=places, ax=Figure().subplots())
    assert set(places) <= {text.get_text() for text in axes.texts}
    assert axes.get_xlabel() == "x (m)"
    assert axes.xaxis.get_gridlines()[0].get_visible()


@pytest.mark.slow
def test_the_command_draws_maps_by_name_and_by_file(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["plot", "maze", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"files": {"picture": "maze.png"}}
    assert run(["plot", str(nav.map_path("office")), "--out", "o.svg"]) == 0
    assert "goal" in (tmp_path / "o.svg").read_text() or (tmp_path / "o.svg").stat().st_size > 10_000
    assert (tmp_path / "maze.png").exists()


def test_a_map_has_no_animation(capsys) -> None:
    assert run(["plot", "maze", "--animate"]) == 2
    assert "recorded run" in capsys.readouterr().err
