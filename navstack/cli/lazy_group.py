"""Groups of commands whose modules are imported when the command runs: `navstack --help` imports none of them."""

from __future__ import annotations

import importlib
from typing import Any, ClassVar, Final, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

NEGATIVE_NUMBERS: Final[dict[str, Any]] = {"ignore_unknown_options": True}
"""Settings of a command to which a negative distance, angle or coordinate is an argument, not an option."""


class _HidesTypesOfFlags:
    """Lets the help print no `<bool>` after flags."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters; flags have an empty metavar."""
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in found:
            if getattr(parameter, "is_bool_flag", False) and parameter.metavar is None:
                parameter.metavar = ""
        return found


class Command(_HidesTypesOfFlags, TyperCommand):
    """A command."""


class Group(_HidesTypesOfFlags, TyperGroup):
    """A group of commands that are imported together."""


class LazyCommand(NamedTuple):
    """Where a command is, and its line in the help of its group: the first sentence of its own help."""

    module: str
    """Module with the command: below navstack.cli."""
    attribute: str
    """Its function, or the typer application of a group."""
    help: str
    settings: dict[str, Any] = {}

    def load(self, name: str) -> Any:
        """Import the module and return the command."""
        found = getattr(importlib.import_module(f"navstack.cli.{self.module}"), self.attribute)
        if isinstance(found, typer.Typer):
            for registered in found.registered_commands:
                registered.cls = Command if registered.cls in (None, TyperCommand) else registered.cls
            if not isinstance(found.info.cls, type):  # a lazy group has a class of its own
                found.info.cls = Group
            command: Any = get_group(found)
        else:
            application = typer.Typer(add_completion=False, rich_markup_mode="markdown", pretty_exceptions_enable=False)
            application.command(name, cls=Command, context_settings=self.settings)(found)
            command = get_command(application)
        command.name = name
        return command


class LazyGroup(_HidesTypesOfFlags, TyperGroup):
    """A group that knows the names and the help of its commands, and loads a command when it runs."""

    table: ClassVar[dict[str, LazyCommand]] = {}
    _done: ClassVar[dict[str, Any]] = {}
    """Commands that are loaded, by name."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, lazy in self.table.items():
            self.commands[name] = Command(name, help=lazy.help, rich_markup_mode="markdown")

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command of the arguments, loaded, and what is left of them."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, self.loaded(name) if name in self.table else command, rest

    def loaded(self, name: str | None) -> Any:
        """Return one command, loaded."""
        assert name is not None
        if name not in self._done:
            self._done[name] = self.table[name].load(name)
        return self._done[name]

    def load_all(self) -> LazyGroup:
        """Load every command, and those of inner groups: for documentation and tests."""
        for name in self.table:
            self.commands[name] = self.loaded(name)
            group = self.commands[name]
            if isinstance(group, LazyGroup):
                group.load_all()
        return self


def group_of(table: dict[str, LazyCommand]) -> type[LazyGroup]:
    """Return a class of groups for `typer.Typer(cls=..)`."""
    return type("LazyGroup", (LazyGroup,), {"table": table, "_done": {}})
