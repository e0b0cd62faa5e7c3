"""What every test may use: where the golden data and the foreign data lie."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


def _folder(variable: str, default: Path) -> Path:
    return Path(os.environ.get(variable) or default)


@pytest.fixture(scope="session")
def golden_dir() -> Path:
    """The folder of what C++ computed; skips where it is absent."""
    folder = _folder("NAVSTACK_GOLDEN", SHARED / "golden")
    if not folder.is_dir():
        pytest.skip("no golden data here: set NAVSTACK_GOLDEN to their folder")
    return folder


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of foreign maps, parameters and problems; skips where it is absent."""
    folder = _folder("NAVSTACK_DATA", SHARED / "data")
    if not folder.is_dir():
        pytest.skip("no foreign data here: set NAVSTACK_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def reference_dir() -> Path:
    """The folder of what was read from ROS's code; skips where it is absent."""
    folder = _folder("NAVSTACK_REFERENCE", SHARED / "reference")
    if not folder.is_dir():
        pytest.skip("no reference here: set NAVSTACK_REFERENCE to its folder")
    return folder


def golden_files(pattern: str) -> list[Path]:
    """Cases by name pattern, for parametrize; empty where the folder is absent."""
    return sorted(_folder("NAVSTACK_GOLDEN", SHARED / "golden").glob(pattern))


def data_files(pattern: str) -> list[Path]:
    """Foreign data by name pattern, for parametrize; empty where the folder is absent."""
    return sorted(_folder("NAVSTACK_DATA", SHARED / "data").glob(pattern))
