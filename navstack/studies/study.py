"""The search: candidates from Optuna, runs by an executor, results in a storage that survives interruptions.

A trial drives a candidate over the cases, one run after the other, in an order that is the same for all trials, until it is
complete or pruned. The sampler of each trial has a seed made of the study's seed and the trial's place. Therefore, on one
worker, an interrupted study resumes with the same trials.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import random
import time
import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from navstack import __version__
from navstack.core import InputError, OutputError, ensure_directory, require
from navstack.parameters import parameters_of
from navstack.studies.evaluation import Outcome, evaluate, outcome_of, run_job
from navstack.studies.jobs import Executor
from navstack.studies.problem import Problem, Trial, success_rate
from navstack.studies.search_space import Dimension, Value

# --- Optuna -----------------------------------------------------------------------------------------------------------


SAMPLERS: Final = ("tpe", "cmaes", "random")
_PRUNING_P: Final = 0.1
"""A trial is pruned if the signed-rank test finds it worse with this p-value."""
_LEAST_TRIALS: Final = 10
"""Importance needs at least this many trials."""


def load_optuna() -> Any:
    """Return the module. Raises InputError if it is missing."""
    return require("optuna", "tuning")


@contextmanager
def without_warnings() -> Generator[None]:
    """Suppress warnings of experimental features of Optuna."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def check_sampler(name: str, objectives: int) -> None:
    """Raise InputError for an unknown sampler and one that does not support several objectives."""
    if name not in SAMPLERS:
        raise InputError(f'--sampler "{name}": unknown sampler; choose {", ".join(SAMPLERS)}', argument="--sampler")
    if name == "cmaes" and objectives > 1:
        raise InputError("CMA-ES supports one objective only; choose --sampler tpe, or one --objective")


def make_sampler(name: str, seed: int, place: int) -> Any:
    """Return the sampler of the trial at a place in the study; its seed depends on the study's seed and the place."""
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
        """Return True if a trial with these scores is to be pruned; `best`: the best mean score of a complete trial."""
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


# --- storages ---------------------------------------------------------------------------------------------------------


HEARTBEAT_S: Final = 30
"""In a database, a trial is lost if there was no heartbeat for four times as long."""


def is_url(storage: str) -> bool:
    """Return True for a database, false for a file."""
    return "://" in storage


@contextmanager
def open_storage(storage: str) -> Generator[Any]:
    """Optuna's storage. A journal file is locked against other processes while it is open.

    Raises InputError or OutputError for an unusable storage.
    """
    optuna = load_optuna()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    if is_url(storage):
        yield _database(optuna, storage)
        return
    path = Path(storage)
    try:
        ensure_directory(path.parent)
    except OutputError as exc:
        raise OutputError(
            exc.message.replace("the output folder", "the study's folder").replace("--out", "--storage"), **exc.data
        ) from exc
    _check_writable(path)
    with _locked(path):
        _drop_partial_line(path)
        # we hold the lock, so a lock file of Optuna belongs to a killed process
        path.with_name(path.name + ".lock").unlink(missing_ok=True)
        journal = optuna.storages.journal
        try:
            yield optuna.storages.JournalStorage(journal.JournalFileBackend(str(path)))
        except (ValueError, KeyError) as exc:
            if _is_journal(path):
                raise
            raise _not_a_journal(path) from exc


def _is_journal(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(1) in (b"", b"{")


def _not_a_journal(path: Path) -> InputError:
    return InputError(f"{path} is not a journal of a study; give another file with --storage", path=str(path))


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give --storage the name of a file in it", path=str(path))
    if path.exists() and not os.access(path, os.W_OK):
        raise OutputError(
            f"the study in {path} is read-only; make it writable, or give --storage a copy of it",
            path=str(path),
        )
    if path.exists() and not _is_journal(path):
        raise _not_a_journal(path)


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Hold a lock that the system releases with the process."""
    try:
        import fcntl
    except ImportError:  # not available on this system: two processes on one file are not detected
        yield
        return
    lock = path.with_name(f".{path.name}.inuse")
    try:
        file = lock.open("w")
    except OSError as exc:
        raise OutputError(f"cannot write {lock}: {exc.strerror or exc}", path=str(lock)) from exc
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"the study in {path} is in use by another process; wait for it, or give another --storage (a database such "
                "as sqlite:///study.db allows several processes)",
                path=str(path),
            ) from None
        yield


def _drop_partial_line(path: Path) -> None:
    """Remove an incomplete last line, left by a killed process."""
    if not path.exists():
        return
    data = path.read_bytes()
    if data and not data.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(data.rfind(b"\n") + 1)


def _database(optuna: Any, url: str) -> Any:
    logging.getLogger("alembic").setLevel(logging.ERROR)
    engine = {"connect_args": {"timeout": 30}} if url.startswith("sqlite") else {}
    try:
        with without_warnings():
            return optuna.storages.RDBStorage(
                url, heartbeat_interval=HEARTBEAT_S, grace_period=4 * HEARTBEAT_S, engine_kwargs=engine
            )
    except Exception as exc:  # each driver has its own exceptions
        reason = str(exc).strip().splitlines()
        raise InputError(
            f'--storage "{url}" cannot be used: {reason[0] if reason else type(exc).__name__}; give a file, or a reachable '
            "database such as sqlite:///study.db",
            storage=url,
        ) from exc


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
        """Return everything that affects the results of the trials, for JSON."""
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
        """Return the outcomes of the user's parameters by case; driven once per study."""
        outcomes: dict[str, Outcome] | None = self._study.user_attrs.get(_BASELINE)
        if outcomes is None:
            outcomes = evaluate(executor, "present", (), self.order)
            self._study.set_user_attr(_BASELINE, outcomes)
        return outcomes

    def finished(self) -> list[Trial]:
        """Return all complete and pruned trials, by number."""
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
        """Continue until `trials` have ended; calls `on_trial` with each and with the number of ended trials."""
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
        """Take the outcomes of the baseline if the candidate equals the current parameters; false otherwise."""
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
        """Return False if the trial is complete or pruned."""
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
        """The first candidates: the current and the recommended values, and both mixed of planner and costmaps."""
        present, start = self.problem.space.present(), self.problem.space.start()
        planner = {name: start[name] if "costmap" not in name else present[name] for name in present}
        costmaps = {name: present[name] if "costmap" not in name else start[name] for name in present}
        for origin, candidate in (("present", present), ("start", start), ("start", planner), ("start", costmaps)):
            with without_warnings():
                self._study.enqueue_trial(candidate, user_attrs={_ORIGIN: origin}, skip_if_exists=True)

    def _requeue_lost(self) -> None:
        """Mark trials of interrupted processes as failed and enqueues their candidates again."""
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
        """Send a heartbeat for the active trials, which marks them as alive in a database."""
        if self._single_process or not hasattr(self._storage, "record_heartbeat"):
            return
        now = time.monotonic()
        if now - self._last_heartbeat < HEARTBEAT_S / 2.0:
            return
        self._last_heartbeat = now
        for one in active:
            self._storage.record_heartbeat(one.trial._trial_id)


def _difference(key: str, stored: Any, here: Any) -> str:
    if key == "course":
        return f"its suite is {stored}, not {here}"
    if key in ("space", "cases", "parameters"):
        return {"space": "another search space", "cases": "other cases", "parameters": "other parameters"}[key]
    return f"{key} was {stored} and is now {here}"
