"""The `navstack` command: its subcommands, and how errors become messages and exit codes.

Exit codes: 0 success; 1 a goal failed or a success condition was not met; 2 invalid input; 70 internal error;
130 interrupted.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
import time
from typing import Annotated, Any, Final

import typer

from navstack.cli import (
    bag,
    bench,
    check,
    explain,
    info,
    internal_error,
    lattice,
    live,
    localize,
    map_commands,
    motions,
    params,
    plan,
    plot,
    replay,
    ros1,
    ros1_helpers,
    ros1_install,
    simulate,
    sweep,
    teleop,
    tour,
    tune,
)
from navstack.cli.interrupts import raised_terminations

EXIT_GOAL_FAILED = 1
EXIT_WRONG_INPUT = 2
EXIT_INTERRUPTED = 130
_GLOBAL: Final = frozenset({"-v", "--verbose", "-q", "--quiet", "--debug"})
DEBUG_VARIABLE: Final = "NAVSTACK_DEBUG"
_CODE, _NAME = 9001, "INVALID_INPUT"
_LONGEST_NAME: Final = 200
"""Longest file name that a message quotes in full (characters)."""

app = typer.Typer(
    name="navstack",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="move_base without ROS: plan paths, simulate and diagnose navigation with the YAML files of your robot.",
    epilog="Exit codes: 0 success; 1 a goal failed or a success condition was not met; 2 invalid input; "
    "70 internal error; 130 interrupted.",
)
app.command("plan")(plan.plan)
app.command("simulate")(simulate.simulate)
app.command("live")(live.live)
app.command("tour")(tour.tour)
# a negative distance, angle or coordinate is an argument, not an option
_NEGATIVE: Final[dict[str, Any]] = {"ignore_unknown_options": True}
app.command("move", context_settings=_NEGATIVE)(motions.move)
app.command("turn", context_settings=_NEGATIVE)(motions.turn)
app.command("drive-to", context_settings=_NEGATIVE)(motions.drive_to)
app.command("follow")(motions.follow)
app.command("teleop")(teleop.teleop)
app.command("plot")(plot.plot)
app.command("replay")(replay.replay)
app.command("check")(check.check)
app.command("info")(info.info)
app.command("sweep")(sweep.sweep)
app.command("tune")(tune.tune)
app.add_typer(bag.app, name="bag")
app.command("localize")(localize.localize)
app.add_typer(map_commands.app, name="map")
app.add_typer(lattice.app, name="lattice")
app.add_typer(bench.app, name="bench")
app.add_typer(explain.app, name="explain")
app.add_typer(params.app, name="params")
ros1_helpers.add_to(ros1.app)
ros1_install.add_to(ros1.app)
app.add_typer(ros1.app, name="ros1")


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
    from navstack.core.errors import NavError

    if not isinstance(exc, NavError):
        raise exc
    data = exc.as_dict() | {"code": exc.code, "name": exc.name}
    return _report(as_json, exc.message, data=data, exit_code=exit_code_of(exc))


def exit_code_of(error: Exception) -> int:
    """1 for a planner that finds no path between valid poses (a failed goal), 2 for every other error."""
    from navstack.core.errors import NoValidPathError, PlanningTimeoutError

    return EXIT_GOAL_FAILED if isinstance(error, (NoValidPathError, PlanningTimeoutError)) else EXIT_WRONG_INPUT


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
