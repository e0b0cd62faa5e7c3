"""What a server shows: one session, or two with the same world and clock and different parameters (`--versus`)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from navstack import __version__
from navstack.behaviors import MOVE_KEYS, SPEED_KEYS, START_SPEED, START_TURN
from navstack.core import (
    InputError,
    NavError,
    OccupancyGrid,
    OutputError,
    Pose2D,
    compile_ahead,
    ensure_directory,
    is_dir,
    is_file,
    resolved,
    write_text,
)
from navstack.docking import DockDatabase
from navstack.explain import (
    CommandReport,
    PassageReport,
    Replay,
    SampleReport,
    explain_cell,
    explain_command,
    explain_goal,
    find_passages,
    print_cell,
    print_command,
    print_goal,
    print_passages,
)
from navstack.fleet import MemberRun
from navstack.live import messages, parameters
from navstack.live.cards import (
    Explanation,
    cell_cards,
    command_cards,
    fan_of,
    goal_cards,
    passage_cards,
    sample_cards,
)
from navstack.live.checkpoints import Twin
from navstack.live.graph import GraphEditor
from navstack.live.map_edits import edited_map
from navstack.live.messages import PROTOCOL, Frame
from navstack.live.session import Session
from navstack.live.view import has_camera
from navstack.map_io import map_names, save_map
from navstack.parameters import Configuration, Finding, load_configuration, packaged_sets
from navstack.record import Record
from navstack.scenario import advice_for_goal, load_places, read_step, scenario_text, step_data

# ----------------------------------------------------------------------------------------------------------------------
# Why: the texts of `navstack explain` about a running session.


WIDTH = 100
"""Columns of the texts, as in a terminal of this width."""
_FAILED = ("ABORTED", "REJECTED", "LOST")
NEAR_M = 2.0
"""A click this far from an opening still asks about it (m)."""


def why_cell(session: Session, x: float, y: float, costmap: str) -> Explanation:
    """Returns why the cell at a point of the map frame (m) has its cost in the `global` or `local` costmap now."""
    report = explain_cell(Replay(None, session.explained, session.time), x, y, costmap=costmap)
    return Explanation(_printed(print_cell, report), cell_cards(report))


def why_command(record: Record, time: float | None) -> Explanation:
    """Returns why the last command until `time` (s; default: now) was chosen."""
    report = explain_command(record, time)
    return Explanation(
        _printed(print_command, report), command_cards(report), fan_of(report, _robot_in(record, report))
    )


def why_sample(record: Record, time: float | None, sample: int) -> Explanation:
    """Returns the scores of one trajectory of a control cycle, or who rejected it and why."""
    report: CommandReport = explain_command(record, time)
    found = next((s for s in report.samples if s.index == sample), None)
    if found is None:
        raise InputError(f"the cycle at {report.time:.3f} s has no trajectory {sample}", sample=sample)
    fan = fan_of(report, _robot_in(record, report), sample)
    return Explanation(_sample_text(report, found), sample_cards(report, found), fan)


def _robot_in(record: Record, report: CommandReport) -> Pose2D:
    """Where the robot was in the map in the cycle of a report."""
    return Pose2D(*record.poses[record.index_at(report.time)].tolist())


def _sample_text(report: CommandReport, found: SampleReport) -> str:
    vx, vy, wz = found.velocity
    head = f"trajectory {found.index} at {report.time:.3f} s: vx {vx:.3f}, vy {vy:.3f}, wz {wz:.3f}"
    if found.rejected_by is not None:
        why = found.reason or "no reason given"
        ahead = found.collision.get("ahead_m")
        where = "" if ahead is None else f", {ahead:.2f} m ahead"
        return f"{head}\nrejected by {found.rejected_by}: {why}{where}\n\n{report.summary}"
    lines = [head, f"rank {found.rank} of {len(report.legal)}, total {found.total:.4g}"]
    width = max((len(name) for name in found.costs), default=0)
    for name, cost in found.costs.items():
        lines.append(f"  {name.ljust(width)}  {found.weighted[name]:.4g} (raw {cost:.4g})")
    if found.index == report.plan.best:
        lines.append("This one was chosen.")
    return "\n".join([*lines, "", report.summary])


def what_happened(
    record: Record, number: int, goal_id: str | None = None, findings: Sequence[Finding] = ()
) -> Explanation:
    """Returns the timeline of a goal (from 1), and what may explain its failure; `goal_id` as in `explain_goal`.

    `findings` are those about the parameters in force.
    """
    report = explain_goal(record, number, goal_id)
    causes = advice_for_goal(record, findings, failed=report.status in _FAILED)
    text = [_printed(print_goal, report), *(f"possible cause: {cause}" for cause in causes)]
    return Explanation("\n".join(text), goal_cards(report, causes))


def passages_of(configuration: Configuration, grid: OccupancyGrid) -> PassageReport:
    """Returns the passages of a map for these parameters."""
    return find_passages(configuration, grid, turning_radius=0.0)  # no search for ways: a page waits


def why_passage(report: PassageReport, name: str, x: float, y: float) -> Explanation:
    """Returns whether the robot passes the opening nearest to a point (m). Raises InputError if none is near."""
    distances = [(math.hypot(p.x - x, p.y - y), number) for number, p in enumerate(report.passages, 1)]
    nearest = min(distances, default=(math.inf, 0))
    if nearest[0] > NEAR_M:
        raise InputError(
            f"no opening between {report.narrowest:.2f} and {report.widest:.2f} m wide within {NEAR_M:g} m of "
            f"({x:.2f}, {y:.2f})"
        )
    text = io.StringIO()
    print_passages(_console(text), report, name, only=nearest[1])
    return Explanation(_trimmed(text), passage_cards(report, nearest[1]))


def _printed(print_report: Any, report: Any) -> str:
    text = io.StringIO()
    print_report(_console(text), report)
    return _trimmed(text)


def _console(text: io.StringIO) -> Any:
    from rich.console import Console

    return Console(file=text, width=WIDTH, highlight=False, soft_wrap=True, color_system=None)


def _trimmed(text: io.StringIO) -> str:
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines()).strip("\n")


# ----------------------------------------------------------------------------------------------------------------------
# The parameter sets that a page may switch to: packaged ones, those of the command line, those in the folder of `--save-to`.


MAX_FILES = 40
"""Most files of the folder that are looked at."""
_SUFFIXES = (".yaml", ".yml")


class OwnFiles:
    """Looks up sets by the names that a page shows. A page never names a path: a name is one of these, or it is refused."""

    def __init__(self, named: Sequence[Sequence[str]] = (), folder: Path | None = None) -> None:
        """`named` are the `--params` of each robot on the command line; `folder` is that of `--save-to`."""
        sources = {" + ".join(names): list(names) for names in named if names}
        self._named = {name: found for name, found in sources.items() if name not in packaged_sets()}
        self._folder = folder

    def names(self) -> dict[str, list[str]]:
        """Returns the names by where they come from: `packaged`, `named`, `folder`. Files that are no parameters are left out."""
        found = [name for name, path in self._in_folder().items() if _is_configuration(path)]
        return {"packaged": packaged_sets(), "named": list(self._named), "folder": found}

    def load(self, name: str) -> str | dict[str, Any]:
        """Returns a packaged set's name, or all parameters of the user's files as `SetParameters.params` takes them.

        Raises InputError for another name, ParameterError for files with errors.
        """
        if name in packaged_sets():
            return name
        sources = self._named.get(name)
        if sources is None:
            inside = self._in_folder()
            if name not in inside:
                known = ", ".join([*packaged_sets(), *self._named, *inside])
                raise InputError(f'"{name}" is not one of the sets of this session: {known}')
            sources = [str(inside[name])]
        return load_configuration(sources).tree.as_dict()

    def _in_folder(self) -> dict[str, Path]:
        """Files and folders that may be parameters, directly in the folder, by name; links that lead out of it are left out."""
        folder = self._folder
        if folder is None or not is_dir(folder):
            return {}
        inside = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        return {
            path.name: path
            for path in inside[:MAX_FILES]
            if resolved(path).parent == resolved(folder) and (_is_yaml(path) or _has_yaml(path))
        }


def _is_yaml(path: Path) -> bool:
    return path.suffix in _SUFFIXES and is_file(path)


def _has_yaml(path: Path) -> bool:
    return is_dir(path) and any(_is_yaml(inner) for inner in path.iterdir())


def _is_configuration(path: Path) -> bool:
    try:
        load_configuration([str(path)])
    except (NavError, OSError):
        return False
    return True


_INTERACTIONS = frozenset({"goal", "queue", "cancel", "put", "remove", "place", "drive", "clear_costmaps", "wait"})
_TIME = frozenset({"pause", "step", "speed", "seek", "restart"})


Report = Callable[[str, int, int], None]
"""Called with what is done, how much of it is done, and of how much (0: unknown). Raises to end it when the server ends."""
COMPILING = "compiling kernels, once per machine"
LEAD_S = 0.05
"""A session begins no cycle more than this ahead of another one (simulated s)."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the user of the command decided."""

    save_to: Path | None = None
    """The only folder that is written to; None: nothing can be saved."""
    fixed: bool = False
    """Only the time can be changed: a recorded run is shown, or a program steps the simulation."""
    labels: tuple[str, ...] = ("",)
    """Names of the sessions."""
    named: tuple[tuple[str, ...], ...] = ()
    """Parameters of each robot that the command line names: a page may switch to them."""
    graph: Path | None = None
    """Route graph to show and edit."""


