"""The run as text: one event a line, for people and for `diff`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

from navstack.record.format import dump_json


def render_log(meta: dict[str, Any], events: list[dict[str, Any]]) -> str:
    """The scenario as YAML; time (s), kind and text of every event, a line each; how each goal ended. No wall-clock times."""
    lines = [f"# navstack run, format {meta['version']}", "# scenario:", *_scenario(meta["scenario"])]
    # what is said again and again (a planner that is asked five times a second) takes one line with its count
    for event, count, until in _runs(events):
        again = f" (and {count - 1} times more until {until:.3f} s)" if count > 1 else ""
        line = f"{event['time']:10.3f}  {_one_line(event['kind']):<14}  {_one_line(event['text'])}{again}"
        lines.append(line.rstrip())
    lines += [f"# goal {i} {dump_json(result)}" for i, result in enumerate(meta["results"])]
    return "\n".join(lines) + "\n"


def _scenario(told: dict[str, Any]) -> Iterator[str]:
    """The scenario as a block of YAML, its parameters last."""
    ordered = {key: value for key, value in told.items() if key != "parameters"}
    ordered |= {key: value for key, value in told.items() if key == "parameters"}
    text = yaml.dump(
        ordered, Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
    )
    return (f"#   {_one_line(line)}" for line in text.splitlines())


def _runs(events: list[dict[str, Any]]) -> list[tuple[dict[str, Any], int, float]]:
    """Successive events of one kind and text as one: the first, how many, the time of the last."""
    runs: list[tuple[dict[str, Any], int, float]] = []
    for event in events:
        if runs and (runs[-1][0]["kind"], runs[-1][0]["text"]) == (event["kind"], event["text"]):
            first, count, _ = runs[-1]
            runs[-1] = (first, count + 1, event["time"])
        else:
            runs.append((event, 1, event["time"]))
    return runs


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
