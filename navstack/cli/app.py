"""The `navstack` command: its subcommands, and how errors become messages and exit codes.

Exit codes: 0 success; 1 a goal failed or a success condition was not met; 2 invalid input; 70 internal error;
130 interrupted.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import json
import os
import sys
import time
from typing import Annotated, Any, Final

import typer
import typer.main

from navstack import _interrupts
from navstack.cli import interrupts as internal_error
from navstack.cli.interrupts import raised_terminations
from navstack.cli.lazy_group import NEGATIVE_NUMBERS, LazyCommand, group_of

EXIT_GOAL_FAILED = 1
EXIT_WRONG_INPUT = 2
EXIT_INTERRUPTED = 130
_GLOBAL: Final = frozenset({"-v", "--verbose", "-q", "--quiet", "--debug"})
DEBUG_VARIABLE: Final = "NAVSTACK_DEBUG"
_CODE, _NAME = 9001, "INVALID_INPUT"
_LONGEST_NAME: Final = 200
"""Longest file name that a message quotes in full (characters)."""

COMMANDS: Final = {
    "plan": LazyCommand("plan", "plan", "Plan a path on a map with the global costmap and planner of a parameter set."),
    "simulate": LazyCommand(
        "simulate", "simulate", "Drive a simulated robot to its goals on a map, or through a scenario file."
    ),
    "live": LazyCommand(
        "live",
        "live",
        "Watch a robot drive in the browser, and take part: goals, obstacles, parameters, driving by hand, why.",
    ),
    "tour": LazyCommand(
        "tour",
        "tour",
        "Drive a simulated robot to named places. Ctrl-C, SIGTERM and SIGHUP stop the robot and keep record and log.",
    ),
    "dock": LazyCommand(
        "dock",
        "dock",
        "Dock a simulated robot: drive to the staging pose, detect the dock, drive in, wait for the charging current.",
    ),
    "cover": LazyCommand(
        "cover", "cover", "Plan, and drive, a tool over all of a map or polygon that the footprint can reach."
    ),
    "move": LazyCommand(
        "motions",
        "move",
        "Drive a simulated robot straight ahead or backwards. It stops before obstacles.",
        NEGATIVE_NUMBERS,
    ),
    "turn": LazyCommand(
        "motions",
        "turn",
        "Turn a simulated robot in place, by more than a full turn too. It stops before obstacles.",
        NEGATIVE_NUMBERS,
    ),
    "drive-to": LazyCommand(
        "motions",
        "drive_to",
        "Drive a simulated robot straight to a pose, without a planner: face it, drive, turn to its heading.",
        NEGATIVE_NUMBERS,
    ),
    "follow": LazyCommand(
        "motions",
        "follow",
        "Follow a timed trajectory with a simulated robot; print, draw and write the errors over time.",
    ),
    "teleop": LazyCommand(
        "teleop", "teleop", "Drive a simulated robot with the keyboard; Ctrl-C quits, and the run is recorded."
    ),
    "plot": LazyCommand(
        "plot",
        "plot",
        "Draw a recorded run (map, costmaps, paths, footprints, goals), or a map with its places, grid and coordinates.",
    ),
    "report": LazyCommand(
        "report",
        "report",
        "Write the report of a run as one HTML file: map, goals, timeline, possible causes, film and metrics.",
    ),
    "replay": LazyCommand(
        "replay",
        "replay",
        "Replay a log through costmaps, planners and controller, open loop: the robot does what the log says.",
    ),
    "check": LazyCommand(
        "check",
        "check",
        "Check parameters or a scenario file, and report every finding with file, line and column.",
    ),
    "info": LazyCommand(
        "info",
        "info",
        "List versions, registered plugins with their ROS names, packaged maps, parameter sets, scenarios and suites.",
    ),
    "compile": LazyCommand(
        "compile", "compile_", "Compile the kernels of all commands, or of some plugins, into the cache."
    ),
    "doctor": LazyCommand(
        "doctor",
        "doctor",
        "Find out why a robot drives badly: check, passages, three drives, and the measured effect of each fix.",
    ),
    "sweep": LazyCommand(
        "sweep", "sweep", "Drive a grid or a sample of parameter values over scenarios: a line of JSON per run."
    ),
    "tune": LazyCommand(
        "tune", "tune", "Search for better parameters and validate them on scenarios that the search has not seen."
    ),
    "bag": LazyCommand("bag", "app", "Read and write bags: ROS 1 (.bag), ROS 2 (folder, .db3, .mcap)."),
    "localize": LazyCommand(
        "localize",
        "localize",
        "Find the robot's pose along a log: trajectory, errors against the log's reference, particles.",
    ),
    "map": LazyCommand("map_commands", "app", "Make and edit maps."),
    "route": LazyCommand("route", "app", "Plan, check, draw and make route graphs (GeoJSON of nav2_route)."),
    "lattice": LazyCommand("lattice", "app", "Generate and check motion primitives for smac_lattice."),
    "bench": LazyCommand(
        "app", "bench", "Benchmark published tasks, planners, speed, and one parameter set against another."
    ),
    "explain": LazyCommand(
        "app",
        "explain",
        "Diagnose a run or a parameter set: goals, commands, cell costs, tracking, passages, inflation.",
    ),
    "params": LazyCommand("params", "app", "Show, compare, document, migrate and convert parameters."),
    "ros1": LazyCommand(
        "ros1", "app", "Nodes for ROS 1 (Debian's packages): move_base, the simulated robot, map_server, amcl, mapping."
    ),
    "ros2": LazyCommand(
        "ros2",
        "app",
        "Nodes for ROS 2 (your sourced installation): the navigator in place of Nav2, the simulated robot.",
    ),
}

BENCH_COMMANDS: Final = {
    "barn": LazyCommand(
        "bench.barn",
        "barn",
        "Drive through the BARN worlds, scored as in the BARN Challenge: a table per world, totals with confidence "
        "intervals.",
    ),
    "movingai": LazyCommand(
        "bench.movingai",
        "movingai",
        "Solve N. Sturtevant's grid path finding problems and compare path lengths with the published optima.",
    ),
    "planners": LazyCommand(
        "bench.planners",
        "planners",
        "Plan between random reachable pairs: success, collisions, length, cost, clearance, expanded cells and times.",
    ),
    "speed": LazyCommand(
        "bench.speed",
        "speed",
        "Measure the real-time factor of the whole stack, its share by stage, and single stages, on one core.",
    ),
    "compare": LazyCommand(
        "bench.compare",
        "compare",
        "Compare two parameter sets on the same scenarios and seeds: paired differences with confidence intervals.",
    ),
    "controllers": LazyCommand(
        "bench.controllers",
        "controllers",
        "Drive all controllers through the same scenarios, each with its packaged tuning.",
    ),
    "random": LazyCommand(
        "bench.random",
        "random",
        "Run random scenarios (maps, robots, parameters, noise, obstacles) and check the invariants: no exception, "
        "every goal ends in a terminal state, no success with a collision. The exit code is 1 if a scenario violates "
        "one of them.",
    ),
    "safety": LazyCommand(
        "bench.safety",
        "safety",
        "Drive three robots by random velocities among people who walk and boxes that appear, with and without the "
        "collision monitor. Each contact with the monitor is explained; the exit code is 1 if one of them cannot be.",
    ),
}

EXPLAIN_COMMANDS: Final = {
    "command": LazyCommand(
        "explain.command",
        "command",
        "Explain a velocity command: the samples, which critic rejected them and where, and the costs of the others.",
    ),
    "goal": LazyCommand(
        "explain.goal",
        "goal",
        "Explain the outcome of a goal: states, plans, failures with their reasons, recoveries, times without progress.",
    ),
    "cell": LazyCommand(
        "explain.cell",
        "cell",
        "Explain the cost of a cell: the layer and sensor that set it, the time, and the share of every layer.",
    ),
    "map": LazyCommand(
        "explain.map",
        "map_",
        "List the scans that made a cell of a map: which saw an obstacle there, which saw through it, when and from where.",
        NEGATIVE_NUMBERS,
    ),
    "tracking": LazyCommand(
        "explain.tracking",
        "tracking",
        "Explain how well a trajectory was followed: errors along, across and of the heading, mean and worst, over time.",
    ),
    "coverage": LazyCommand(
        "explain.coverage",
        "coverage",
        "Explain which parts of a coverage task stayed uncovered and why, with the figures of the plan and of the drive.",
    ),
    "passages": LazyCommand(
        "explain.passages",
        "passages",
        "List the doors, corridors and gaps between obstacles of a map: passable, passable at high cost, or not passable.",
    ),
    "inflation": LazyCommand(
        "explain.inflation",
        "inflation",
        "Print cost against distance to the nearest obstacle for both costmaps of a parameter set.",
    ),
    "migration": LazyCommand(
        "explain.migration",
        "migration",
        "List what a move_base robot must change for Nav2, each with its place in the robot's files and what to do.",
    ),
    "costmap": LazyCommand(
        "explain.costmap", "costmap", "Draw a costmap of a run at a given time, with its cost bands."
    ),
}

app = typer.Typer(
    name="navstack",
    cls=group_of(COMMANDS),
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},  # the commands inherit it
    help="move_base without ROS: plan paths, simulate and diagnose navigation with the YAML files of your robot.",
    epilog="Exit codes: 0 success; 1 a goal failed or a success condition was not met; 2 invalid input; "
    "70 internal error; 130 interrupted.",
)
bench = typer.Typer(
    cls=group_of(BENCH_COMMANDS),
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help=COMMANDS["bench"].help,
    epilog="With --out, results are saved as they arrive; --resume continues an interrupted benchmark. "
    "Exit codes: 0 all runs finished, 1 some runs gave no result, 2 invalid input, 130 interrupted.",
)
explain = typer.Typer(
    cls=group_of(EXPLAIN_COMMANDS), no_args_is_help=True, rich_markup_mode="markdown", help=COMMANDS["explain"].help
)


@bench.callback()
@explain.callback()
def _group() -> None:
    """Keep a group of one command a group."""


def command_tree() -> Any:
    """Return the click command `navstack` with all commands loaded: for documentation and tests."""
    group: Any = typer.main.get_group(app)
    return group.load_all()


def _print_version(value: bool) -> None:
    if value:
        from navstack import __version__

        print(f"navstack {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option("-v", "--verbose", help="Also print notes about parameters, and the duration of the command."),
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print only results and errors.")] = False,
    debug: Annotated[
        bool, typer.Option("--debug", envvar=DEBUG_VARIABLE, help="Print the traceback of an internal error.")
    ] = False,
) -> None:
    """Options of every command, before or after its name."""
    from navstack.cli.output import Verbosity, set_verbosity

    if verbose and quiet:
        raise typer.BadParameter("--verbose and --quiet exclude each other")
    set_verbosity(Verbosity.VERBOSE if verbose else Verbosity.QUIET if quiet else Verbosity.NORMAL)
    internal_error.show_traceback(debug or verbose)


def run(arguments: list[str]) -> int:
    """Runs one command line and returns its exit code; no exception leaves it."""
    from navstack.cli.output import Verbosity, set_verbosity, verbosity

    set_verbosity(Verbosity.NORMAL)
    started = time.monotonic()
    try:
        with raised_terminations() as terminated:
            code = _run(arguments)
        if terminated():
            code = terminated.exit_code
    except Exception as exc:
        code = internal_error.report(exc, arguments)
    if verbosity() is Verbosity.VERBOSE:
        with contextlib.suppress(OSError):
            print(f"{time.monotonic() - started:.1f} s", file=sys.stderr)
    return code


def _run(arguments: list[str]) -> int:
    """Runs one command line and returns its exit code. Raises the exceptions that navstack does not know."""
    as_json = "--json" in arguments
    try:
        _interrupts.raise_again()
        code = app(args=_global_first(arguments), prog_name="navstack", standalone_mode=False)
        sys.stdout.flush()  # at the exit, an error could no longer be reported
        return code if isinstance(code, int) else 0
    except (typer.Abort, KeyboardInterrupt):
        with contextlib.suppress(OSError):  # a closed terminal
            print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except typer.TyperException as exc:
        return _usage_error(exc, as_json)
    except BrokenPipeError:
        _discard_output("")
        return EXIT_WRONG_INPUT
    except OSError as exc:
        return _file_error(exc, as_json)
    except MemoryError as exc:
        why = str(exc) or "not enough memory"
        return _report(as_json, f"out of memory: {why}; use a smaller map or costmap, or fewer samples")
    except Exception as exc:
        return _navstack_error(exc, as_json)


def _global_first(arguments: list[str]) -> list[str]:
    """The arguments with the options of `root` before the subcommand: users write them at the end as well."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    found = [text for text in arguments[:end] if text in _GLOBAL]
    return [*found, *(text for text in arguments[:end] if text not in _GLOBAL), *arguments[end:]]


