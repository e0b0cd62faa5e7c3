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
"""amcl, supervised by searches over the map; `amcl_only` is amcl alone, every other method a localizer of that name."""
ALONE: Final = "amcl_only"
MATCHING: Final = "scan_matching"
"""Scan matching, supervised as well: lost once, it would never search again. `search=false` leaves that out."""


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
        if self.name in (SUPERVISED, ALONE):
            localizer = self._amcl(seed)
        elif self.name == MATCHING:
            localizer = self._matching()
        else:
            cls: Any = LOCALIZERS.get(self.name).cls
            localizer = cls(self._params(cls.Params, self.values), seed=seed)
        return localizer, lambda: localizer.possible_poses()[0]

    def _matching(self) -> Localizer:
        params: SearchingParams = self._params(SearchingParams, self.values)
        matcher = ScanMatcher(ScanMatcherParams(**params.model_dump(include=set(ScanMatcherParams.model_fields))))
        return SearchingLocalizer(matcher, params) if params.search else matcher

    def _amcl(self, seed: int) -> Localizer:
        supervised = self.name == SUPERVISED
        search = {k: v for k, v in self.values.items() if supervised and k in SearchingParams.model_fields}
        own = {key: value for key, value in self.values.items() if key in AmclParams.model_fields}
        other = [key for key in self.values if key not in search and key not in own]
        if other:
            raise InputError(
                f"{self.name} has no parameter {short_repr(other[0])}; `navstack localize --help` names where to look"
            )
        written = {} if self.amcl is None else self.amcl.model_dump(include=self.amcl.model_fields_set)
        amcl = Amcl(self._params(AmclParams, {**written, **own}), seed=seed)
        return SearchingLocalizer(amcl, self._params(SearchingParams, search)) if supervised else amcl

    def _params(self, model: type[Any], values: dict[str, Any]) -> Any:
        try:
            return model(**values)
        except ValidationError as exc:
            first = exc.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the parameters"
            raise InputError(f"{self.name}: {where}: {first['msg']}, not {short_repr(first['input'])}") from None
