"""The reference page is up to date with the models."""

from __future__ import annotations

from pathlib import Path

from navstack.parameters.report import reference
from navstack.plugins import REGISTRIES

CHECKED_IN = Path(__file__).parents[2] / "docs" / "reference" / "parameters.md"


def test_it_is_up_to_date() -> None:
    assert CHECKED_IN.read_text(encoding="utf-8") == reference(), (
        "a model has changed: run `navstack params reference --out docs/reference/parameters.md`"
    )


def test_every_plugin_and_every_parameter_is_listed() -> None:
    text = reference()
    for registry in REGISTRIES:
        for entry in registry:
            if entry.origin != "navstack":
                continue
            model = entry.cls.Params
            for name in model.model_fields:
                if name != model.CHILD_FIELD and name not in model.FROM_NAVSTACK:
                    assert f"| `{name}` |" in text, f"{entry.name}: {name}"
            for old, new in model.RENAMED.items():
                assert f"`{old}` → `{new}`" in text
    dwa = next(line for line in text.splitlines() if line.startswith("| `acc_lim_x`"))
    assert dwa == "| `acc_lim_x` | `2.5` | m/s² | [0, 20] | acceleration along x |"