def _usage_error(exc: typer.TyperException, as_json: bool) -> int:
    if not exc.format_message():  # `navstack` without arguments: typer has printed the help
        return EXIT_WRONG_INPUT
    context = getattr(exc, "ctx", None)
    hint = _without_option(exc) or (f'Try "{context.command_path} --help".' if context is not None else "")
    return _report(as_json, exc.format_message(), hint=hint)


def _without_option(exc: typer.TyperException) -> str:
    """What to write instead of `--params FILE` for a command whose argument is PARAMS; empty for other errors."""
    context: Any = getattr(exc, "ctx", None)
    name = str(getattr(exc, "option_name", ""))
    if context is None or not name.startswith("--"):
        return ""
    metavars = [str(p.metavar) for p in context.command.params if p.param_type_name == "argument"]
    takes = any(metavar.lower().startswith(name[2:]) for metavar in metavars)
    return f"Give it without {name}: {context.command_path} {' '.join(metavars)}" if takes else ""


def _file_error(exc: OSError, as_json: bool) -> int:
    """Reports an invalid file name or missing permission. Raises the error if it has no file name."""
    if exc.filename is None:
        if exc.errno in (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG):  # of stdout or stderr, which have no name
            _discard_output(f"error: cannot write the output: {exc.strerror}; free space, or write to another file")
            return EXIT_WRONG_INPUT
        raise exc
    name = str(exc.filename)
    shown = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}.."
    return _report(as_json, f"cannot use {shown}: {exc.strerror}", data={"path": name})


