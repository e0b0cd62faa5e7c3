"""The `navstack` command and what it does with failures.

Exit codes: 0 every goal SUCCEEDED (or the success conditions of a scenario held), 1 not so, 2 the input was wrong, 130
interrupted.
"""

from __future__ import annotations

import json
import sys
from typing import Any, Final

import typer

from navstack.cli import bench, check, explain, info, params, plan, plot, simulate, sweep, tour, tune

EXIT_GOAL_FAILED = 1
EXIT_WRONG_INPUT = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="navstack",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="move_base without ROS: plan, simulate and understand navigation from the YAML files of your robot.",
    epilog="Exit codes: 0 every goal SUCCEEDED (or a scenario's conditions held), 1 not so, 2 the input was wrong.",
)
app.command("plan")(plan.plan)
app.command("simulate")(simulate.simulate)
app.command("tour")(tour.tour)
app.command("plot")(plot.plot)
app.command("check")(check.check)
app.command("info")(info.info)
app.command("sweep")(sweep.sweep)
app.command("tune")(tune.tune)
app.add_typer(bench.app, name="bench")
app.add_typer(explain.app, name="explain")
app.add_typer(params.app, name="params")


def _version(value: bool) -> None:
    if value:
        from navstack import __version__

        print(f"navstack {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """Options of the command itself."""


_LONG: Final = 200


def run(arguments: list[str]) -> int:
    """Runs one command line; the exit code."""
    as_json = "--json" in arguments
    try:
        code = app(args=arguments, prog_name="navstack", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except (typer.Abort, KeyboardInterrupt):
        return _interrupted()
    except typer.TyperException as exc:
        if not exc.format_message():  # `navstack` alone: typer has printed the help already
            return EXIT_WRONG_INPUT
        context = getattr(exc, "ctx", None)
        hint = f'Try "{context.command_path} --help".' if context is not None else ""
        return _report(as_json, 9001, "INVALID_INPUT", exc.format_message(), {}, hint)
    except BrokenPipeError:
        return EXIT_WRONG_INPUT
    except OSError as exc:
        # a name that cannot be one, or a folder that nobody may look into: whoever used it did not expect that
        if exc.filename is None:
            raise
        name = str(exc.filename)
        shown = name if len(name) <= _LONG else f"{name[:_LONG]}.."
        return _report(as_json, 9001, "INVALID_INPUT", f"cannot use {shown}: {exc.strerror}", {"path": name}, "")
    except MemoryError as exc:
        why = str(exc) or "this takes more than there is"
        return _report(
            as_json, 9001, "INVALID_INPUT", f"out of memory: {why}; a smaller map, costmap or sample count?", {}, ""
        )
    except Exception as exc:
        from navstack.core.errors import NavError

        if not isinstance(exc, NavError):
            raise
        return _report(as_json, exc.code, exc.name, exc.message, exc.as_dict(), "", exit_code_of(exc))


def exit_code_of(error: Exception) -> int:
    """A planner that finds no way between two good places is a failed goal; everything else is wrong input."""
    from navstack.core.errors import NoValidPathError, PlanningTimeoutError

    return EXIT_GOAL_FAILED if isinstance(error, (NoValidPathError, PlanningTimeoutError)) else EXIT_WRONG_INPUT


def _interrupted() -> int:
    print("interrupted", file=sys.stderr)
    return EXIT_INTERRUPTED


def _report(
    as_json: bool,
    code: int,
    name: str,
    message: str,
    data: dict[str, Any],
    hint: str,
    exit_code: int = EXIT_WRONG_INPUT,
) -> int:
    if as_json:
        print(json.dumps({"error": {**data, "code": code, "name": name, "message": message}}))
    else:
        from navstack.cli.output import print_error

        print_error(message, hint)
    return exit_code
