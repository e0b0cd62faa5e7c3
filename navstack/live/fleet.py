"""A running fleet: one robot of it is shown with everything, and takes goals; the others drive around it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from navstack.core import InputError, Pose2D
from navstack.fleet import Fleet, FleetRun, MemberRun
from navstack.live.checkpoints import Twin
from navstack.live.session import History, Session


class FleetSession(Session):
    """The session of a fleet; `run` is that of the selected robot. Going back in time simulates the fleet again."""

    def __init__(self, fleet: Fleet, *, robot: str | None = None, speed: float | None = 1.0) -> None:
        """`robot`: the one that is selected first. Raises InputError for an unknown one."""
        self.fleet = fleet
        self._members = {member.name: member for member in fleet.sorted_robots}
        self._done: dict[str, list[Any]] = {name: [] for name in self._members}
        self.selected = self._checked(next(iter(self._members)) if robot is None else robot)
        super().__init__(self._members[self.selected].scenario, speed=speed)

    def _checked(self, name: str) -> str:
        if name not in self._members:
            raise InputError(f'there is no robot "{name}"; robots: {", ".join(self._members)}', robot=name)
        return name

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the robots."""
        return tuple(self._members)

    def others(self) -> list[tuple[str, Pose2D, str]]:
        """Return the other robots: name, pose and what each waits for."""
        return [
            (name, run.robot.pose, run.wait_reason) for name, run in self.together.runs.items() if name != self.selected
        ]

    def select(self, name: str) -> None:
        """Show another robot, which then takes the goals. Raises InputError for an unknown one."""
        if name == self.selected:
            return
        self._done[self.selected] = self.interactions
        self.selected = self._checked(name)
        self.scenario = replace(self._members[name].scenario, interactions=())
        self.interactions = self._done[name]
        self._look()
        self.restarts += 1  # every page begins anew
        self.changes += 1

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self.together.time

    @property
    def is_done(self) -> bool:
        """True when all robots are done."""
        return self.together.done

    def interact(self, action: dict[str, Any]) -> Any:
        """Carry out an interaction of the selected robot now, see `Session.interact`."""
        self.together.catch_up(self._member)
        item = super().interact(action)
        self.together.reschedule(self._member)
        return item

    def restart(self) -> None:
        """Begin again without any interaction."""
        for done in self._done.values():
            done.clear()
        super().restart()

    def twin(self) -> Twin:
        """Raise InputError: what is simulated again apart from the session are records of single robots."""
        raise InputError(
            "this is not possible with a fleet; record it with navstack simulate, and explain or save the record of the robot"
        )

    # --- inside -----------------------------------------------------------------------------------------------------

    def _start(self) -> None:
        self._done[self.selected] = self.interactions
        robots = tuple(
            replace(member, scenario=replace(member.scenario, interactions=tuple(self._done[name])))
            for name, member in self._members.items()
        )
        self.together = FleetRun(replace(self.fleet, robots=robots), record=False, measure=False)
        self._histories = {name: History() for name in self._members}
        for name, run in self.together.runs.items():
            run.move_base.listeners.append(self._histories[name])
        self._look()
        self._begin()

    def _look(self) -> None:
        """Show the selected robot."""
        self.run = self._member = self.together.runs[self.selected]
        self.history = self._histories[self.selected]

    def _step(self) -> bool:
        before, seen = self.time, {name: run.cycles for name, run in self.together.runs.items()}
        while self.together.step():
            for name, run in self.together.runs.items():
                if run.cycles != seen[name]:
                    seen[name] = run.cycles
                    self.cycles += 1
                    self._histories[name].add(run)
            if self.time > before:
                if self._member.is_idle:
                    self.together.catch_up(self._member)  # it still sees the others
                self.end = max(self.end, self.time)
                return True
        return False

    _member: MemberRun
