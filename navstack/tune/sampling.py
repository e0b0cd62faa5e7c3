"""Candidates of a sweep: a grid, random points, or a Latin hypercube (McKay, Beckman, Conover, Technometrics 1979)."""

from __future__ import annotations

import itertools
import math
from typing import Final

from navstack.core.errors import InputError
from navstack.tune.space import SearchSpace, Value

METHODS: Final = ("grid", "random", "lhs")
MAX_CANDIDATES: Final = 1_000_000


def candidates(space: SearchSpace, method: str, *, samples: int, points: int, seed: int) -> list[dict[str, Value]]:
    """The candidates of a sweep; a pure function of its arguments.

    `samples`: number of candidates for `random` and `lhs`; `points`: values per range for `grid`. Raises InputError for an
    unknown method and for a grid of more than a million candidates.
    """
    if method == "grid":
        return _grid(space, points)
    if method not in METHODS:
        raise InputError(
            f'--method "{method}": unknown method; choose {", ".join(METHODS)}', argument="--method", value=method
        )
    if samples < 1:
        raise InputError(f"--samples {samples}: give at least 1", argument="--samples", value=samples)
    shares = _random(samples, len(space), seed) if method == "random" else _latin(samples, len(space), seed)
    return [{d.name: d.at(share) for d, share in zip(space, row, strict=True)} for row in shares]


def _grid(space: SearchSpace, points: int) -> list[dict[str, Value]]:
    if points < 1:
        raise InputError(f"--points {points}: give at least 1", argument="--points", value=points)
    axes = [d.grid(points) for d in space]
    many = math.prod(len(axis) for axis in axes)
    if many > MAX_CANDIDATES:
        counts = " x ".join(str(len(axis)) for axis in axes)
        raise InputError(
            f"the grid has {counts} = {many} candidates; give fewer --points or --param, or --method lhs --samples N",
            candidates=many,
        )
    names = [d.name for d in space]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*axes)]


def _random(samples: int, dimensions: int, seed: int) -> list[list[float]]:
    import numpy as np

    rows: list[list[float]] = np.random.Generator(np.random.PCG64(seed)).random((samples, dimensions)).tolist()
    return rows


def _latin(samples: int, dimensions: int, seed: int) -> list[list[float]]:
    import numpy as np
    from scipy.stats import qmc

    generator = np.random.Generator(np.random.PCG64(seed))
    rows: list[list[float]] = qmc.LatinHypercube(dimensions, rng=generator).random(samples).tolist()
    return rows
