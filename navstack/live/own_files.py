"""The parameter sets that a page may switch to: packaged ones, those of the command line, those in the folder of `--save-to`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from navstack.core.errors import InputError, NavError
from navstack.core.files import is_dir, is_file, resolved
from navstack.parameters.configuration import load_configuration
from navstack.parameters.sources import packaged_sets

MAX_FILES = 40
"""Most files of the folder that are looked at."""
_SUFFIXES = (".yaml", ".yml")


class OwnFiles:
    """Looks up sets by the names that a page shows. A page never names a path: a name is one of these, or it is refused."""

    def __init__(self, named: Sequence[Sequence[str]] = (), folder: Path | None = None) -> None:
        """`named` are the `--params` of each robot on the command line; `folder` is that of `--save-to`."""
        sources = {" + ".join(names): list(names) for names in named if names}
        self._named = {name: found for name, found in sources.items() if name not in packaged_sets()}
        self._folder = folder

    def names(self) -> dict[str, list[str]]:
        """Returns the names by where they come from: `packaged`, `named`, `folder`. Files that are no parameters are left out."""
        found = [name for name, path in self._in_folder().items() if _is_configuration(path)]
        return {"packaged": packaged_sets(), "named": list(self._named), "folder": found}

    def load(self, name: str) -> str | dict[str, Any]:
        """Returns a packaged set's name, or all parameters of the user's files as `SetParameters.params` takes them.

        Raises InputError for another name, ParameterError for files with errors.
        """
        if name in packaged_sets():
            return name
        sources = self._named.get(name)
        if sources is None:
            inside = self._in_folder()
            if name not in inside:
                known = ", ".join([*packaged_sets(), *self._named, *inside])
                raise InputError(f'"{name}" is not one of the sets of this session: {known}')
            sources = [str(inside[name])]
        return load_configuration(sources).tree.as_dict()

    def _in_folder(self) -> dict[str, Path]:
        """Files and folders that may be parameters, directly in the folder, by name; links that lead out of it are left out."""
        folder = self._folder
        if folder is None or not is_dir(folder):
            return {}
        inside = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        return {
            path.name: path
            for path in inside[:MAX_FILES]
            if resolved(path).parent == resolved(folder) and (_is_yaml(path) or _has_yaml(path))
        }


def _is_yaml(path: Path) -> bool:
    return path.suffix in _SUFFIXES and is_file(path)


def _has_yaml(path: Path) -> bool:
    return is_dir(path) and any(_is_yaml(inner) for inner in path.iterdir())


def _is_configuration(path: Path) -> bool:
    try:
        load_configuration([str(path)])
    except (NavError, OSError):
        return False
    return True