class Stage:
    """Carries out requests. Knows nothing of the web."""

    def __init__(self, sessions: Sequence[Session], options: Options) -> None:
        self.sessions = tuple(sessions)
        self.options = options
        self._own = OwnFiles(options.named, options.save_to)
        self.graph = GraphEditor(options.graph, options.save_to)
        self._passages: tuple[Any, PassageReport] | None = None
        self.report: Report | None = None
        """Called with the progress of what takes long."""

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
            raise InputError(self.main.only_time)
        match request:
            case messages.Set():
                text, data = self._set(request)
            case messages.ExplainCell():
                why = why_cell(self._session_of(request), request.x, request.y, request.costmap)
                text, data = why, why.data
            case messages.Parameters():
                text, data = "", parameters.parameter_list(self._session_of(request))
            case messages.Difference():
                text, data = parameters.difference(self._session_of(request)), None
            case messages.Save():
                text, data = self._save(request)
            case messages.SelectRobot():
                self.main.select(request.name)
                text, data = "", None
            case messages.Graph():
                text, data = "", self.graph.data()
            case messages.CheckGraph():
                text, data = self.graph.check(self.main)
            case messages.SaveGraph():
                text, data = self.graph.save(request.name)
            case messages.DriveToNode():
                text, data = self._begin(self.graph.drive_step(request.node))
            case messages.StartStep():
                text, data = self._begin(step_data(read_step(request.step, places=self._places(), folder=None)))
            case _ if kind.startswith("graph_"):
                text, data = self.graph.edit(request, self.main)
            case _ if kind in _TIME:
                text, data = self._time(request)
            case _ if kind in _INTERACTIONS:
                text, data = self._interact(request)
            case _:
                raise InputError(f"{kind} is not possible here")
        return messages.Answer(id=request.id, ok=True, text=text, data=data)

    @staticmethod
    def is_slow(request: Any) -> bool:
        """True for requests whose answer is computed outside the session (`prepare_slow`)."""
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
                findings = twin.configuration.findings
                return self._answer(request, what_happened(record, request.number, goal_id, findings))
            time = twin.until if request.time is None else request.time
            record = twin.record_for_command(time)
            if request.sample is not None:
                return self._answer(request, why_sample(record, time, request.sample))
            return self._answer(request, why_command(record, time))

        return explain

    def _session_of(self, request: Any) -> Session:
        """The session that a request is about."""
        if request.side >= len(self.sessions):
            raise InputError("there is only one robot; start with --versus PARAMS for a second one")
        return self.sessions[request.side]

    # --- handlers ---------------------------------------------------------------------------------------------------

    def _places(self) -> dict[str, Pose2D]:
        return {name: Pose2D(*pose) for name, pose in _places(self.main.origin.map_file).items()}

    def _begin(self, step: dict[str, Any]) -> tuple[str, Any]:
        """Begins a step in all sessions."""
        self._in_all({"kind": "step", "step": step})
        return "", None

    def _interact(self, request: Any) -> tuple[str, Any]:
        action = request.model_dump(mode="python", exclude={"id", "type"}, exclude_none=True)
        action["kind"] = request.type
        if request.type == "put":
            action["shape"] = request.shape
        if request.type == "goal":
            action["pose"] = list(request.pose)
        self._in_all(action)
        return "", None

    def _in_all(self, action: dict[str, Any]) -> None:
        """Does the same in all sessions, or in none."""
        done: list[Session] = []
        for session in self.sessions:
            try:
                session.interact({**action, "kind": _teleop_of(session)} if action["kind"] == "drive" else action)
            except (NavError, ValueError):
                if done:
                    raise InputError("refused in one of the two worlds; the other one has changed") from None
                raise
            done.append(session)

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
        if request.params is not None:  # perhaps another planner
            self._compile_for(session)
        return "", parameters.parameter_list(session)

    def _compile_for(self, session: Session) -> None:
        """Compiles the kernels of the session's planners in parallel, before the next cycle compiles one after another."""
        report = self.report
        progress = None if report is None else partial(report, COMPILING)
        compile_ahead(session.run.interventions.configuration.planner_names, progress)

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
            case "map":
                grid = edited_map(session.scenario.map, session.shapes, request.erased)
                path, _ = save_map(grid, target.with_name(f"{target.name}.yaml"))
                return f"saved {path}; open it with: navstack live {path}", str(path)
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

    def _why_passage(self, twin: Twin, request: messages.ExplainPassage) -> Explanation:
        configuration = twin.configuration
        if self._passages is None or self._passages[0] is not configuration:
            self._passages = configuration, passages_of(twin.configuration, twin.scenario.map)
        name = str(twin.scenario.names.get("map", "the map"))
        return why_passage(self._passages[1], name, request.x, request.y)

    @staticmethod
    def _answer(request: Any, text: str) -> messages.Answer:
        data = text.data if isinstance(text, Explanation) else None
        return messages.Answer(id=request.id, ok=True, text=text, data=data)


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


