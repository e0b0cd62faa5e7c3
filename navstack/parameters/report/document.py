"""The effective parameters of a configuration, and YAML that loads to the same configuration."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from pydantic.fields import FieldInfo

from navstack.core.parameters import ParamModel
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration
from navstack.parameters.findings import Location
from navstack.parameters.model_fields import unit_of
from navstack.parameters.models.move_base import builtin_recoveries
from navstack.parameters.yaml_scalars import scalar

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*\Z")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a component in use."""

    name: str
    """Full name below move_base: `local_costmap/inflation_layer/inflation_radius`."""
    value: Any
    """Effective value as plain Python objects; None if it is not set and has no default."""
    origin: Location | None
    """Location of the value; None for the default."""
    info: FieldInfo
    remark: str = ""
    """Why it is not written to YAML: something else decides its value."""

    @property
    def unit(self) -> str:
        """Unit, for example `m/s`; empty if it has none."""
        return unit_of(self.info)

    @property
    def origin_text(self) -> str:
        """`file:line`, or `default`."""
        if self.origin is None:
            return "default"
        return f"{self.origin.file}:{self.origin.line}" if self.origin.line else self.origin.file


def parameters_of(configuration: Configuration) -> list[Parameter]:
    """Return the effective parameters of every component in use, component by component."""
    return list(_all(configuration))


def same_parameters(a: Configuration, b: Configuration) -> bool:
    """Return True if all effective values are equal; their origins may differ."""

    def values(c: Configuration) -> tuple[Any, ...]:
        planners = (c.global_planner, c.local_planner)
        return (
            c.move_base,
            c.global_costmap,
            c.local_costmap,
            planners,
            c.recoveries,
            c.navstack,
            c.safety,
            c.localization,
        )

    return values(a) == values(b)


def _all(c: Configuration) -> Iterator[Parameter]:
    walk = _Walk(c.origins)
    yield from walk.model(c.move_base, "")
    for name, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        yield from walk.model(costmap.params, name, _left_to_layers(costmap))
        for layer in costmap.layers:
            yield from walk.model(layer.params, layer.namespace)
    for planner in (c.global_planner, c.local_planner):
        yield from walk.model(planner.params, planner.namespace)
    imposed: dict[str, dict[str, str]] = {}
    if c.move_base.recovery_behaviors is None:
        for spec, values in builtin_recoveries(c.move_base, c.local_costmap.footprint.circumscribed_radius):
            imposed[spec.name] = dict.fromkeys(values, "set by the built-in list of recoveries")
    for recovery in {r.namespace: r for r in c.recoveries}.values():
        yield from walk.model(recovery.params, recovery.namespace, imposed.get(recovery.name))
    yield from walk.model(c.navstack, "navstack")
    for name, params in (*c.safety.sections(), *c.localization.sections()):
        if params is not None:
            yield from walk.model(params, name)


def _left_to_layers(costmap: CostmapConfiguration) -> dict[str, str]:
    """Parameters that would override a layer's different value if they were written at the costmap's level."""
    found: dict[str, str] = {}
    for layer in costmap.layers:
        for name in layer.params.FROM_PARENT & costmap.params.__class__.model_fields.keys():
            if getattr(layer.params, name) != getattr(costmap.params, name):
                found[name] = f"not written: it would override {layer.name}'s"
    return found


class _Walk:
    """Lists the parameters of models with their origins."""

    def __init__(self, origins: Mapping[str, Location]) -> None:
        self.origins = origins

    def model(self, params: ParamModel, path: str, remarks: Mapping[str, str] | None = None) -> Iterator[Parameter]:
        """Yield the parameters of a namespace, those of the namespaces below it last."""
        below: list[tuple[str, ParamModel]] = []
        cls = type(params)
        for name, info in cls.model_fields.items():
            value: Any = getattr(params, name)
            if name in cls.FROM_NAVSTACK:
                continue  # listed in the section `navstack`
            full = f"{path}/{name}" if path else name
            if name == cls.CHILD_FIELD:
                below += [(f"{path}/{child}" if path else child, made) for child, made in value.items()]
            elif isinstance(value, ParamModel):
                below.append((full, value))
            else:
                remark = (remarks or {}).get(name, "")
                yield Parameter(full, plain_value(value), self.origins.get(full), info, remark)
        for full, made in below:
            yield from self.model(made, full)


