"""The libraries of the extra `tune`, and what is said where they are missing."""

from __future__ import annotations

import importlib
from typing import Any

from navstack.core.errors import InputError

_PACKAGES = {"ruamel.yaml": "ruamel.yaml", "distributed": "dask[distributed]"}


def need(module: str, purpose: str) -> Any:
    """The module, imported; `purpose` begins the sentence of the InputError that says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as exc:
        package = _PACKAGES.get(module, module.partition(".")[0])
        raise InputError(
            f"{purpose} needs {package}, which is not installed; install the extra `tune`: pip install '.[tune]' in a clone of "
            "navstack",
            module=module,
            install="navstack[tune]",
        ) from exc
