"""docs/reference/scenarios.md lists every field of the models of shapes, motions, tours and conditions.

`NAVSTACK_WRITE_SCENARIOS=1 pytest tests/scenario/test_reference.py` rewrites its tables.
"""

from __future__ import annotations

import os
from pathlib import Path

from navstack.parameters.report import table_of
from navstack.plugins import ParamModel
from navstack.scenario.low_battery import LowBattery
from navstack.scenario.spec import Tour
from navstack.scenario.steps import DockStep, UndockStep
from navstack.scenario.success import Success
from navstack.sim import MOTIONS, Shape

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "scenarios.md"
BEGIN, END = "<!-- tables: written by a test -->", "<!-- end of the tables -->"
SECTIONS: dict[str, type[ParamModel]] = {
    "`shapes:` an entry": Shape,
    **{f"`motion:` of the kind `{kind}`": model for kind, model in MOTIONS.items() if kind != "still"},
    "`tour:`": Tour,
    "`low_battery:`": LowBattery,
    "`goals:` a step `dock`": DockStep,
    "`goals:` a step `undock`": UndockStep,
    "`success:`": Success,
}


def tables() -> str:
    parts: list[str] = []
    for title, model in SECTIONS.items():
        assert model.__doc__ is not None
        about = model.__doc__.strip().splitlines()[0].removeprefix(f"{title} ")
        parts += [f"### {title}", "", about[0].upper() + about[1:], "", *table_of(model), ""]
    return "\n".join(parts)


def test_the_page_lists_the_fields_of_the_models() -> None:
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    there, _, tail = rest.partition(END)
    if os.environ.get("NAVSTACK_WRITE_SCENARIOS"):
        PAGE.write_text(f"{head}{BEGIN}\n\n{tables()}\n{END}{tail}", encoding="utf-8")
        return
    assert there.strip() == tables().strip()
