"""Editable copies of the YAML files that parameter sources load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from navstack.parameters.sources import packaged_folder, packaged_sets, read_sources, split_namespace
from navstack.parameters.yaml_editor import YamlEditor


@dataclass(frozen=True, slots=True)
class SourceCopy:
    """One file."""

    shown: str
    """Its name in locations."""
    name: str
    """Its name in the new folder."""
    path: Path
    """The user's file."""
    editor: YamlEditor


class SourceCopies:
    """All files of the sources, with new names; several sources get a numbered folder each."""

    def __init__(self, sources: Sequence[str]) -> None:
        self.by_shown: dict[str, SourceCopy] = {}
        params: list[str] = []
        self.movable = True
        """False for sources that cannot be copied: launch files refer to files by their own location."""
        for number, source in enumerate(sources, 1):
            found = self._add_source(source, f"{number}/" if len(sources) > 1 else "")
            if found is None:
                self.movable = False
            else:
                params.append(found)
        self.params = tuple(params)
        """The copies as values of `--params`, relative to the new folder (`.`: the folder itself)."""

    def _add_source(self, source: str, prefix: str) -> str | None:
        """Adds the files of a source; its value of `--params`, or None if it cannot be copied."""
        text, namespace = split_namespace(source)
        packaged = text in packaged_sets()
        path = packaged_folder(text) if packaged else Path(text)
        suffix = f"@{namespace}" if namespace else ""
        if path.is_dir():
            shown = text if packaged else text.rstrip("/") or "/"
            names = read_sources([source]).files
            if any(name.endswith((".launch", ".xml")) for name in names):
                return None  # loaded through its launch file
            for name in names:
                relative = name.removeprefix(f"{shown}/")
                self._add_file(path / relative, name, f"{prefix}{relative}")
            return (prefix.rstrip("/") or ".") + suffix
        if path.suffix in (".launch", ".xml") or not path.is_file():
            return None
        self._add_file(path, text, f"{prefix}{path.name}")
        return f"{prefix}{path.name}{suffix}"

    def _add_file(self, path: Path, shown: str, name: str) -> None:
        editor = YamlEditor(path.read_bytes().decode("utf-8"))
        self.by_shown.setdefault(shown, SourceCopy(shown, name, path, editor))

    def files(self) -> dict[str, str]:
        """The edited text of each file, by its name in the new folder."""
        return {c.name: c.editor.text() for c in self.by_shown.values()}

    def originals(self) -> dict[str, Path]:
        """The user's file of each copy, by the copy's name."""
        return {c.name: c.path for c in self.by_shown.values()}
