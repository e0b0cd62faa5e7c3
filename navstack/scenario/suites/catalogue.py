"""Named suites of scenarios: those shipped with navstack, and suites for tuning and for comparing parameters.

    for spec in load_suite("office"):
        result = run_scenario(spec.build(params=["mine"], seed=3), record=False)

A generated suite is an unlimited list: scenario number n is always the same. Even numbers are the training split, odd numbers
are held out to validate what was tuned on the training split.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

from navstack.core.errors import InputError
from navstack.parameters.spelling import nearest
from navstack.scenario.file.spec import ScenarioSpec, read_scenario
from navstack.scenario.suites.barn_worlds import barn_scenarios
from navstack.scenario.suites.generated import (
    crowd_scenario,
    narrow_scenario,
    office_scenario,
    warehouse_scenario,
)

Split = Literal["train", "held_out", "all"]

_SPLITS: Final[dict[str, tuple[int, int]]] = {"train": (0, 2), "held_out": (1, 2), "all": (0, 1)}
"""Name -> first number and step."""
_GENERATED: Final[dict[str, Callable[[int], ScenarioSpec]]] = {
    "office": office_scenario,
    "narrow": narrow_scenario,
    "crowd": crowd_scenario,
    "warehouse": warehouse_scenario,
}

DEFAULT_COUNT: Final = 16
"""Default number of scenarios of a generated suite: half for training, half held out."""


def shipped_scenarios() -> dict[str, Path]:
    """Returns the scenario files shipped with navstack, by name."""
    folder = Path(__file__).parent / "files"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def suite_names() -> list[str]:
    """Returns the names that `load_suite` accepts."""
    return sorted([*_GENERATED, "barn", "shipped"])


def load_suite(
    name: str, *, split: Split = "all", count: int | None = None, directory: Path | None = None
) -> list[ScenarioSpec]:
    """Returns the scenarios of a suite. `ScenarioSpec.build` sets their parameters and seed.

    - `office`: between rooms of an office, with a few objects that are not on the map.
    - `narrow`: rooms whose doors are 0.55 to 0.75 m wide.
    - `crowd`: through an office with pedestrians in its corridor.
    - `warehouse`: between the racks of a warehouse, with a few boxes that are not on the map.
    - `barn`: the BARN worlds in `directory` (with `worlds.npz`) for a Jackal without a map.
    - `shipped`: the scenario files shipped with navstack.

    `split`: `train` has the even numbers, `held_out` the odd ones. `count` limits the scenarios of the split (default: 16, or 8
    of a split; all of `barn` and `shipped`). The same arguments give the same scenarios on every machine. Raises InputError
    for an unknown name or split, ScenarioError for an invalid shipped file.
    """
    if split not in _SPLITS:
        raise InputError(f'unknown split "{split}"; known splits: {", ".join(_SPLITS)}', split=split)
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it must be at least 1", count=count)
    first, step = _SPLITS[split]
    if name == "shipped":
        return [read_scenario(path) for path in list(shipped_scenarios().values())[first::step][:count]]
    if name == "barn":
        return barn_scenarios(directory)[first::step][:count]
    if name not in _GENERATED:
        close = nearest(name, suite_names())
        hint = f'did you mean "{close}"?' if close else f"known suites: {', '.join(suite_names())}"
        raise InputError(f'unknown suite "{name}"; {hint}', suite=name, known=suite_names())
    if count is None:
        count = DEFAULT_COUNT if split == "all" else DEFAULT_COUNT // 2
    return [_GENERATED[name](number) for number in range(first, first + step * count, step)]
