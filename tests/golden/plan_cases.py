"""The stored queries of a planner: files with one or several cases, each with a prefix of its arrays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.conftest import golden_files


class Case(NamedTuple):
    file: Path
    prefix: str

    def __str__(self) -> str:
        return f"{self.file.stem}/{self.prefix}".rstrip("/")

    def load(self) -> dict[str, NDArray[Any]]:
        with np.load(self.file) as z:
            return {k.removeprefix(self.prefix): z[k] for k in z.files if k.startswith(self.prefix)}


def cases(pattern: str) -> Iterator[Case]:
    """The cases of all golden files of a name."""
    for file in golden_files(pattern):
        with np.load(file) as z:
            for key in z.files:
                if key.endswith("query"):
                    yield Case(file, key.removesuffix("query"))
