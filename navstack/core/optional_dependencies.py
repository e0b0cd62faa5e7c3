"""Imports of libraries that come with an optional extra of navstack."""

from __future__ import annotations

import importlib
from typing import Any, Final

from navstack.core.errors import InputError

_EXTRAS: Final = {
    "foxglove": "foxglove",
    "paho": "fleet",
    "gymnasium": "gym",
    "pettingzoo": "gym",
    "onnxruntime": "gym",
    "aiohttp": "live",
    "rosbags": "bags",
    "lz4": "bags",
    "mcap": "mcap",
    "pytest": "test",
}
"""Name of the extra that contains a module, if it is not `tune`."""
_PACKAGES: Final = {
    "ruamel.yaml": "ruamel.yaml",
    "distributed": "dask[distributed]",
    "foxglove": "foxglove-sdk",
    "paho.mqtt.client": "paho-mqtt",
}
"""Name of the package, where it is not the first part of the module's name."""


def require(module: str, purpose: str) -> Any:
    """Imports an optional module.

    Raises InputError, with the command to install it, if it is missing; `purpose` is the subject of the message.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        first = module.partition(".")[0]
        extra = _EXTRAS.get(first, "tune")
        package = _PACKAGES.get(module, first)
        raise InputError(
            f"{purpose} needs {package}, which is not installed; install the extra `{extra}`: pip install '.[{extra}]' in a "
            "clone of navstack",
            module=module,
            install=f"navstack[{extra}]",
        ) from None
