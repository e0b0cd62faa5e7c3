"""The same configuration with today's names.

Where only names are old, they alone are replaced in copies of the files: comments, order and layout stay. A layout that
is old (before ROS Hydro), a launch file or a mapping is written as one file of the values given, without comments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from navstack.parameters import Finding, packaged_folder, packaged_sets, read_sources
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.report.document import as_yaml, parameters_of

WHOLE = "move_base_params.yaml"
"""Name of the one file, which a folder's loading takes for move_base's own."""


@dataclass(frozen=True, slots=True)
class Migration:
    """What is to be written."""

    files: dict[str, str]
    """Name relative to the new folder -> text."""
    renamed: tuple[tuple[str, str], ...]
    """Former name, today's name; by file and line."""
    why_whole: str = ""
    """Why it is one file without comments; empty where the files stay as they are."""


def migrate(
    sources: Sequence[str],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Migration:
    """Today's names for a folder, or for files that make one folder; raises ParameterError as load_configuration."""
    configuration = load_configuration(sources, overrides=overrides, distro=distro, allow_missing=allow_missing)
    notes = {
        (f.file, f.line, f.column): f for f in configuration.findings if f.rule == "renamed" and f.severity == "info"
    }
    renames = [notes[place] for place in sorted(notes)]
    renamed = tuple((_old_name(f), str(f.suggestion)) for f in renames)
    changed = bool(overrides or distro or allow_missing)
    why = _why_whole(sources, configuration, changed)
    if not why:
        files = _copies(sources[0], renames)
        if files is not None:
            return Migration(files, renamed)
        why = "a renamed key is not written where it was read (an anchor, or a key in another file)"
    text = as_yaml(
        parameters_of(configuration), [f"{why}:", "the values that were given, where each stood"], written_only=True
    )
    return Migration({WHOLE: text}, renamed, why)


def _old_name(f: Finding) -> str:
    return f.key.rpartition("/")[2]


def _why_whole(sources: Sequence[str], configuration: Configuration, changed: bool) -> str:
    """Why the files cannot be kept; empty where they can."""
    if any(f.rule == "pre-hydro" for f in configuration.findings):
        return "the layout from before ROS Hydro became lists of layers"
    if changed:
        return "values were changed on the command line"
    if len(sources) != 1 or not (Path(sources[0]).is_dir() or sources[0] in packaged_sets()):
        return "not one folder of files"
    return ""


def _copies(source: str, renames: Sequence[Finding]) -> dict[str, str] | None:
    """The folder's loaded files with the keys replaced; None when a key is not where the finding says."""
    folder = packaged_folder(source) if source in packaged_sets() else Path(source)
    shown = source if source in packaged_sets() else source.rstrip("/") or "/"
    files: dict[str, str] = {}
    for name in read_sources([source]).files:
        relative = name.removeprefix(f"{shown}/")
        text = (folder / relative).read_bytes().decode("utf-8-sig")
        lines = text.splitlines(keepends=True)
        # from the end, so that the places of what comes before stay right
        for f in reversed([r for r in renames if r.file == name]):
            old, new = _old_name(f), str(f.suggestion)
            line = lines[f.line - 1]
            at = f.column - 1
            at += line[at : at + 1] in ("'", '"')
            if line[at : at + len(old)] != old:
                return None
            lines[f.line - 1] = line[:at] + new + line[at + len(old) :]
        files[relative] = "".join(lines)
    return files
