"""The search itself: Optuna asks, runs are shared out, results are told, and all of it survives a kill.

A trial is a candidate driven over every case, one run after the other, in an order that is the same for all. It is given
up as soon as even perfect runs could not make it the best, or as a signed-rank test (Wilcoxon, Biometrics Bulletin 1945)
against the best trial's runs says that it is worse. Each trial's sampler has a seed of its own, made of the study's seed
and the trial's place, so that on one worker a study that was killed goes on as if nothing had happened.
"""

from __future__ import annotations

import hashlib
import json
import random
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from navstack import __version__
from navstack.core.errors import InputError
from navstack.jobs import Executor
from navstack.parameters.configuration import Configuration
from navstack.parameters.report import parameters_of
from navstack.tune.courses import Case, Course
from navstack.tune.extras import need
from navstack.tune.objectives import Objective, dominates, success_rate
from navstack.tune.space import SearchSpace, Value
from navstack.tune.storage import HEARTBEAT_S
from navstack.tune.work import outcome_of, run_job

SAMPLERS: Final = ("tpe", "cmaes", "random")
STUDY: Final = "navstack"
_WHAT, _BASELINE = "navstack_what", "navstack_baseline"
_RUNS, _ORIGIN = "runs", "origin"

Outcome = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Problem:
    """What is tuned, on what, for what."""

    base: Configuration
    """The user's parameters."""
    space: SearchSpace
    course: Course
    """Training cases."""
    objectives: Sequence[Objective]
    min_success: float = 0.0
    """With several objectives: candidates whose share of successes is below are ruled out."""

    @property
    def cases(self) -> tuple[Case, ...]:
        """The course's."""
        return self.course.cases

    def values(self, outcomes: Sequence[Outcome]) -> list[float]:
        """The objectives of a candidate's runs."""
        return [o.of(outcomes) for o in self.objectives]


@dataclass(frozen=True, slots=True)
class Trial:
    """A candidate and what came of it."""

    number: int
    candidate: dict[str, Value]
    outcomes: dict[str, Outcome]
    """By the key of the case; fewer than all for a trial that was given up."""
    values: tuple[float, ...]
    """Of the objectives; for a trial that was given up, over the runs that there are."""
    complete: bool
    origin: str
    """present, start, or search."""


@dataclass(slots=True)
class _Active:
    trial: Any
    candidate: dict[str, Value]
    overrides: tuple[str, ...]
    outcomes: list[Outcome] = field(default_factory=list[Outcome])