def _discard_output(message: str) -> None:
    """Prints the message to stderr, and sends what is still buffered for stdout nowhere."""
    if message:
        with contextlib.suppress(OSError):
            print(message, file=sys.stderr, flush=True)
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _navstack_error(exc: Exception, as_json: bool) -> int:
    """Reports a NavError. Raises every other exception."""
    from navstack.core import NavError

    if not isinstance(exc, NavError):
        raise exc
    data = exc.as_dict() | {"code": exc.code, "name": exc.name}
    return _report(as_json, exc.message, data=data, exit_code=exit_code_of(exc))


def exit_code_of(error: Exception) -> int:
    """1 for a planner that finds no path between valid poses, or no route (a failed goal), 2 for every other error."""
    from navstack.core import NoValidPathError, PlanningTimeoutError

    no_route = getattr(error, "code", 0) in (404, 405)  # of navstack.routes
    return (
        EXIT_GOAL_FAILED
        if no_route or isinstance(error, (NoValidPathError, PlanningTimeoutError))
        else EXIT_WRONG_INPUT
    )


def _report(
    as_json: bool,
    message: str,
    *,
    data: dict[str, Any] | None = None,
    hint: str = "",
    exit_code: int = EXIT_WRONG_INPUT,
) -> int:
    if as_json:
        print(json.dumps({"error": {"code": _CODE, "name": _NAME, **(data or {}), "message": message}}))
    else:
        from navstack.cli.output import print_error

        print_error(message, hint)
    return exit_code


# ----------------------------------------------------------------------------------------------------------------------
# Entry point of the `navstack` command.


def main() -> None:
    """Runs the command line of this process and exits with its exit code."""
    # imports make many objects that stay: collecting them again and again takes 0.1 s
    gc.set_threshold(100_000, 20, 20)
    code = run(sys.argv[1:])
    if _interrupts.is_command():
        _interrupts.end_quietly()  # also while Python ends
    sys.exit(code)
