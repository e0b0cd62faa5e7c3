"""The third part of Nav2's golden data: planners, checkers, layers.

Their folder is NAVSTACK_GOLDEN_NAV2_W3 (default `../shared/golden_nav2_w3`).
"""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import SHARED

FOLDER = Path(os.environ.get("NAVSTACK_GOLDEN_NAV2_W3", SHARED / "golden_nav2_w3"))
ABSENT = "the golden data of Nav2 are absent: set NAVSTACK_GOLDEN_NAV2_W3 to their folder"
needs_data = pytest.mark.skipif(not FOLDER.is_dir(), reason=ABSENT)


@cache
def arrays(name: str) -> dict[str, np.ndarray]:
    """The arrays of `<name>.npz` by key."""
    return dict(np.load(FOLDER / f"{name}.npz"))


@cache
def jobs(name: str) -> dict[str, dict[str, Any]]:
    """The jobs of `<name>_jobs.json`; none if the data are absent."""
    path = FOLDER / f"{name}_jobs.json"
    return json.loads(path.read_text()) if path.is_file() else {}


def split(values: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    """The parts of concatenated arrays."""
    return np.split(values, np.cumsum(counts.astype(np.int64))[:-1])


def values_of(job: dict[str, Any]) -> dict[str, Any]:
    """The parameters of a job without the name of the plugin."""
    return {key.split(".", 1)[1]: value for key, value in job["params"].items()}
