"""The frame of every contract suite."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar, cast

from navstack.plugins import ParamModel

C = TypeVar("C", bound="Contract")


class Contract:
    """Tests that every plugin of a kind must pass; a subclass names the plugin."""

    plugin: ClassVar[Any]
    """The class under test."""
    values: ClassVar[Mapping[str, Any]] = {}
    """Parameter values that differ from the defaults."""

    @classmethod
    def params(cls, **values: Any) -> Any:
        """The plugin's parameters: `values` (only names that the plugin knows) below those of the suite."""
        model: type[ParamModel] = cls.plugin.Params
        known = {name: value for name, value in values.items() if name in model.model_fields}
        return model(**{**known, **cls.values})

    def test_documentation(self) -> None:
        """The class has a docstring, and every parameter a default and a description."""
        assert self.plugin.__doc__
        assert issubclass(self.plugin.Params, ParamModel)
        self.plugin.Params()
        for name, field in self.plugin.Params.model_fields.items():
            assert field.description, f"the parameter {name} has no description"


def contract_of(suite: type[C], plugin: type[Any], values: Mapping[str, Any]) -> type[C]:
    """A subclass of `suite` for `plugin`, ready to be collected."""
    return cast("type[C]", type(f"Test{plugin.__name__}", (suite,), {"plugin": plugin, "values": values}))
