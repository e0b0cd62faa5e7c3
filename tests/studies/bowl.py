"""An evaluation without simulation: the score decreases with the distance from an optimum, which differs by case."""

from __future__ import annotations

import math
import os
import signal
from pathlib import Path

from navstack.parameters import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.studies.comparison import Case
from navstack.studies.evaluation import Evaluation, RunOutcome
from navstack.studies.problem import Problem, select_objectives
from navstack.studies.search_space import SearchSpace
from navstack.studies.search_space_parser import parse_search_space

PARAMS = (
    "DWAPlannerROS/sim_time=0.5:4.0",
    "DWAPlannerROS/occdist_scale=0.001:1.0:log",
    "DWAPlannerROS/vx_samples=3:12",
)


class Bowl(Evaluation):
    """Optimum at sim_time 2.0 + 0.05 per case, occdist_scale 0.05; fails far from it."""

    failed_score = -1.0
    best_score = 1.0

    def __init__(self, cases: int = 4, *, suicide: Path | None = None, after: int = 0, hopeless: bool = False) -> None:
        super().__init__("bowl", [Case(f"case {i}", 0) for i in range(cases)])
        self.suicide = suicide
        """A file that counts the runs; the process is killed once, at run `after`."""
        self.after = after
        self.hopeless = hopeless

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        if self.suicide is not None:
            with self.suicide.open("a") as file:
                file.write(f"{case.key}\n")
            if len(self.suicide.read_text().splitlines()) == self.after:
                os.kill(os.getpid(), signal.SIGKILL)
        p = configuration.local_planner.params
        off = (p.sim_time - 2.0 - 0.05 * int(case.name.split()[1])) ** 2 + 0.1 * math.log(p.occdist_scale / 0.05) ** 2
        success = off < 1.5 and not self.hopeless
        score = math.exp(-off) if success else -1.0
        return RunOutcome(
            success, "success" if success else "timeout", score, 5.0 + off, 3.0, 0.3 / p.sim_time, off, 0
        ), None


def problem(
    evaluation: Evaluation | None = None, *, objectives: tuple[str, ...] = (), sim_time: float = 0.6
) -> Problem:
    base = load_configuration(["turtlebot"], overrides=[f"DWAPlannerROS/sim_time={sim_time}"])
    return Problem(base, space(base), evaluation or Bowl(), select_objectives(objectives))


def space(base: Configuration) -> SearchSpace:
    return parse_search_space(base, params=PARAMS)
