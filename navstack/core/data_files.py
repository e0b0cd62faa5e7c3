"""Locate the data that ship with navstack: `params/` (parameter sets) and `maps/` (maps with their places).

In a checkout or an editable install they are at the top of the repository; a wheel carries them inside the package.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

from navstack.core.errors import NavError

_PACKAGE = Path(__file__).resolve().parent.parent


@cache
def data_folder(kind: Literal["params", "maps"]) -> Path:
    """The folder of the packaged parameter sets or maps.

    Raises NavError if there is none, for example if navstack is imported from a zip archive.
    """
    top = _PACKAGE.parent
    folder = top / kind if (top / "pyproject.toml").is_file() else _PACKAGE / kind
    if folder.is_dir():
        return folder
    raise NavError(
        f"the packaged {kind} were not found in {folder}; navstack cannot run from a zip archive, install it with pip",
        folder=str(folder),
    )
