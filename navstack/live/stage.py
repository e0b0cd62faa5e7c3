"""What a server shows: one session, or two with the same world and clock and different parameters (`--versus`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navstack.core.errors import InputError, NavError, OutputError
from navstack.core.files import ensure_directory, write_text
from navstack.explain import PassageReport
from navstack.live import answers, messages, parameters
from navstack.live.own_files import OwnFiles
from navstack.live.session import Session, Twin
from navstack.scenario.file.writer import scenario_text

_INTERACTIONS = frozenset({"goal", "queue", "cancel", "put", "remove", "place", "drive", "clear_costmaps", "wait"})
_TIME = frozenset({"pause", "step", "speed", "seek", "restart"})


LEAD_S = 0.05
"""A session begins no cycle more than this ahead of another one (simulated s)."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the user of the command decided."""

    save_to: Path | None = None
    """The only folder that is written to; None: nothing can be saved."""
    fixed: bool = False
    """A recorded run is shown: only the time can be changed."""
    labels: tuple[str, ...] = ("",)
    """Names of the sessions."""
    named: tuple[tuple[str, ...], ...] = ()
    """Parameters of each robot that the command line names: a page may switch to them."""


class Stage:
    """Carries out requests. Knows nothing of the web."""

    def __init__(self, sessions: Sequence[Session], options: Options) -> None:
        self.sessions = tuple(sessions)
        self.options = options
        self._own = OwnFiles(options.named, options.save_to)
        self._passages: tuple[Any, PassageReport] | None = None

    @property
    def main(self) -> Session:
        """The first session."""
        return self.sessions[0]

    def advance(self, elapsed_s: float, *, budget_s: float, timer: Callable[[], float]) -> bool:
        """Advances all sessions; with two, the one that is behind comes first, so that both show the same time."""
        moved = False
        share = budget_s / len(self.sessions)
        for session in sorted(self.sessions, key=lambda s: s.time):
            others = [s.time for s in self.sessions if s is not session and not s.is_done]
            limit = min(others, default=math.inf) + LEAD_S
            moved |= session.advance(elapsed_s, budget_s=share, timer=timer, limit=limit)
        return moved

    def request(self, request: Any) -> messages.Answer:
        """Carries out a request at once, except those of `is_slow`. Raises NavError."""
        kind = request.type
        if self.options.fixed and kind not in messages.READ_ONLY | messages.TIME:
            raise InputError("this is a recorded run: only the time can be changed; open its scenario to take part")
        match request:
            case messages.Set():
                text, data = self._set(request)
            case messages.ExplainCell():
                session = self._session_of(request)
                text, data = answers.why_cell(session, request.x, request.y, request.costmap), None
            case messages.Parameters():
                text, data = "", parameters.parameter_list(self._session_of(request))
            case messages.Difference():
                text, data = parameters.difference(self._session_of(request)), None
            case messages.Save():
                text, data = self._save(request)
            case _ if kind in _TIME:
                text, data = self._time(request)
            case _ if kind in _INTERACTIONS:
                text, data = self._interact(request)
            case _:
                raise InputError(f"{kind} is not possible here")
        return messages.Answer(id=request.id, ok=True, text=text, data=data)

    @staticmethod
    def is_slow(request: Any) -> bool:
        """True for requests whose answer is computed beside the session (`prepare_slow`)."""
        return request.type in ("explain_command", "explain_goal", "explain_passage", "sets") or (
            request.type == "save" and request.what == "run"
        )

    def prepare_slow(self, request: Any) -> Callable[[], messages.Answer]:
        """Returns a function that computes the answer without touching the session: call it in another thread."""
        if request.type == "sets":
            return lambda: messages.Answer(id=request.id, ok=True, data=self._own.names())
        twin = self._session_of(request).twin()
        if request.type == "explain_passage":
            return lambda: self._answer(request, self._why_passage(twin, request))
        if request.type == "save":
            folder = self._target(request.name)
            return lambda: self._answer(request, _save_run(twin, folder))

        def explain() -> messages.Answer:
            if request.type == "explain_goal":
                record, goal_id = twin.record_for_goal(request.number)
                return self._answer(request, answers.what_happened(record, request.number, goal_id))
            time = twin.until if request.time is None else request.time
            record = twin.record_for_command(time)
            if request.sample is not None:
                return self._answer(request, answers.why_sample(record, time, request.sample))
            return self._answer(request, answers.why_command(record, time))

        return explain

    def _session_of(self, request: Any) -> Session:
        """The session that a request is about."""
        if request.side >= len(self.sessions):
            raise InputError("there is only one robot; start with --versus PARAMS for a second one")
        return self.sessions[request.side]

    # --- handlers ---------------------------------------------------------------------------------------------------

    def _interact(self, request: Any) -> tuple[str, Any]:
        """Does the same in all sessions, or in none."""
        action = request.model_dump(mode="python", exclude={"id", "type"}, exclude_none=True)
        action["kind"] = request.type
        if request.type == "put":
            action["shape"] = request.shape
        if request.type == "goal":
            action["pose"] = list(request.pose)
        done: list[Session] = []
        for session in self.sessions:
            try:
                session.interact({**action, "kind": _teleop_of(session)} if request.type == "drive" else action)
            except (NavError, ValueError):
                if done:
                    raise InputError("refused in one of the two worlds; the other one has changed") from None
                raise
            done.append(session)
        return "", None

    def _set(self, request: messages.Set) -> tuple[str, Any]:
        if not request.values and request.params is None:
            raise InputError("nothing is set; give values or a parameter set")
        session = self._session_of(request)
        action: dict[str, Any] = {"kind": "set", "values": dict(request.values)}
        if request.params is None:
            parameters.check_names(session, request.values)
        else:
            action["params"] = [self._own.load(request.params)]
        session.interact(action)
        return "", parameters.parameter_list(session)

    def _time(self, request: Any) -> tuple[str, Any]:
        for session in self.sessions:
            match request.type:
                case "pause":
                    session.pause(request.paused)
                case "step":
                    session.step_once()
                case "speed":
                    session.set_speed(request.factor)
                case "seek":
                    session.seek(request.time)
                case _:
                    session.restart()
        return "", None

    def _save(self, request: messages.Save) -> tuple[str, Any]:
        target, session = self._target(request.name), self._session_of(request)
        match request.what:
            case "scenario":
                path = target.with_name(f"{target.name}.yaml")
                session.save_scenario(path)
                return f"saved {path}; run it with: navstack simulate {path}", str(path)
            case "parameters" if request.in_place:
                changed = parameters.save_in_place(session, target.parent)
                names = ", ".join(str(path) for path in changed)
                return (f"changed {names}" if changed else "your files have these values already"), names
            case "parameters":
                sources = parameters.rewritten(session).save(target)
                arguments = " ".join(f"--params {source}" for source in sources)
                return f"saved {target}; use it with: {arguments}", str(target)
            case _:
                return _save_places(target, request)

    def _target(self, name: str) -> Path:
        folder = self.options.save_to
        if folder is None:
            raise OutputError("nothing can be saved: the session was started without --save-to DIR")
        ensure_directory(folder)
        target = folder / name
        if target.resolve().parent != folder.resolve():
            raise OutputError(f'"{name}" is not a plain name; files are saved into {folder} only')
        return target

    def _why_passage(self, twin: Twin, request: messages.ExplainPassage) -> str:
        configuration = twin.configuration
        if self._passages is None or self._passages[0] is not configuration:
            self._passages = configuration, answers.passages_of(twin.configuration, twin.scenario.map)
        name = str(twin.scenario.names.get("map", "the map"))
        return answers.why_passage(self._passages[1], name, request.x, request.y)

    @staticmethod
    def _answer(request: Any, text: str) -> messages.Answer:
        return messages.Answer(id=request.id, ok=True, text=text)


def _teleop_of(session: Session) -> str:
    """How a person drives: through multiplexer and monitor where there are any; otherwise directly, also during a goal."""
    return "drive" if session.run.move_base.chain is None else "teleop"


def _save_run(twin: Twin, folder: Path) -> str:
    """Writes the record of the session, and its scenario, which gives the same record."""
    scenario = twin.save_scenario(folder.with_name(f"{folder.name}.yaml"))
    recorder = twin.recorded()
    recorder.set_scenario(scenario.as_dict())
    recorder.save(folder)
    return f"saved {folder}; look at it with: navstack explain goal {folder}"


def _save_places(target: Path, request: messages.Save) -> tuple[str, Any]:
    if not request.places:
        raise InputError("there are no goals to save; add some with shift")
    poses = {name: list(pose) for name, pose in request.places.items()}
    if request.what == "places":
        path = target.with_name(f"{target.name}.places.yaml")
        write_text(path, scenario_text({"places": poses}))
        return f"saved {path}", str(path)
    path = target.with_name(f"{target.name}.yaml")
    write_text(path, scenario_text({"places": poses, "tour": {"places": list(poses)}}))
    return f"saved {path}", str(path)
