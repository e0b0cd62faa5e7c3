"""Locate the data that ship with navstack: `params/` (parameter sets) and `maps/` (maps with their places).

A checkout and an editable install have them at the top of the repository; a wheel carries them inside the package.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

from navstack.core.errors import NavError

_PACKAGE = Path(__file__).resolve().parent.parent


@cache
def data_folder(kind: Literal["params", "maps"]) -> Path:
    """Return the folder of the packaged parameter sets or maps.

    Raises NavError if it does not exist, for example if navstack is imported from a zip archive.
    """
    top = _PACKAGE.parent
    in_package, at_top = _PACKAGE / kind, top / kind
    # pyproject.toml distinguishes a checkout from a folder of that name next to an installed package
    folder = at_top if (top / "pyproject.toml").is_file() and at_top.is_dir() else in_package
    if folder.is_dir():
        return folder
    raise NavError(
        f"the packaged {kind} were not found in {folder}; install navstack with pip (it cannot run from a zip archive)",
        folder=str(folder),
    )
