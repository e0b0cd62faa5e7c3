"""The run as text: one event a line, for people and for `diff`."""

from __future__ import annotations

from typing import Any

from navstack.record.format import dump_json


def render_log(meta: dict[str, Any], events: list[dict[str, Any]]) -> str:
    """Time (s), kind and text of every event, a line each; then how each goal ended. No wall-clock times."""
    lines = [f"# navstack run, format {meta['version']}", f"# scenario {dump_json(meta['scenario'])}"]
    lines += [
        f"{event['time']:10.3f}  {_one_line(event['kind']):<14}  {_one_line(event['text'])}".rstrip()
        for event in events
    ]
    lines += [f"# goal {i} {dump_json(result)}" for i, result in enumerate(meta["results"])]
    return "\n".join(lines) + "\n"


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
