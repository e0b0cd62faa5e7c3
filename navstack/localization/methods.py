"""Localizers by name, with parameters as text: what `navstack localize` runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import yaml
from pydantic import ValidationError

from navstack.core import InputError, short_repr
from navstack.localization.amcl import Amcl
from navstack.localization.evaluation import Cloud
from navstack.localization.scan_matcher import ScanMatcher
from navstack.localization.searching import SearchingLocalizer
from navstack.parameters import AmclParams, ScanMatcherParams, SearchingParams
from navstack.plugins import LOCALIZERS, Localizer

SUPERVISED: Final = "amcl"
"""amcl, supervised by searches over the map; `amcl_only` is amcl as ROS's, every other method a localizer of that name."""
ALONE: Final = "amcl_only"
UNSEARCHED: Final = (ALONE, "dead_reckoning", "mapping")
"""Methods that others are compared with: their estimates remain as they are, and they only say when they are lost.

Every other method searches the map once it is lost. `search=false` leaves that out, `search=true` adds it.
"""
MATCHING: Final = "scan_matching"


def methods() -> list[str]:
    """Return the names of all methods."""
    return sorted({*(entry.name for entry in LOCALIZERS), ALONE})


@dataclass(frozen=True, slots=True)
class Method:
    """A localizer to run: one of `methods()`, with parameters by name."""

    name: str = "scan_matching"
    values: dict[str, Any] = field(default_factory=dict[str, Any])
    amcl: AmclParams | None = None
    """Parameters of a robot, which `values` change."""

    @property
    def label(self) -> str:
        """Name and changed parameters, for legends."""
        return " ".join([self.name, *(f"{key}={value}" for key, value in self.values.items())])

    @classmethod
    def parse(cls, texts: Iterable[str], argument: str, base: Method | None = None) -> Method:
        """Read `KEY=VALUE` texts; `method=NAME` names the method. Raises InputError."""
        start = base or cls()
        name, values = start.name, dict(start.values)
        for text in texts:
            key, sign, raw = text.partition("=")
            if not sign or not key:
                raise InputError(
                    f'{argument} "{text}" must be KEY=VALUE, such as laser_max_beams=60', argument=argument
                )
            if key == "method":
                if raw != ALONE and raw not in LOCALIZERS:
                    raise InputError(f'{argument} "{text}": the methods are {", ".join(methods())}', argument=argument)
                name = raw
                continue
            try:
                values[key] = yaml.safe_load(raw)
            except yaml.YAMLError:
                raise InputError(f'{argument} "{text}": {short_repr(raw)} is no value', argument=argument) from None
        return cls(name, values, start.amcl)

    def build(self, seed: int) -> tuple[Localizer, Cloud]:
        """Return the localizer, without a map, and the function that returns its particles. Raises InputError."""
        search: SearchingParams = self._params(
            SearchingParams, {"search": self.name not in UNSEARCHED} | self._values(SearchingParams)
        )
        if self.name == MATCHING:
            tracker: Localizer = ScanMatcher(
                ScanMatcherParams(**search.model_dump(include=set(ScanMatcherParams.model_fields)))
            )
        elif self.name in (SUPERVISED, ALONE):
            written = {} if self.amcl is None else self.amcl.model_dump(include=self.amcl.model_fields_set)
            tracker = Amcl(self._params(AmclParams, {**written, **self._values(AmclParams)}), seed=seed)
        else:
            cls: Any = LOCALIZERS.get(self.name).cls
            tracker = cls(self._params(cls.Params, self._values(cls.Params)), seed=seed)
        known = {*SearchingParams.model_fields, *(() if self.name == MATCHING else type(tracker).Params.model_fields)}
        other = [key for key in self.values if key not in known]
        if other:
            raise InputError(
                f"{self.name} has no parameter {short_repr(other[0])}; `navstack localize --help` names where to look"
            )
        localizer = SearchingLocalizer(tracker, search)
        return localizer, lambda: localizer.possible_poses()[0]

    def _values(self, model: type[Any]) -> dict[str, Any]:
        """Return the given values of a model's parameters."""
        return {key: value for key, value in self.values.items() if key in model.model_fields}

    def _params(self, model: type[Any], values: dict[str, Any]) -> Any:
        try:
            return model(**values)
        except ValidationError as exc:
            first = exc.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the parameters"
            raise InputError(f"{self.name}: {where}: {first['msg']}, not {short_repr(first['input'])}") from None
