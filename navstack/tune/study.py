"""The search: candidates from Optuna, runs by an executor, results in a storage that survives interruptions.

A trial drives a candidate over the cases, one run after the other, in an order that is the same for all trials, until it is
complete or pruned. The sampler of each trial has a seed made of the study's seed and the trial's place. Therefore, on one
worker, an interrupted study resumes with the same trials.
"""

from __future__ import annotations

import hashlib
import json
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from navstack import __version__
from navstack.core.errors import InputError
from navstack.jobs import Executor
from navstack.parameters.report import parameters_of
from navstack.tune.objectives import success_rate
from navstack.tune.optuna_tools import (
    Pruner,
    check_sampler,
    distribution_of,
    load_optuna,
    make_sampler,
    parameter_importance,
    without_warnings,
)
from navstack.tune.problem import Problem, Trial
from navstack.tune.space import Value
from navstack.tune.storage import HEARTBEAT_S
from navstack.tune.work import Outcome, evaluate, outcome_of, run_job

STUDY_NAME: Final = "navstack"
_DESCRIPTION, _BASELINE = "navstack_what", "navstack_baseline"
"""Attributes of the study."""
_RUNS, _ORIGIN = "runs", "origin"
"""Attributes of a trial."""


@dataclass(slots=True)
class _ActiveTrial:
    trial: Any
    candidate: dict[str, Value]
    overrides: tuple[str, ...]
    outcomes: list[Outcome] = field(default_factory=list[Outcome])


