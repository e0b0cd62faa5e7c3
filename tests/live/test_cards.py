"""What the page shows of explanations: cards, and the trajectories on the map."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from navstack.live import messages
from navstack.live.session import Session
from navstack.live.stage import Options, Stage
from navstack.scenario import load_scenario

Advance = Callable[..., None]


def answer(session: Session, **request: object) -> messages.Answer:
    stage = Stage([session], Options())
    read = messages.read_request(json.dumps({"id": 1, **request}))
    made = stage.prepare_slow(read)() if stage.is_slow(read) else stage.request(read)
    return messages.Answer.model_validate_json(made.model_dump_json())  # as the page gets it


def shown(answer: messages.Answer) -> str:
    return json.dumps(answer.data["cards"], ensure_ascii=False)


@pytest.mark.slow
def test_a_command_has_cards_without_hints_for_the_command_line(session: Session, run_to: Advance) -> None:
    run_to(session, 5.0)
    made = answer(session, type="explain_command")
    cards = {card["title"].partition(":")[0]: card for card in made.data["cards"]}
    command, costs, table = cards["Command"], cards["Costs of the chosen trajectory"], cards["Trajectories"]
    assert dict(command["facts"])["planner"] == "DWAPlanner"
    assert costs["bars"][0][2] == 1.0 and all(0.0 < bar[2] <= 1.0 for bar in costs["bars"])
    assert [row[1] for row in table["samples"][:3]] == [1, 2, 3]
    assert "--all" in made.text and "--" not in shown(made)


@pytest.mark.slow
def test_the_fan_begins_at_the_robot_in_the_map(session: Session, run_to: Advance) -> None:
    run_to(session, 5.0)
    fan = answer(session, type="explain_command").data["fan"]
    robot = np.array(session.run.robot.pose[:2])
    starts = np.array([points[:2] for _, _, points in fan["rows"]])
    assert len(starts) > 10 and np.abs(starts - robot).max() < 0.2
    best = next(points for sample, _, points in fan["rows"] if sample == fan["best"])
    assert best[-2] > robot[0] + 0.3  # it drives along the corridor
    asked = answer(session, type="explain_command", sample=fan["rows"][3][0]).data
    assert asked["fan"]["sample"] == fan["rows"][3][0] and "total cost" in asked["cards"][0]["title"].lower()


@pytest.mark.slow
def test_goals_cells_and_openings_have_cards(session: Session, run_to: Advance) -> None:
    run_to(session)
    goal = answer(session, type="explain_goal", number=1)
    assert goal.data["cards"][0]["tone"] == "good" and goal.data["cards"][1]["lines"][-1][2] == "good"
    cell = answer(session, type="explain_cell", x=3.5, y=8.45)
    assert cell.data["cards"][0]["cost"] > 0 and "Layers" in shown(cell)
    opening = answer(session, type="explain_passage", x=6.9, y=8.4)
    assert opening.data["cards"][0]["tone"] in ("good", "warn", "bad") and "minimum" in shown(opening)
    assert "--" not in shown(goal) + shown(cell) + shown(opening)


@pytest.mark.parametrize(("distro", "explained"), [("noetic", True), ("indigo", False)])
def test_the_card_of_a_failed_goal_names_possible_causes(
    tmp_path: Path, run_to: Advance, distro: str, explained: bool
) -> None:
    """The weights of the packaged robot suit the scoring of indigo."""
    file = tmp_path / "corridor.yaml"
    file.write_text(
        f"map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[4.8, 7.45, 0.0]]\ntime_limit: 0.5\ndistro: {distro}\n"
    )
    session = Session(load_scenario(file))
    run_to(session)
    goal = answer(session, type="explain_goal", number=1)
    causes = [card for card in goal.data["cards"] if card["title"] == "Possible causes"]
    assert goal.data["cards"][0]["tone"] == "bad"
    assert bool(causes) is explained
    assert ("possible cause: " in goal.text) is explained
    for (card,) in [causes] if causes else []:
        text = card["lines"][0][1]
        assert text.startswith("turtlebot/dwa_local_planner_params.yaml:")  # the name of a file is not a sentence
        assert "set navstack/ros_distro to indigo" in text