# ----------------------------------------------------------------------------------------------------------------------
# A place to start on a map that names none.


def free_pose(grid: OccupancyGrid) -> tuple[float, float]:
    """Returns the position (m) with much space around it that is nearest to the middle of the free area.

    Raises InputError for a map without free cells.
    """
    from scipy.ndimage import distance_transform_edt  # slow import

    free = grid.data == 0
    if not free.any():
        raise InputError("the map has no free cell; give --start x,y")
    distance = np.asarray(distance_transform_edt(np.pad(free, 1)))[1:-1, 1:-1]
    enough = distance >= min(0.6 * float(distance.max()), 1.0 / grid.geometry.resolution)
    iy, ix = np.nonzero(enough)
    middle_y, middle_x = np.argwhere(free).mean(axis=0)
    best = int(np.argmin((iy - middle_y) ** 2 + (ix - middle_x) ** 2))
    u, v = (ix[best] + 0.5) * grid.geometry.resolution, (iy[best] + 0.5) * grid.geometry.resolution
    c, s = np.cos(grid.origin_yaw), np.sin(grid.origin_yaw)
    return float(grid.geometry.origin_x + c * u - s * v), float(grid.geometry.origin_y + s * u + c * v)


# ----------------------------------------------------------------------------------------------------------------------
# What does not change during a session, for a page that connects: map, robot, names, rights.