def plain_value(value: Any) -> Any:
    """Convert a field's value to plain objects for YAML."""
    if isinstance(value, ParamModel):
        return {k: plain_value(v) for k, v in value}
    if isinstance(value, (list, tuple)):
        return [plain_value(v) for v in value]
    return value


# --- YAML -------------------------------------------------------------------------------------------------------------


def as_dict(parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Return value, unit, origin (None: the default) and remark by full name, for JSON."""
    return {
        p.name: {
            "value": p.value,
            "unit": p.unit,
            "origin": p.origin._asdict() if p.origin is not None else None,
            **({"remark": p.remark} if p.remark else {}),
        }
        for p in parameters
    }


def as_yaml(parameters: Sequence[Parameter], header: Sequence[str] = (), *, written_only: bool = False) -> str:
    """Return one YAML file for move_base's namespace with the origin of every value in a comment.

    Loading it gives the same configuration. `written_only` omits the defaults.
    """
    root: dict[str, Any] = {}
    for p in parameters:
        if written_only and (p.origin is None or p.remark):
            continue
        *above, last = p.name.split("/")
        at = root
        for part in above:
            at = at.setdefault(part, {})
        at[last] = p
    lines = [f"# {_comment(line)}".rstrip() for line in header]
    _write(root, 0, lines)
    return "\n".join(lines) + "\n"


def _write(tree: Mapping[str, Any], depth: int, lines: list[str]) -> None:
    pad = "  " * depth
    leaves = [(k, v) for k, v in tree.items() if isinstance(v, Parameter)]
    texts = [(p, _leaf(key, p)) for key, p in leaves]
    width = min(48, max((len(t) for _, t in texts if "\n" not in t), default=0))
    for p, text in texts:
        first, newline, rest = text.partition("\n")
        remark = f"; {p.remark}" if p.remark else ""
        lines.append(f"{pad}{first.ljust(width)}  # {_comment(p.origin_text + remark)}")
        lines += [pad + line for line in rest.split("\n")] if newline else []
    for key, below in tree.items():
        if isinstance(below, Parameter):
            continue
        if not depth:
            lines.append("")
        # a namespace that contains only comments would be a key without a value
        lines.append(f"{pad}{text_of(key)}:" if _holds_value(below) else f"{pad}# {text_of(key)}:")
        _write(below, depth + 1, lines)


def _holds_value(tree: Mapping[str, Any]) -> bool:
    return any(
        (v.value is not None and not v.remark) if isinstance(v, Parameter) else _holds_value(v) for v in tree.values()
    )


def _leaf(key: str, p: Parameter) -> str:
    if p.value is None:
        return f"# {text_of(key)}: not set"
    if p.remark:
        return f"# {text_of(key)}: {value_text(p.value)}"
    if isinstance(p.value, list) and any(isinstance(v, dict) for v in p.value):
        return "\n".join([f"{text_of(key)}:", *(f"  - {value_text(v)}" for v in p.value)])
    return f"{text_of(key)}: {value_text(p.value)}"


def value_text(value: Any) -> str:
    """Return a value as one line of YAML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{text_of(str(k))}: {value_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(value_text(v) for v in value) + "]"
    return "null" if value is None else text_of(str(value))


def text_of(text: str) -> str:
    """Return a text as YAML, quoted where a plain scalar would be ambiguous."""
    if _PLAIN.match(text) and scalar(text) == text:
        return text
    dumped: str = yaml.safe_dump(text, default_style='"', width=1_000_000)
    return dumped.strip()


def _comment(text: str) -> str:
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