class Study:
    """A study in a storage.

    Raises InputError if the storage holds a study of another problem, or trials without `resume`. `single_process`: no other
    process writes to the storage. `place` names the storage in messages.
    """

    def __init__(
        self,
        problem: Problem,
        storage: Any,
        *,
        sampler: str = "tpe",
        seed: int = 0,
        resume: bool = False,
        single_process: bool = True,
        place: str = "the study",
    ) -> None:
        check_sampler(sampler, len(problem.objectives))
        self.problem = problem
        self.order = list(problem.cases)
        random.Random(seed).shuffle(self.order)
        self._optuna: Any = load_optuna()
        self._sampler = sampler
        self._seed = seed
        self._single_process = single_process
        self._storage = storage
        self._study: Any = self._open(place)
        self._check(resume, place)
        self._pruner = Pruner(problem, self._study)
        self._distributions = {d.name: distribution_of(d) for d in problem.space}
        self._trials: dict[int, Trial] = {}
        self._present = {p.name: p.value for p in parameters_of(problem.base)}
        self._last_heartbeat = 0.0

    def _open(self, place: str) -> Any:
        try:
            return self._optuna.create_study(
                storage=self._storage,
                study_name=STUDY_NAME,
                directions=[o.direction for o in self.problem.objectives],
                load_if_exists=True,
                sampler=make_sampler(self._sampler, self._seed, 0),
                pruner=self._optuna.pruners.NopPruner(),
            )
        except ValueError as exc:
            raise InputError(f"{place} contains a study with other objectives; give another --storage") from exc

    def described(self) -> dict[str, Any]:
        """Everything that affects the results of the trials, for JSON."""
        p = self.problem
        parameters = json.dumps([p.base.tree.as_dict(), p.base.navstack.ros_distro], sort_keys=True, default=str)
        return {
            "navstack": __version__,
            "parameters": hashlib.sha256(parameters.encode()).hexdigest()[:16],
            "space": p.space.described(),
            "course": p.evaluation.name,
            "cases": [c.key for c in self.order],
            "objectives": [o.name for o in p.objectives],
            "min_success": p.min_success,
            "sampler": self._sampler,
            "seed": self._seed,
        }

    def _check(self, resume: bool, place: str) -> None:
        here = json.loads(json.dumps(self.described()))
        stored = self._study.user_attrs.get(_DESCRIPTION)
        if stored is None:
            self._study.set_user_attr(_DESCRIPTION, here)
            return
        different = [key for key in here if stored.get(key) != here[key]]
        if different:
            shown = ", ".join(_difference(key, stored.get(key), here[key]) for key in different[:3])
            raise InputError(
                f"{place} contains a different study: {shown}; repeat the earlier arguments, or give another --out or "
                "--storage",
                different=different,
            )
        if not resume and self._single_process and self._study.get_trials(deepcopy=False):
            raise InputError(f"{place} contains trials; add --resume to continue, or give another --out or --storage")

    # --- results ------------------------------------------------------------------------------------------------------

    @property
    def has_baseline(self) -> bool:
        """True if the user's parameters have been driven."""
        return _BASELINE in self._study.user_attrs

    def baseline(self, executor: Executor) -> dict[str, Outcome]:
        """The outcomes of the user's parameters by case; driven once per study."""
        outcomes: dict[str, Outcome] | None = self._study.user_attrs.get(_BASELINE)
        if outcomes is None:
            outcomes = evaluate(executor, "present", (), self.order)
            self._study.set_user_attr(_BASELINE, outcomes)
        return outcomes

    def finished(self) -> list[Trial]:
        """All complete and pruned trials, by number."""
        states = self._optuna.trial.TrialState
        found: list[Trial] = []
        for frozen in self._study.get_trials(deepcopy=False, states=(states.COMPLETE, states.PRUNED)):
            if frozen.number not in self._trials:
                outcomes: list[Outcome] = frozen.user_attrs[_RUNS]
                self._trials[frozen.number] = Trial(
                    frozen.number,
                    self._cleaned(frozen.params),
                    {case.key: o for case, o in zip(self.order, outcomes)},
                    tuple(self.problem.values(outcomes)),
                    frozen.state == states.COMPLETE,
                    frozen.user_attrs.get(_ORIGIN, "search"),
                )
            found.append(self._trials[frozen.number])
        return found

    def importance(self) -> dict[str, float]:
        """Importance of each dimension, greatest first; empty for few trials."""
        return parameter_importance(self.problem, self._distributions, self.finished())

    # --- search -------------------------------------------------------------------------------------------------------

    def run(
        self, executor: Executor, trials: int, *, on_trial: Callable[[Trial, int], None] = lambda trial, ended: None
    ) -> None:
        """Continues until `trials` have ended; calls `on_trial` with each and with the number of ended trials."""
        self._enqueue_starts()
        self._requeue_lost()
        active: dict[str, _ActiveTrial] = {}
        ended = len(self.finished())
        while True:
            while len(active) < executor.slots and ended + len(active) < trials:
                new = self._ask(ended + len(active))
                if self._take_baseline(new):
                    ended += 1
                    on_trial(self._end(new), ended)
                else:
                    active[self._submit(executor, new)] = new
            if not active:
                return
            result = executor.collect()
            current = active.pop(result.key)
            current.outcomes.append(outcome_of(result))
            self._send_heartbeat([*active.values(), current])
            if self._continues(current):
                active[self._submit(executor, current)] = current
                continue
            trial = self._end(current)
            # other processes may have ended trials too
            ended = ended + 1 if self._single_process else len(self.finished())
            on_trial(trial, ended)

    def _ask(self, place: int) -> _ActiveTrial:
        self._study.sampler = make_sampler(self._sampler, self._seed, place)
        with without_warnings():
            trial = self._study.ask(self._distributions)
        candidate = self._cleaned(trial.params)
        return _ActiveTrial(trial, candidate, tuple(self.problem.space.overrides(candidate)))

    def _take_baseline(self, active: _ActiveTrial) -> bool:
        """Takes the outcomes of the baseline if the candidate equals the present parameters; false otherwise."""
        known: dict[str, Outcome] | None = self._study.user_attrs.get(_BASELINE)
        settings = self.problem.space.settings(active.candidate)
        if known is None or any(self._present[n] != v for n, v in settings.items()):
            return False
        active.outcomes = [known[case.key] for case in self.order]
        if self._pruner.enabled:
            for step, outcome in enumerate(active.outcomes):
                active.trial.report(outcome["score"], step)
        return True

    def _submit(self, executor: Executor, active: _ActiveTrial) -> str:
        job = run_job(f"trial {active.trial.number}", active.overrides, self.order[len(active.outcomes)])
        executor.submit(job)
        return job.key

    def _continues(self, active: _ActiveTrial) -> bool:
        """False if the trial is complete or pruned."""
        done, cases = len(active.outcomes), len(self.order)
        if not self._pruner.enabled:
            return done < cases
        scores = [o["score"] for o in active.outcomes]
        active.trial.report(scores[-1], done - 1)
        if done == cases:
            return False
        best = max((t.values[0] for t in self.finished() if t.complete), default=None)
        return not self._pruner.prunes(active.trial, scores, best)

    def _end(self, active: _ActiveTrial) -> Trial:
        complete = len(active.outcomes) == len(self.order)
        values = self.problem.values(active.outcomes)
        active.trial.set_user_attr(_RUNS, active.outcomes)
        if complete:
            if len(self.problem.objectives) > 1:
                missing = self.problem.min_success - success_rate(active.outcomes)
                active.trial.set_constraint("success", missing)
            self._study.tell(active.trial, values)
        else:
            # samplers take the last report of a pruned trial as its value: its mean so far
            active.trial.report(values[0], len(self.order))
            self._study.tell(active.trial, state=self._optuna.trial.TrialState.PRUNED)
        return next(t for t in self.finished() if t.number == active.trial.number)

    def _cleaned(self, params: Mapping[str, Any]) -> dict[str, Value]:
        return {d.name: d.clean(params[d.name]) for d in self.problem.space}

    # --- queue --------------------------------------------------------------------------------------------------------

    def _enqueue_starts(self) -> None:
        """The first candidates: the present and the recommended values, and both mixed of planner and costmaps."""
        present, start = self.problem.space.present(), self.problem.space.start()
        planner = {name: start[name] if "costmap" not in name else present[name] for name in present}
        costmaps = {name: present[name] if "costmap" not in name else start[name] for name in present}
        for origin, candidate in (("present", present), ("start", start), ("start", planner), ("start", costmaps)):
            with without_warnings():
                self._study.enqueue_trial(candidate, user_attrs={_ORIGIN: origin}, skip_if_exists=True)

    def _requeue_lost(self) -> None:
        """Marks trials of interrupted processes as failed and enqueues their candidates again."""
        for frozen in self._lost_trials():
            if set(frozen.params) == set(self._distributions):
                with without_warnings():
                    self._study.enqueue_trial(dict(frozen.params), user_attrs=dict(frozen.user_attrs))

    def _lost_trials(self) -> list[Any]:
        states = self._optuna.trial.TrialState
        running: list[Any] = self._study.get_trials(deepcopy=False, states=(states.RUNNING,))
        if self._single_process:
            for frozen in running:
                self._study.tell(frozen.number, state=states.FAIL)
            return running
        numbers = {t.number for t in running}
        with without_warnings():
            self._optuna.storages.fail_stale_trials(self._study)
        return [t for t in self._study.get_trials(deepcopy=False, states=(states.FAIL,)) if t.number in numbers]

    def _send_heartbeat(self, active: list[_ActiveTrial]) -> None:
        """Sends a heartbeat for the active trials, which marks them as alive in a database."""
        if self._single_process or not hasattr(self._storage, "record_heartbeat"):
            return
        now = time.monotonic()
        if now - self._last_heartbeat < HEARTBEAT_S / 2.0:
            return
        self._last_heartbeat = now
        for one in active:
            self._storage.record_heartbeat(one.trial._trial_id)


def _difference(key: str, stored: Any, here: Any) -> str:
    if key in ("space", "cases", "parameters"):
        return {"space": "another search space", "cases": "other cases", "parameters": "other parameters"}[key]
    return f"{key} was {stored} and is now {here}"
