"""Finds the parameters of a configuration by the names and patterns that users write."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator

from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel
from navstack.parameters.configuration import Configuration
from navstack.parameters.report import Parameter, parameters_of
from navstack.parameters.spelling import nearest


class ParameterLookup:
    """The parameters of all components in use."""

    def __init__(self, configuration: Configuration) -> None:
        self._parameters = {p.name: p for p in parameters_of(configuration)}
        self._former = {
            f"{path}/{old}".lstrip("/"): f"{path}/{new}".lstrip("/")
            for path, model in _models(configuration)
            for old, new in model.RENAMED.items()
        }
        """Former full name -> current full name."""

    def find(self, pattern: str, where: str) -> list[Parameter]:
        """The parameters with this full name, former name or unique last part, or matching a pattern with * and ?.

        Raises InputError, with a suggestion, if there is none or if several share the last part; `where` starts the message.
        """
        name = "/".join(part for part in pattern.split("/") if part)
        name = self._former.get(name, name)
        if name in self._parameters:
            found = [name]
        elif any(sign in name for sign in "*?["):
            found = self._matching(pattern, name, where)
        else:
            found = [self._by_last_part(pattern, name, where)]
        for one in found:
            remark = self._parameters[one].remark
            if remark:
                raise InputError(f"{where}: {one} cannot be searched: {remark}", parameter=one)
        return [self._parameters[n] for n in found]

    def _matching(self, pattern: str, name: str, where: str) -> list[str]:
        found = [p for p in self._parameters if fnmatch.fnmatchcase(p, name)]
        if not found:
            raise InputError(
                f'{where}: no parameter matches "{pattern}"; `navstack params show` lists all parameters',
                parameter=pattern,
            )
        return found

    def _by_last_part(self, pattern: str, name: str, where: str) -> str:
        found = [p for p in self._parameters if p.rpartition("/")[2] == name and "/" not in name]
        found = found or [new for old, new in self._former.items() if old.rpartition("/")[2] == name]
        if len(found) > 1:
            raise InputError(
                f'{where}: "{pattern}" is ambiguous: {", ".join(found)}; give a full name, or "*/{name}" to set all of them '
                "together",
                parameter=pattern,
                found=found,
            )
        if not found:
            raise self._unknown(pattern, name, where)
        return found[0]

    def _unknown(self, pattern: str, name: str, where: str) -> InputError:
        last = name.rpartition("/")[2]
        same = [p for p in self._parameters if p.rpartition("/")[2] == last]
        close = same[0] if same else nearest(name, self._parameters)
        if close is None:
            lasts = {p.rpartition("/")[2]: p for p in self._parameters}
            near = nearest(last, lasts)
            close = lasts[near] if near else None
        hint = f'did you mean "{close}"?' if close else "`navstack params show` lists all parameters"
        return InputError(f'{where}: no parameter in use is named "{pattern}"; {hint}', parameter=pattern, meant=close)


def _models(c: Configuration) -> Iterator[tuple[str, type[ParamModel]]]:
    """Namespace and model of every component in use."""
    yield "", type(c.move_base)
    for name, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        yield name, type(costmap.params)
        yield from ((layer.namespace, type(layer.params)) for layer in costmap.layers)
    yield from ((p.namespace, type(p.params)) for p in (c.global_planner, c.local_planner))
    yield from ((r.namespace, type(r.params)) for r in c.recoveries)
