"""Search for parameters of DWA that depend on the scan, as APPL learns them; compare them with the fixed ones.

    pip install 'navstack[gym]'
    python examples/learning/adapt.py --out adapted.json --barn FOLDER

The cross-entropy method searches twice from the values of the parameter file: for other constants, and for a policy that sets
them every half second from three features of the scan. Training worlds are generated as BARN's were; with `--barn` the comparison
drives through the published ones, otherwise through generated worlds that are held out. The cost of a drive is its time, 50 s for
one that collides or does not arrive.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import navstack.gym  # noqa: F401  # pyright: ignore[reportUnusedImport]  registers the environments

PERIOD_S, LIMIT_S = 0.5, 50.0
ROBOT = "jackal_dwa"
PARAMETERS = (
    "DWAPlannerROS/max_vel_x=0.3:2.0",
    "DWAPlannerROS/max_vel_theta=0.5:3.0",
    "DWAPlannerROS/sim_time=0.8:2.4",
    "DWAPlannerROS/path_distance_bias=5:60",
    "DWAPlannerROS/occdist_scale=0.005:0.2",
)
KINDS = ("constant", "adaptive")


def make(levels: str, split: str, count: int, seed: int) -> gymnasium.Env:
    """Make the environment; the limit of the speed is that of the Jackal, so that `max_vel_x` decides."""
    return gymnasium.make(
        "navstack/PlannerParams-v0",
        levels=levels,
        split=split,
        count=count,
        level_seed=seed,
        robot=ROBOT,
        overrides=["DWAPlannerROS/max_vel_trans=2.0"],
        parameters=PARAMETERS,
        period=PERIOD_S,
        collision="end",
        beams=180,
    )


def features(observation: dict[str, NDArray[np.float32]]) -> NDArray[np.float64]:
    """Return (4,): 1, the nearest range ahead, the nearest beside, and the mean, each from -1 (touching) to 1 (5 m)."""
    scan = observation["scan"].astype(np.float64)
    middle, narrow = len(scan) // 2, len(scan) // 14  # 20 degrees of 270
    ahead = scan[middle - narrow : middle + narrow + 1].min()
    beside = min(scan[: middle - narrow].min(), scan[middle + narrow + 1 :].min())
    return np.array([1.0, 2.0 * ahead - 1.0, 2.0 * beside - 1.0, 2.0 * scan.mean() - 1.0])


def drive(env: gymnasium.Env, level: int, weights: NDArray[np.float64]) -> tuple[float, dict[str, Any]]:
    """Drive through a level; `weights` (parameters, 4): how each parameter departs from the file's value. Return cost, info."""
    observation, _ = env.reset(seed=0, options={"level": level})
    initial = observation["parameters"].astype(np.float64)
    while True:
        action = np.clip(initial + weights @ features(observation), -1.0, 1.0)
        observation, _, terminated, truncated, info = env.step(action.astype(np.float32))
        if terminated or truncated:
            return (info["time_to_goal"] if info["is_success"] else LIMIT_S), info


def search(
    cost: Callable[[NDArray[np.float64], NDArray[np.int64]], float],
    size: int,
    *,
    levels: int,
    generations: int,
    population: int,
    worlds: int,
    seed: int,
) -> NDArray[np.float64]:
    """Minimize by the cross-entropy method from 0; every generation sees other worlds, all its candidates the same."""
    rng = np.random.default_rng(seed)
    mean, deviation = np.zeros(size), np.full(size, 0.3)
    for generation in range(generations):
        drawn = rng.choice(levels, worlds, replace=False)
        candidates = mean + deviation * rng.standard_normal((population, size))
        candidates[0] = mean
        costs = np.array([cost(candidate, drawn) for candidate in candidates])
        best = candidates[np.argsort(costs)[: max(2, population // 4)]]
        mean = 0.5 * mean + 0.5 * best.mean(axis=0)
        deviation = 0.7 * deviation + 0.3 * np.maximum(best.std(axis=0), 0.05)
        print(
            f"generation {generation}: mean of the candidates {costs.mean():.2f} s, best {costs.min():.2f} s",
            flush=True,
        )
    return mean


def train(options: argparse.Namespace) -> dict[str, list[list[float]]]:
    """Search for constants and for a policy; return the weights of each, which are also written, and not searched again."""
    env = make("barn", "train", options.worlds, 0)
    size = len(PARAMETERS)
    found = json.loads(options.out.read_text()) if options.out.exists() else {}
    for kind in KINDS:
        if kind in found:
            continue

        def spread(values: NDArray[np.float64], kind: str = kind) -> NDArray[np.float64]:
            weights = np.zeros((size, 4))
            if kind == "constant":
                weights[:, 0] = values
            else:
                weights[:] = values.reshape(size, 4)
            return weights

        def cost(values: NDArray[np.float64], drawn: NDArray[np.int64]) -> float:
            return float(np.mean([drive(env, int(level), spread(values))[0] for level in drawn]))

        values = search(
            cost,
            size if kind == "constant" else 4 * size,
            levels=options.worlds,
            generations=options.generations,
            population=options.population,
            worlds=4,
            seed=options.seed,
        )
        found[kind] = spread(values).tolist()
        options.out.write_text(json.dumps(found, indent=1))
    return found


def interval(differences: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % interval of the mean over the worlds, by a bootstrap of 10,000 resamples."""
    rng = np.random.default_rng(0)
    means = differences[rng.integers(len(differences), size=(10_000, len(differences)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return low, high


def compare(found: dict[str, list[list[float]]], levels: str, split: str, count: int) -> None:
    """Drive every held-out world with each; print success, cost, and the differences from the fixed file with intervals."""
    env = make(levels, split, count, 1)
    number = len(env.get_wrapper_attr("levels"))
    costs: dict[str, NDArray[np.float64]] = {}
    print(f"{number} worlds; cost: time (s), {LIMIT_S:g} for a drive without success; less is better")
    for kind in ("fixed", *KINDS):
        weights = np.zeros((len(PARAMETERS), 4)) if kind == "fixed" else np.array(found[kind])
        drives = [drive(env, level, weights) for level in range(number)]
        costs[kind] = np.array([cost for cost, _ in drives])
        success = np.mean([info["is_success"] for _, info in drives])
        collided = sum(info["outcome"] == "collision" for _, info in drives)
        print(
            f"{kind:<9} success {success:.2f}, collisions {collided}, mean cost {costs[kind].mean():.2f} s", flush=True
        )
    for kind, reference in (("constant", "fixed"), ("adaptive", "fixed"), ("adaptive", "constant")):
        difference = costs[kind] - costs[reference]
        low, high = interval(difference)
        says = "no difference shown" if low <= 0.0 <= high else "less" if high < 0.0 else "more"
        print(f"{kind} - {reference}: {difference.mean():+.2f} s [{low:+.2f}, {high:+.2f}]: {says}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=40, help="training worlds")
    parser.add_argument("--generations", type=int, default=7)
    parser.add_argument("--population", type=int, default=10)
    parser.add_argument("--count", type=int, default=50, help="worlds of the comparison")
    parser.add_argument("--barn", type=Path, help="folder with BARN's worlds.npz for the comparison")
    parser.add_argument(
        "--out", type=Path, default=Path("adapted.json"), help="what is found; a search in it is not repeated"
    )
    options = parser.parse_args()
    found = train(options)
    if options.barn:
        compare(found, str(options.barn), "all", options.count)
    else:
        compare(found, "barn", "held_out", options.count)


if __name__ == "__main__":
    main()
