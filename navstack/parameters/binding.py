"""A namespace of the tree -> its parameter model: which written value counts, and the namespaces below."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from navstack.core.parameters import ParamModel
from navstack.parameters.findings import Finding, Location
from navstack.parameters.model_fields import is_model, is_value, nested_model
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.validation import Strictness, Validator, Written
from navstack.parameters.value_messages import show
from navstack.parameters.yaml_nodes import Node, plain


class Binder:
    """Builds models from namespaces, collects findings and marks what was used."""

    def __init__(
        self, findings: list[Finding], navstack: Mapping[str, Any] | None = None, *, of_ros: bool = True
    ) -> None:
        """`navstack` are the values of fields in `FROM_NAVSTACK`.

        `of_ros=False` for files that ROS does not read: floats are not rounded, messages do not mention ROS.
        """
        self.findings = findings
        self.navstack = dict(navstack or {})
        self.bound: list[tuple[Space, type[ParamModel]]] = []
        """The model that read each namespace."""
        self.origins: dict[str, Location] = {}
        """Full current name of a parameter -> location of its value; defaults are absent."""
        self._validator = Validator(findings, of_ros=of_ros)

    def bind(
        self,
        model: type[ParamModel],
        space: Space,
        *,
        fixed: Mapping[str, Any] | None = None,
        nodes: Mapping[str, tuple[Location, Node]] | None = None,
        strictness: Strictness = "error",
    ) -> ParamModel | None:
        """Return the model of `space`, None if a value cannot be used.

        `fixed` are values that code sets instead of the user; `nodes` replace values of the tree (with their locations).
        `strictness` is the severity of wrong values: "warning" for a namespace that is not in use.
        """
        space.used = True
        self.bound.append((space, model))
        written = self._written(model, space, fixed or {}, nodes or {})
        self.origins.update({space.join(name): value.node.at for name, value in written.items()})
        values: dict[str, Any] = {n: self.navstack[n] for n in sorted(model.FROM_NAVSTACK) if n in self.navstack}
        values.update(fixed or {})
        raw = {n: plain(w.node) for n, w in written.items()} | {n: _raw(v) for n, v in values.items()}
        below = self._children(model, space, raw, values, strictness) if model.CHILD_FIELD is not None else True
        nested = self._nested(model, space, values, strictness)
        # validated even after an error below, so that every wrong value is reported
        made = self._validator.validate(model, space, written, values, strictness)
        return made if below and nested else None

    def child(self, parent: Space, name: str, strictness: Strictness = "error") -> Space:
        """Return the namespace `name` of `parent`, empty if it is not written; a value in its place is a finding."""
        found = parent.children.get(name)
        if isinstance(found, Space):
            return found
        if found is not None:
            is_read = any(is_value(m, name) for s, m in self.bound if s is parent)
            found.used = found.used or not is_read
            if found.value is not None and not is_read:
                message = (
                    f"{name} = {show(found.value)} is a value, but {name} is a namespace of parameters; write the parameters "
                    f"indented below `{name}:`"
                )
                self._validator.add_finding(strictness, "wrong-type", found.node.at, found.path, message)
        return Space(parent.join(name), parent.at, parent)

    # --- values -------------------------------------------------------------------------------------------------------

    def _written(
        self,
        model: type[ParamModel],
        space: Space,
        fixed: Mapping[str, Any],
        nodes: Mapping[str, tuple[Location, Node]],
    ) -> dict[str, Written]:
        """The value of every field that is written, and marks it as used."""
        written: dict[str, Written] = {}
        for name, info in model.model_fields.items():
            if name in model.FROM_NAVSTACK or name in fixed or name == model.CHILD_FIELD or nested_model(info):
                continue
            if name in nodes:
                written[name] = Written(space.join(name), *nodes[name])
                continue
            leaf = self._find(model, name, space)
            if leaf is not None:
                leaf.used = True
                written[name] = Written(leaf.path, leaf.at, leaf.node)
        return written

    def _find(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        own = space.leaf(name) or self._find_renamed(model, name, space)
        if name in model.FROM_PARENT and space.parent is not None:
            parents = space.parent.leaf(name)
            if parents is not None:
                return self._overridden(name, own, parents, space, space.parent)
        if own is None and name in model.SEARCHED and space.parent is not None:
            return space.parent.search(name)
        return own

    def _overridden(self, name: str, own: Leaf | None, parents: Leaf, space: Space, parent: Space) -> Leaf:
        """The parent's parameter, which overrides the namespace's own."""
        if own is not None:
            own.used = True
            if own.value != parents.value:
                message = (
                    f"{own.name} = {show(own.value)} of {space.name} is overridden by {show(parents.value)} of the enclosing "
                    f"{parent.name or 'namespace'} ({parents.at}), as in ROS; remove one of them"
                )
                self._validator.add_finding("info", "overridden-by-parent", own.at, own.path, message)
        parents.used = True
        # ROS overwrites the value on the parameter server: a search from below finds the parent's
        return space.put(name, parents.at, parents.node)

    def _find_renamed(self, model: type[ParamModel], name: str, space: Space) -> Leaf | None:
        for old, new in model.RENAMED.items():
            if new == name and (leaf := space.leaf(old)) is not None:
                leaf.used = True
                ros = f"; its value {show(leaf.value)} is used here, but current ROS releases may ignore it"
                message = (
                    f"{old} is the former name of {new}{ros if self._validator.of_ros else ''}; rename it to {new}"
                )
                self._validator.add_finding("info", "renamed", leaf.at, leaf.path, message, new, new)
                return leaf
        return None

    # --- namespaces below ---------------------------------------------------------------------------------------------

    def _children(
        self,
        model: type[ParamModel],
        space: Space,
        raw: Mapping[str, Any],
        values: dict[str, Any],
        strictness: Strictness,
    ) -> bool:
        """Bind the namespaces whose names depend on values into `values`; False after an error."""
        good = True
        children: dict[str, ParamModel] = {}
        outer = _namespaces(space.parent) if space.parent is not None else {}
        raw = {**_namespaces(space), **raw}
        shared = model.shared_children({**outer, **raw})
        models = model.child_models({**{n: v for n, v in outer.items() if n in shared}, **raw})
        for name, child_model in models.items():
            beside = space.parent if name in shared and space.space(name) is None else None
            holder = beside if beside is not None and beside.space(name) is not None else space
            made = self.bind(child_model, self.child(holder, name, strictness), strictness=strictness)
            good = good and made is not None
            if made is not None:
                children[name] = made
            if holder is not space:
                self._share_origins(holder.join(name), space.join(name))
        assert model.CHILD_FIELD is not None
        values[model.CHILD_FIELD] = children
        return good

    def _share_origins(self, there: str, here: str) -> None:
        """Record the locations of the values below `there` also below `here`, the namespace that they are used in."""
        found = {name: at for name, at in self.origins.items() if name.startswith(f"{there}/")}
        self.origins.update({here + name[len(there) :]: at for name, at in found.items()})

    def _nested(self, model: type[ParamModel], space: Space, values: dict[str, Any], strictness: Strictness) -> bool:
        """Bind the fields that are namespaces into `values`; False after an error."""
        good = True
        for name, info in model.model_fields.items():
            inner = nested_model(info)
            if inner is None or name == model.CHILD_FIELD or name in values:
                continue
            if space.children.get(name) is None and not info.is_required() and not is_model(info.annotation):
                continue
            made = self.bind(inner, self.child(space, name, strictness), strictness=strictness)
            good = good and made is not None
            if made is not None:
                values[name] = made
        return good


def _namespaces(space: Space) -> dict[str, Any]:
    """The namespaces below one, as dictionaries."""
    return {name: child.as_dict() for name, child in space.children.items() if isinstance(child, Space)}


def _raw(value: Any) -> Any:
    """A value set by code, as a user would write it."""
    if isinstance(value, ParamModel):
        return value.model_dump()
    return [_raw(v) for v in value] if isinstance(value, list) else value
