"""The record as text: one event per line, for reading and for `diff`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

from navstack.record.archive import dump_json


def render_log(meta: dict[str, Any], events: list[dict[str, Any]]) -> str:
    """Returns the scenario as YAML, a line per event (time in s, kind, text) and a line per goal result. No wall-clock times.

    The first event of each exception in a plugin has the traceback below it.
    """
    lines = [f"# navstack run, format {meta['version']}", "# scenario:", *_scenario(meta["scenario"])]
    tracebacks: set[str] = set()
    # repeated events (of a planner that runs five times per second) take one line with a count
    for event, count, until in _group_repeats(events):
        again = f" (repeated {count - 1} times until {until:.3f} s)" if count > 1 else ""
        line = f"{event['time']:10.3f}  {_one_line(event['kind']):<14}  {_one_line(event['text'])}{again}"
        lines.append(line.rstrip())
        trace = event.get("data", {}).get("traceback")
        if isinstance(trace, str) and trace not in tracebacks:
            tracebacks.add(trace)
            lines += [f"{'':28}{_one_line(line)}".rstrip() for line in trace.splitlines()]
    lines += [f"# goal {i} {dump_json(result)}" for i, result in enumerate(meta["results"])]
    return "\n".join(lines) + "\n"


def _scenario(scenario: dict[str, Any]) -> Iterator[str]:
    """Yields the scenario as lines of YAML, its parameters last."""
    ordered = {key: value for key, value in scenario.items() if key != "parameters"}
    ordered |= {key: value for key, value in scenario.items() if key == "parameters"}
    text = yaml.dump(
        ordered, Dumper=yaml.SafeDumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
    )
    return (f"#   {_one_line(line)}" for line in text.splitlines())


def _group_repeats(events: list[dict[str, Any]]) -> list[tuple[dict[str, Any], int, float]]:
    """Groups consecutive events with the same kind and text: the first, the count, the time of the last."""
    groups: list[tuple[dict[str, Any], int, float]] = []
    for event in events:
        if groups and (groups[-1][0]["kind"], groups[-1][0]["text"]) == (event["kind"], event["text"]):
            first, count, _ = groups[-1]
            groups[-1] = (first, count + 1, event["time"])
        else:
            groups.append((event, 1, event["time"]))
    return groups


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
