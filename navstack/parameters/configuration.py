"""Load parameters into a typed configuration of the whole robot, or check them."""

from __future__ import annotations

from collections.abc import Sequence

from navstack.core.errors import ParameterError, UnknownPluginError
from navstack.interfaces import GlobalPlanner
from navstack.parameters.binding import Binder
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration, NavstackParams
from navstack.parameters.findings import Finding, in_order
from navstack.parameters.loader import Loader
from navstack.parameters.namespaces import planner_space
from navstack.parameters.sources import Override, Source
from navstack.plugins import GLOBAL_PLANNERS, PluginChoice


def load_configuration(
    sources: Sequence[Source],
    *,
    overrides: Sequence[str | Override] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Configuration:
    """Load a packaged set (`turtlebot`), folders, files (`file@namespace`) or mappings; later sources override earlier ones.

    `overrides` are `NAME=VALUE` texts, `distro` overrides `navstack/ros_distro`. With `allow_missing`, layers, critics and
    recovery behaviors of an unknown type are left out with a warning; unknown planners remain errors.

    Raise ParameterError if the parameters cannot be used: its message has a line per error, its `data["findings"]` all
    findings.
    """
    configuration, findings = Loader(sources, overrides, distro, allow_missing).load()
    errors = [f for f in findings if f.severity == "error"]
    if configuration is None or errors:
        raise _error(errors, findings)
    return configuration


def check_parameters(
    sources: Sequence[Source],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> list[Finding]:
    """Return all findings about the parameters, sorted by file and line; never raises because of their content."""
    return Loader(sources, overrides, distro, allow_missing).load()[1]


def choose_global_planner(configuration: Configuration, name: str) -> PluginChoice[GlobalPlanner]:
    """Return another global planner than the selected one, with the parameters of its namespace.

    Raise UnknownPluginError for a name that is not registered, ParameterError for parameters that cannot be used.
    """
    entry = GLOBAL_PLANNERS.get(name)
    findings: list[Finding] = []
    binder = Binder(findings, {"ros_distro": configuration.navstack.ros_distro})
    space = planner_space(configuration.tree, entry, name)
    params = binder.bind(entry.cls.Params, space)
    errors = [f for f in in_order(findings) if f.severity == "error"]
    if params is None or errors:
        raise _error(errors, in_order(findings))
    return PluginChoice(entry.name, entry.cls, params, space.path)


def _error(errors: Sequence[Finding], findings: Sequence[Finding]) -> ParameterError:
    count = "" if len(errors) == 1 else f" ({len(errors)} errors)"
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    unknown = [f for f in errors if f.rule == "unknown-plugin"]
    cls = UnknownPluginError if unknown and len(unknown) == len(errors) else ParameterError
    return cls(f"the parameters cannot be used{count}:\n{lines}", findings=[f.as_dict() for f in findings])


__all__ = [
    "Configuration",
    "CostmapConfiguration",
    "NavstackParams",
    "PluginChoice",
    "check_parameters",
    "choose_global_planner",
    "load_configuration",
]
