"""Samplers, distributions, pruning and importance with Optuna."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

from navstack.core.errors import InputError
from navstack.core.optional_dependencies import require
from navstack.tune.problem import Problem, Trial
from navstack.tune.space import Dimension

SAMPLERS: Final = ("tpe", "cmaes", "random")
_PRUNING_P: Final = 0.1
"""A trial is pruned if the signed-rank test finds it worse with this p-value."""
_LEAST_TRIALS: Final = 10
"""Importance needs at least this many trials."""


def load_optuna() -> Any:
    """The module. Raises InputError if it is missing."""
    return require("optuna", "tuning")


@contextmanager
def without_warnings() -> Generator[None]:
    """Suppresses warnings of experimental features of Optuna."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def check_sampler(name: str, objectives: int) -> None:
    """Raises InputError for an unknown sampler and one that does not support several objectives."""
    if name not in SAMPLERS:
        raise InputError(f'--sampler "{name}": unknown sampler; choose {", ".join(SAMPLERS)}', argument="--sampler")
    if name == "cmaes" and objectives > 1:
        raise InputError("CMA-ES supports one objective only; choose --sampler tpe, or one --objective")


def make_sampler(name: str, seed: int, place: int) -> Any:
    """The sampler of the trial at a place in the study; its seed depends on the study's seed and the place."""
    samplers = load_optuna().samplers
    digest = hashlib.sha256(f"{seed} {place}".encode()).digest()
    trial_seed = int.from_bytes(digest[:4], "big")
    with without_warnings():
        if name == "random":
            return samplers.RandomSampler(seed=trial_seed)
        if name == "cmaes":
            return samplers.CmaEsSampler(
                seed=trial_seed, warn_independent_sampling=False
            )  # its state is in the storage
        return samplers.TPESampler(
            seed=trial_seed, n_startup_trials=12, multivariate=True, warn_independent_sampling=False
        )


def distribution_of(d: Dimension) -> Any:
    """Optuna's distribution of a dimension."""
    kinds = load_optuna().distributions
    if d.choices:
        return kinds.CategoricalDistribution(d.choices)
    if d.kind == "int":
        return kinds.IntDistribution(int(-(-d.low // 1)), int(d.high // 1), log=d.log)
    return kinds.FloatDistribution(d.low, d.high, log=d.log)


class Pruner:
    """Decides which trials are pruned.

    A trial is pruned as soon as perfect scores in the remaining cases could not make it the best, or when a signed-rank test
    (Wilcoxon, Biometrics Bulletin 1945) against the runs of the best trial shows that it is worse.
    """

    def __init__(self, problem: Problem, study: Any) -> None:
        self._problem = problem
        self._study = study
        self.enabled = [o.name for o in problem.objectives] == ["score"]
        """Only if the score of a run is the single objective."""
        with without_warnings():
            self._wilcoxon: Any = load_optuna().pruners.WilcoxonPruner(
                p_threshold=_PRUNING_P, n_startup_steps=max(5, len(problem.cases) // 4)
            )

    def prunes(self, trial: Any, scores: Sequence[float], best: float | None) -> bool:
        """True if a trial with these scores is to be pruned; `best`: the best mean score of a complete trial."""
        if best is None:
            return False
        cases = len(self._problem.cases)
        if (sum(scores) + (cases - len(scores)) * self._problem.evaluation.best_score) / cases < best:
            return True
        frozen = self._study.get_trials(deepcopy=False)[trial.number]
        with without_warnings():
            return bool(self._wilcoxon.prune(self._study, frozen))


def parameter_importance(
    problem: Problem, distributions: Mapping[str, Any], trials: Sequence[Trial]
) -> dict[str, float]:
    """Importance of each dimension (PED-ANOVA: Watanabe et al., IJCAI 2023), greatest first; empty for few trials.

    Pruned trials count with the mean of their runs: they contain most of the information on bad values.
    """
    if len(trials) < _LEAST_TRIALS or len({t.values[0] for t in trials}) < 3:
        return {}
    optuna = load_optuna()
    study = optuna.create_study(direction=problem.objectives[0].direction)
    for t in trials:
        study.add_trial(
            optuna.trial.create_trial(params=dict(t.candidate), distributions=dict(distributions), value=t.values[0])
        )
    with without_warnings():
        found: dict[str, float] = optuna.importance.get_param_importances(
            study, evaluator=optuna.importance.PedAnovaImportanceEvaluator()
        )
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))
