"""Write a robot's parameters with current names.

Renamed keys are replaced in copies of the files, which keep their comments, order and layout. The layout from before ROS Hydro,
launch files and mappings are written as one file that contains the values set, without comments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.findings import Finding
from navstack.parameters.report.document import as_yaml, parameters_of
from navstack.parameters.sources import packaged_folder, packaged_sets, read_sources

SINGLE_FILE = "move_base_params.yaml"
"""Name of the single file; in a folder it has the role of move_base's own parameters."""


@dataclass(frozen=True, slots=True)
class Migration:
    """The files to write."""

    files: dict[str, str]
    """Path relative to the new folder -> text."""
    renamed: tuple[tuple[str, str], ...]
    """Former and current names, sorted by file and line."""
    why_whole: str = ""
    """Why there is a single file without comments; empty if the files keep their layout."""


def migrate(
    sources: Sequence[str],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Migration:
    """Return the files of a robot with current names; raise ParameterError as `load_configuration`."""
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
        why = "a renamed key cannot be replaced in place (it is an anchor or a key of another file)"
    text = as_yaml(parameters_of(configuration), [f"{why}:", "the values set, with their origins"], written_only=True)
    return Migration({SINGLE_FILE: text}, renamed, why)


def _old_name(f: Finding) -> str:
    return f.key.rpartition("/")[2]


def _why_whole(sources: Sequence[str], configuration: Configuration, changed: bool) -> str:
    """Why the files cannot be kept; empty if they can."""
    if any(f.rule == "pre-hydro" for f in configuration.findings):
        return "the layout from before ROS Hydro was converted to lists of layers"
    if any(f.rule == "through-launch" for f in configuration.findings):
        return "the folder is loaded through its launch file"
    if changed:
        return "values were changed on the command line"
    if len(sources) != 1 or not (Path(sources[0]).is_dir() or sources[0] in packaged_sets()):
        return "the source is not a single folder"
    return ""


def _copies(source: str, renames: Sequence[Finding]) -> dict[str, str] | None:
    """The loaded files of the folder with the keys replaced; None if a key is not at the location of its finding."""
    folder = packaged_folder(source) if source in packaged_sets() else Path(source)
    shown = source if source in packaged_sets() else source.rstrip("/") or "/"
    files: dict[str, str] = {}
    for name in read_sources([source]).files:
        relative = name.removeprefix(f"{shown}/")
        text = (folder / relative).read_bytes().decode("utf-8-sig")
        lines = text.splitlines(keepends=True)
        # from the end, so that earlier locations stay valid
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
