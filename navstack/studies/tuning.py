"""A whole tuning: the search, removal of unneeded changes, and validation on held-out cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from navstack.core import InputError
from navstack.studies.comparison import Case, Comparison, compare_outcomes
from navstack.studies.evaluation import Outcome, evaluate
from navstack.studies.jobs import Executor
from navstack.studies.problem import Problem, Trial, best_of, pareto_front
from navstack.studies.search_space import Value
from navstack.studies.study import Study

TOLERANCE: Final = 0.001
"""Loss of the objective that a reverted value may cause: absolute for score and success, otherwise relative."""


def revert_unneeded(
    problem: Problem, executor: Executor, candidate: dict[str, Value], outcomes: Mapping[str, Outcome]
) -> tuple[dict[str, Value], Mapping[str, Outcome], tuple[str, ...]]:
    """Try the current value of each dimension, in the order of the space, and keeps it if the objective gets no worse.

    Returns the remaining values, their outcomes, and the reverted dimensions.
    """
    cases = problem.cases
    objective = problem.objectives[0]

    def value(of: Mapping[str, Outcome]) -> float:
        return objective.of([of[c.key] for c in cases])

    reverted: list[str] = []
    initial = value(outcomes)
    best: float = initial
    tolerance: float = TOLERANCE if objective.name in ("score", "success") else abs(initial) * TOLERANCE
    for name in list(candidate):
        rest = {n: v for n, v in candidate.items() if n != name}
        if not rest:
            continue
        # relative to the best value so far, so that small losses do not add up
        allowed: float = best - tolerance if objective.maximize else best + tolerance
        tried = evaluate(
            executor,
            f"without {name}",
            tuple(problem.space.overrides(rest)),
            cases,
            hopeless=partial(_hopeless, problem, allowed),
        )
        if len(tried) < len(cases):
            continue
        reached: float = value(tried)
        if not objective.better(allowed, reached):
            candidate, outcomes = rest, tried
            reverted.append(name)
            best = max(best, reached) if objective.maximize else min(best, reached)
    return candidate, outcomes, tuple(reverted)


def _hopeless(problem: Problem, least: float, finished: Sequence[Outcome]) -> bool:
    """Return True if even the best scores in the remaining runs cannot raise the mean to `least`."""
    if problem.objectives[0].name != "score":
        return False
    remaining = (len(problem.cases) - len(finished)) * problem.evaluation.best_score
    return (sum(o["score"] for o in finished) + remaining) / len(problem.cases) < least


_SHOWN_CASES: Final = 5
_RUN_ENDS: Final = ("success", "collision", "timeout", "aborted", "rejected", "lost")


@dataclass(frozen=True, slots=True)
class TuningResult:
    """The result of a tuning."""

    problem: Problem
    trials: tuple[Trial, ...]
    best: Trial | None
    """The best complete trial; None without one."""
    candidate: dict[str, Value]
    """The new values: those of the best trial without unneeded changes; empty if nothing is better."""
    reverted: tuple[str, ...]
    """Dimensions of the best trial that were set back to the current value because they made no difference."""
    training: Comparison
    held_out: Comparison | None
    """On cases that were not used for the search; None without such cases."""
    against: Comparison | None
    """A reference parameter set and the tuned one, on the held-out cases (without them, on the training cases)."""
    importance: dict[str, float]
    front: tuple[Trial, ...]

    @property
    def found(self) -> bool:
        """True if the search found better parameters than the user's."""
        return bool(self.candidate)

    @property
    def improved(self) -> bool:
        """True if they are better in the validation, too, if only in its estimate: then they are worth writing."""
        return self.found and (self.held_out is None or self.held_out.measure("score").difference.interval.value > 0.0)

    @property
    def validation(self) -> Comparison:
        """The held-out comparison; without one, that of the training."""
        return self.held_out or self.training

    @property
    def validation_name(self) -> str:
        """held-out or training."""
        return "held-out" if self.held_out is not None else "training"

    @property
    def never_solved(self) -> list[str]:
        """Training cases without any success, also of the result, although at least two candidates were driven."""
        found: list[str] = []
        for case, before, after in zip(self.training.cases, self.training.before, self.training.after, strict=True):
            driven = [t.outcomes[case.key] for t in self.trials if case.key in t.outcomes]
            if (
                len(driven) >= 2
                and not (before["success"] or after["success"])
                and not any(o["success"] for o in driven)
            ):
                found.append(case.key)
        return found

    @property
    def verdict(self) -> str:
        """The result in a few sentences."""
        if not self.found:
            return self._nothing_found()
        shown = self.validation
        score, success, time = shown.measure("score"), shown.measure("success"), shown.find("time")
        runs = f"{len(shown.cases)} {self.validation_name} runs"
        difference = f"difference {score.difference.interval.text(3)}: {score.verdict}"
        parts = [
            f"On {runs}, the score changes from {score.before.value:.3f} to {score.after.value:.3f} ({difference})",
            f"success from {success.before.value:.0%} to {success.after.value:.0%}",
        ]
        if time is not None and time.before.groups:
            parts.append(
                f"time of runs that succeed in both by {time.difference.interval.value:+.1f} s to {time.after.value:.1f} s"
            )
        text = ", ".join(parts) + "."
        if not self.improved:
            text += (
                " Nothing improved on the held-out scenarios, so no parameters are written: tune with more scenarios."
            )
        elif self.held_out is not None and score.verdict != "better":
            text += (
                " The improvement in training is not shown on the held-out scenarios: do not rely on it, and tune with more "
                "scenarios."
            )
        return text + self._failures_text() + self._never_solved_text()

    def _failures_text(self) -> str:
        """How many validation runs fail with the result, and why."""
        failed = self.validation.failed
        if not failed:
            return ""
        reasons = Counter(str(self.validation.after[i]["outcome"]) for i in failed)
        shown = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        return f" {len(failed)} of {len(self.validation.cases)} {self.validation_name} runs fail: {shown}."

    def _nothing_found(self) -> str:
        driven = [o for t in self.trials for o in t.outcomes.values()] + list(self.training.before)
        if any(o["success"] for o in driven):
            text = "No better parameters were found than the current ones."
            return text + self._failures_text() + self._never_solved_text()
        return (
            "No better parameters were found: no candidate reached a goal. Check a run with `navstack simulate`, widen the "
            "ranges with --param, or tune on easier scenarios."
        )

    def _never_solved_text(self) -> str:
        names = self.never_solved
        if not names:
            return ""
        shown = ", ".join(names[:_SHOWN_CASES]) + (", .." if len(names) > _SHOWN_CASES else "")
        return (
            f" No candidate succeeded in {shown}: check with `navstack simulate` whether it is feasible, then exclude it or "
            "widen the ranges."
        )