def world_frame(stage: Stage, *, server: str, read_only: bool) -> Frame:
    """Returns the first message to a page; `server` identifies this start of the server."""
    session = stage.main
    scenario, robot = session.scenario, session.run.robot
    grid = scenario.map
    frame = Frame({"type": "world"})
    limits = session.run.move_base.local_planner.limits
    frame.header |= {
        "protocol": PROTOCOL,
        "version": __version__,
        "server": server,
        "name": scenario.name or str(scenario.names.get("map", "map")),
        "map": {
            "nx": grid.geometry.nx,
            "ny": grid.geometry.ny,
            "resolution": grid.geometry.resolution,
            "origin": [grid.geometry.origin_x, grid.geometry.origin_y],
            "yaw": grid.origin_yaw,
            "blob": frame.blob(grid.data.astype(np.int8)),
        },
        "footprint": robot.footprint.vertices.tolist(),
        "padded": [s.run.move_base.local_costmap.footprint.vertices.tolist() for s in stage.sessions],
        "wheelbase": robot.params.wheelbase if robot.params.is_steered else None,
        "holonomic": robot.params.kinematics == "holonomic",
        "limits": {name: _finite(getattr(limits, name)) for name in limits._fields},
        "teleop": {"moves": MOVE_KEYS, "speeds": SPEED_KEYS, "speed": START_SPEED, "turn": START_TURN},
        "places": _places(session.origin.map_file),
        "graph": stage.graph.data() if stage.options.graph is not None else None,
        "docks": list(DockDatabase.of(session.scenario.configuration).docks),
        "labels": list(stage.options.labels),
        "robots": list(session.robots),
        "robot": session.run.name if isinstance(session.run, MemberRun) else None,
        "camera": has_camera(robot),
        "read_only": read_only,
        "fixed": stage.options.fixed,
        "rewinds": session.rewinds,
        "save_to": str(stage.options.save_to) if stage.options.save_to is not None else None,
    }
    return frame


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _places(map_file: Any) -> dict[str, list[float]]:
    if map_file is None:
        return {}
    name = map_file.stem
    source = name if name in map_names() else map_file.with_name(f"{name}.places.yaml")
    try:
        return {place: list(pose) for place, pose in load_places(source).places.items()}
    except (NavError, OSError):
        return {}