class Study:
    """A study in a storage. Raises InputError for one that is of something else, or holds trials without `resume`."""

    def __init__(
        self,
        problem: Problem,
        storage: Any,
        *,
        sampler: str = "tpe",
        seed: int = 0,
        resume: bool = False,
        name: str = STUDY,
        alone: bool = True,
        place: str = "the study",
    ) -> None:
        self.problem = problem
        self._optuna: Any = need("optuna", "tuning")
        self._sampler_name = sampler
        self._seed = seed
        self._alone = alone
        if sampler not in SAMPLERS:
            raise InputError(f'--sampler "{sampler}" is none; choose {", ".join(SAMPLERS)}', argument="--sampler")
        if sampler == "cmaes" and len(problem.objectives) > 1:
            raise InputError("CMA-ES has one objective only; choose --sampler tpe, or one --objective")
        self._storage = storage
        self._beaten = 0.0
        try:
            self._study: Any = self._optuna.create_study(
                storage=storage,
                study_name=name,
                directions=[o.direction for o in problem.objectives],
                load_if_exists=True,
                sampler=self._sampler(0),
                pruner=self._optuna.pruners.NopPruner(),
            )
        except ValueError as exc:
            raise InputError(f"{place} holds a study of other objectives; give another --storage") from exc
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # experimental, it says
            self._wilcoxon: Any = self._optuna.pruners.WilcoxonPruner(
                p_threshold=0.1, n_startup_steps=max(5, len(problem.cases) // 4)
            )
        self.order = list(problem.cases)
        random.Random(seed).shuffle(self.order)
        self._check(resume, place)
        self._distributions = {d.name: self._distribution(d) for d in problem.space}
        self._trials: dict[int, Trial] = {}
        self._present = {p.name: p.value for p in parameters_of(problem.base)}
        self._scalar = [o.name for o in problem.objectives] == ["score"]
        """Trials are given up early only where runs have a score that is all that counts."""

    # --- storage ------------------------------------------------------------------------------------------------------

    def what(self) -> dict[str, Any]:
        """What decides the results of the trials, for JSON."""
        p = self.problem
        parameters = json.dumps([p.base.tree.as_dict(), p.base.navstack.ros_distro], sort_keys=True, default=str)
        return {
            "navstack": __version__,
            "parameters": hashlib.sha256(parameters.encode()).hexdigest()[:16],
            "space": p.space.described(),
            "course": p.course.name,
            "cases": [c.key for c in self.order],
            "objectives": [o.name for o in p.objectives],
            "min_success": p.min_success,
            "sampler": self._sampler_name,
            "seed": self._seed,
        }

    def _check(self, resume: bool, place: str) -> None:
        what = json.loads(json.dumps(self.what()))
        there = self._study.user_attrs.get(_WHAT)
        if there is None:
            self._study.set_user_attr(_WHAT, what)
            return
        different = [key for key in what if there.get(key) != what[key]]
        if different:
            shown = ", ".join(_shown_difference(key, there.get(key), what[key]) for key in different[:3])
            raise InputError(
                f"{place} holds a study of something else: {shown}; give the same arguments as then, or another --out or "
                "--storage",
                different=different,
            )
        if not resume and self._alone and self._study.get_trials(deepcopy=False):
            raise InputError(f"{place} holds trials already; add --resume to go on, or give another --out or --storage")

    @property
    def has_baseline(self) -> bool:
        """True when the user's parameters have been driven."""
        return _BASELINE in self._study.user_attrs

    def baseline(self, executor: Executor) -> dict[str, Outcome]:
        """How the user's parameters do, case by case; driven once in the study's life."""
        told: dict[str, Outcome] | None = self._study.user_attrs.get(_BASELINE)
        if told is None:
            told = evaluate(executor, "present", (), self.order)
            self._study.set_user_attr(_BASELINE, told)
        return told

    def finished(self) -> list[Trial]:
        """All trials that ended, by number."""
        states = self._optuna.trial.TrialState
        found: list[Trial] = []
        for frozen in self._study.get_trials(deepcopy=False, states=(states.COMPLETE, states.PRUNED)):
            made = self._trials.get(frozen.number)
            if made is None:
                outcomes: list[Outcome] = frozen.user_attrs[_RUNS]
                made = Trial(
                    frozen.number,
                    self._cleaned(frozen.params),
                    {case.key: o for case, o in zip(self.order, outcomes)},
                    tuple(self.problem.values(outcomes)),
                    frozen.state == states.COMPLETE,
                    frozen.user_attrs.get(_ORIGIN, "search"),
                )
                self._trials[frozen.number] = made
            found.append(made)
        return found

    def importance(self) -> dict[str, float]:
        """How much each dimension mattered (PED-ANOVA: Watanabe et al., IJCAI 2023), greatest first; empty for few trials.

        Trials that were given up count with what their runs came to: most of what is known of bad values is in them.
        """
        trials = self.finished()
        if len(trials) < 10 or len({t.values[0] for t in trials}) < 3:
            return {}
        objective = self.problem.objectives[0]
        judged = self._optuna.create_study(direction=objective.direction)
        for t in trials:
            made = self._optuna.trial.create_trial(
                params=dict(t.candidate), distributions=self._distributions, value=t.values[0]
            )
            judged.add_trial(made)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found: dict[str, float] = self._optuna.importance.get_param_importances(
                judged, evaluator=self._optuna.importance.PedAnovaImportanceEvaluator()
            )
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    # --- the search ---------------------------------------------------------------------------------------------------

    def run(self, executor: Executor, trials: int, *, hear: Callable[[Trial, int], None] | None = None) -> None:
        """Goes on until `trials` have ended; `hear` is called with each and how many there are."""
        self._enqueue_starts()
        self._take_back()
        active: dict[str, _Active] = {}
        ended = len(self.finished())
        while True:
            while len(active) < executor.slots and ended + len(active) < trials:
                begun = self._begin(ended + len(active))
                if self._is_present(begun):
                    trial = self._end(begun)
                    ended += 1
                    if hear is not None:
                        hear(trial, ended)
                    continue
                active[self._submit(executor, begun)] = begun
            if not active:
                return
            result = executor.collect()
            at = active.pop(result.key)
            at.outcomes.append(outcome_of(result))
            self._beat(active, at)
            if self._go_on(at):
                active[self._submit(executor, at)] = at
                continue
            trial = self._end(at)
            if not self._alone:
                ended = len(self.finished())
            else:
                ended += 1
            if hear is not None:
                hear(trial, ended)

    def _begin(self, place: int) -> _Active:
        self._study.sampler = self._sampler(place)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            trial = self._study.ask(self._distributions)
        candidate = self._cleaned(trial.params)
        return _Active(trial, candidate, tuple(self.problem.space.overrides(candidate)))

    def _is_present(self, at: _Active) -> bool:
        """True for the parameters as they are, whose runs are there already."""
        known: dict[str, Outcome] | None = self._study.user_attrs.get(_BASELINE)
        if known is None or any(self._present[n] != v for n, v in self.problem.space.settings(at.candidate).items()):
            return False
        at.outcomes = [known[case.key] for case in self.order]
        if self._scalar:
            for step, outcome in enumerate(at.outcomes):
                at.trial.report(outcome["score"], step)
        return True

    def _submit(self, executor: Executor, at: _Active) -> str:
        job = run_job(f"trial {at.trial.number}", at.overrides, self.order[len(at.outcomes)])
        executor.submit(job)
        return job.key

    def _go_on(self, at: _Active) -> bool:
        """False when the trial is over: all cases driven, or not worth going on."""
        done, cases = len(at.outcomes), len(self.order)
        if not self._scalar:
            return done < cases
        scores = [o["score"] for o in at.outcomes]
        at.trial.report(scores[-1], done - 1)
        if done == cases:
            return False
        best = max((t.values[0] for t in self.finished() if t.complete), default=None)
        if best is None:
            return True
        if (sum(scores) + (cases - done) * self.problem.course.best_score) / cases < best:
            return False
        frozen = self._study.get_trials(deepcopy=False)[at.trial.number]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return not self._wilcoxon.prune(self._study, frozen)

    def _end(self, at: _Active) -> Trial:
        states = self._optuna.trial.TrialState
        complete = len(at.outcomes) == len(self.order)
        values = self.problem.values(at.outcomes)
        at.trial.set_user_attr(_RUNS, at.outcomes)
        if complete:
            if len(self.problem.objectives) > 1:
                at.trial.set_constraint("success", self.problem.min_success - success_rate(at.outcomes))
            self._study.tell(at.trial, values)
        else:
            # what the sampler takes for the value of a trial that was given up is its last report: its mean so far
            at.trial.report(values[0], len(self.order))
            self._study.tell(at.trial, state=states.PRUNED)
        return next(t for t in self.finished() if t.number == at.trial.number)

    def _enqueue_starts(self) -> None:
        space = self.problem.space
        present, start = space.present(), space.start()
        planner = {name: start[name] if "costmap" not in name else present[name] for name in present}
        costmaps = {name: present[name] if "costmap" not in name else start[name] for name in present}
        for origin, candidate in (("present", present), ("start", start), ("start", planner), ("start", costmaps)):
            self._enqueue(candidate, origin)

    def _enqueue(self, candidate: Mapping[str, Any], origin: str) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._study.enqueue_trial(dict(candidate), user_attrs={_ORIGIN: origin}, skip_if_exists=True)

    def _take_back(self) -> None:
        """Trials that a killed process left behind are begun again: failed, and put into the queue."""
        states = self._optuna.trial.TrialState
        if not self._alone:
            from optuna.storages import fail_stale_trials

            before = {t.number for t in self._study.get_trials(deepcopy=False, states=(states.RUNNING,))}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                fail_stale_trials(self._study)
            lost = [t for t in self._study.get_trials(deepcopy=False, states=(states.FAIL,)) if t.number in before]
        else:
            lost = self._study.get_trials(deepcopy=False, states=(states.RUNNING,))
            for frozen in lost:
                self._study.tell(frozen.number, state=states.FAIL)
        for frozen in lost:
            if set(frozen.params) == set(self._distributions):
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    self._study.enqueue_trial(dict(frozen.params), user_attrs=dict(frozen.user_attrs))

    def _beat(self, active: Mapping[str, _Active], at: _Active) -> None:
        """Tells a database that our trials are alive."""
        if self._alone or not hasattr(self._storage, "record_heartbeat"):
            return
        now = time.monotonic()
        if now - self._beaten < HEARTBEAT_S / 2.0:
            return
        self._beaten = now
        for a in (*active.values(), at):
            self._storage.record_heartbeat(a.trial._trial_id)

    # --- Optuna -------------------------------------------------------------------------------------------------------

    def _sampler(self, place: int) -> Any:
        samplers = self._optuna.samplers
        digest = hashlib.sha256(f"{self._seed} {place}".encode()).digest()
        seed = int.from_bytes(digest[:4], "big")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if self._sampler_name == "random":
                return samplers.RandomSampler(seed=seed)
            if self._sampler_name == "cmaes":
                # one seed for all: it draws its first population from it, and keeps its state in the storage
                return samplers.CmaEsSampler(seed=seed, warn_independent_sampling=False)
            return samplers.TPESampler(
                seed=seed, n_startup_trials=12, multivariate=True, warn_independent_sampling=False
            )

    def _distribution(self, d: Any) -> Any:
        kinds = self._optuna.distributions
        if d.choices:
            return kinds.CategoricalDistribution(d.choices)
        if d.kind == "int":
            return kinds.IntDistribution(int(-(-d.low // 1)), int(d.high // 1), log=d.log)
        return kinds.FloatDistribution(d.low, d.high, log=d.log)

    def _cleaned(self, params: Mapping[str, Any]) -> dict[str, Value]:
        return {d.name: d.clean(params[d.name]) for d in self.problem.space}


def _shown_difference(key: str, there: Any, here: Any) -> str:
    if key in ("space", "cases", "parameters"):
        return {"space": "another search space", "cases": "other cases", "parameters": "other parameters"}[key]
    return f"{key} was {there} and is {here} now"


def evaluate(
    executor: Executor,
    name: str,
    overrides: tuple[str, ...],
    cases: Sequence[Case],
    *,
    hopeless: Callable[[Sequence[Outcome]], bool] = lambda outcomes: False,
) -> dict[str, Outcome]:
    """Drives one candidate over cases; how each ended, by the case's key, in the order of the cases.

    Begins no further run once `hopeless` says so of the runs that have ended; then some are missing. Raises InternalError.
    """
    keys = {run_job(name, overrides, case).key: case.key for case in cases}
    waiting = deque(run_job(name, overrides, case) for case in cases)
    found: dict[str, Outcome] = {}
    under_way = 0
    while waiting or under_way:
        while waiting and under_way < executor.slots:
            executor.submit(waiting.popleft())
            under_way += 1
        result = executor.collect()
        under_way -= 1
        found[keys[result.key]] = outcome_of(result)
        if waiting and hopeless(list(found.values())):
            waiting.clear()
    return {case.key: found[case.key] for case in cases if case.key in found}


def pareto_front(problem: Problem, trials: Sequence[Trial]) -> list[Trial]:
    """Trials that no other one beats in every objective, of those that succeed often enough."""
    complete = [t for t in trials if t.complete]
    good = [t for t in complete if success_rate(list(t.outcomes.values())) >= problem.min_success - 1e-9]
    front = [t for t in good if not any(dominates(o.values, t.values, problem.objectives) for o in good)]
    unique: dict[tuple[float, ...], Trial] = {}
    for t in front:
        unique.setdefault(t.values, t)
    return sorted(unique.values(), key=lambda t: t.values)


def best_of(problem: Problem, trials: Sequence[Trial]) -> Trial | None:
    """The best trial; of several objectives, the one of the front that is best by the first of them."""
    if len(problem.objectives) == 1:
        complete = [t for t in trials if t.complete]
        objective = problem.objectives[0]
        key: Callable[[Trial], float] = lambda t: t.values[0] if objective.maximize else -t.values[0]  # noqa: E731
        return max(complete, key=lambda t: (key(t), -t.number), default=None)
    front = pareto_front(problem, trials)
    objective = problem.objectives[0]
    return (max if objective.maximize else min)(front, key=lambda t: t.values[0], default=None)