@dataclass(frozen=True, slots=True)
class Validation:
    """The cases and executors that validate the result of the search."""

    held_out: tuple[Case, ...] = ()
    executor: Executor | None = None
    """Drives the held-out cases; None without any."""
    reference: Executor | None = None
    """Drives the same cases (without any, the training cases) with a reference parameter set."""
    reference_name: str = ""


def tune(
    study: Study,
    executor: Executor,
    trials: int,
    *,
    validation: Validation = Validation(),
    revert: bool = True,
    on_trial: Callable[[Trial, int], None] = lambda trial, ended: None,
    notify: Callable[[str], None] = lambda text: None,
) -> TuningResult:
    """Run the study up to a number of trials and validates the best one.

    `executor` drives the training cases. `notify` is called at the start of each step. Raises InputError if no case can be
    driven.
    """
    problem = study.problem
    if not study.has_baseline:
        notify(f"driving {len(problem.cases)} training runs with the current parameters")
    before = study.baseline(executor)
    _check_drivable(before)
    study.run(executor, trials, on_trial=on_trial)
    finished = study.finished()
    best = best_of(problem, finished)
    after: Mapping[str, Outcome] = before
    candidate: dict[str, Value] = {}
    reverted: tuple[str, ...] = ()
    if best is not None and _is_better(problem, best.outcomes, before):
        candidate, after = _changed(problem, best.candidate), best.outcomes
        if revert and len(problem.objectives) == 1:
            notify("reverting changes that make no difference")
            candidate, after, reverted = revert_unneeded(problem, executor, candidate, after)
    training = compare_outcomes(problem.cases, before, after)
    held_out = _validate(problem, candidate, validation, notify)
    return TuningResult(
        problem=problem,
        trials=tuple(finished),
        best=best,
        candidate=candidate,
        reverted=reverted,
        training=training,
        held_out=held_out,
        against=_compare_with_reference(held_out or training, validation, notify),
        importance=study.importance(),
        front=tuple(pareto_front(problem, finished)),
    )


def _check_drivable(before: Mapping[str, Outcome]) -> None:
    """Raise InputError if no run can start: then no parameters can be compared."""
    stuck = {
        key: o
        for key, o in before.items()
        if o["outcome"] not in _RUN_ENDS and not o["time_s"] and o["outcome"] != "refused"
    }
    if stuck and len(stuck) == len(before):
        key, o = next(iter(stuck.items()))
        raise InputError(
            f"no scenario can be driven with these parameters: {key}: {o['text'] or o['outcome']}",
            outcomes=dict(before),
        )


def _is_better(problem: Problem, after: Mapping[str, Outcome], before: Mapping[str, Outcome]) -> bool:
    old = [before[key] for key in before]
    new = [after[key] for key in before]
    if len(problem.objectives) > 1 and not problem.succeeds_enough(old):
        return True
    return problem.objectives[0].better(problem.values(new)[0], problem.values(old)[0])


def _changed(problem: Problem, candidate: Mapping[str, Value]) -> dict[str, Value]:
    """Return the values that differ from the current ones."""
    return {d.name: candidate[d.name] for d in problem.space if candidate[d.name] != d.present or d.ties}


def _validate(
    problem: Problem, candidate: Mapping[str, Value], validation: Validation, notify: Callable[[str], None]
) -> Comparison | None:
    """Return the current and the tuned parameters on the held-out cases."""
    cases, executor = validation.held_out, validation.executor
    if executor is None:
        return None
    notify(f"driving {len(cases)} held-out runs with the current and the tuned parameters")
    before = evaluate(executor, "present", (), cases)
    after = before
    if candidate:
        after = evaluate(executor, "tuned", tuple(problem.space.overrides(candidate)), cases)
    return compare_outcomes(cases, before, after)


def _compare_with_reference(
    tuned: Comparison, validation: Validation, notify: Callable[[str], None]
) -> Comparison | None:
    if validation.reference is None:
        return None
    notify(f"driving {len(tuned.cases)} runs with {validation.reference_name}")
    reference = evaluate(validation.reference, "reference", (), tuned.cases)
    after = {c.key: o for c, o in zip(tuned.cases, tuned.after, strict=True)}
    return compare_outcomes(tuned.cases, reference, after)
