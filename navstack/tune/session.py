"""Tuning from beginning to end: the search, what of its result is needed, and the proof on cases it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from navstack.core.errors import InputError
from navstack.jobs import Executor
from navstack.tune.comparison import Comparison, compare
from navstack.tune.courses import Case, Course
from navstack.tune.objectives import success_rate
from navstack.tune.space import Value
from navstack.tune.study import Outcome, Problem, Study, Trial, best_of, evaluate, pareto_front

WORTH: Final = 0.001
"""Setting a parameter back to what it was may cost so much of the score, and it goes back."""

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Tuning:
    """What came of it."""

    problem: Problem
    trials: tuple[Trial, ...]
    best: Trial | None
    """The best trial; None where none was driven over every case."""
    candidate: dict[str, Value]
    """What is written: the best trial's values, without those that made no difference; empty where nothing is better."""
    set_back: tuple[str, ...]
    """Dimensions of the best trial that went back to what they were: they made no difference."""
    training: Comparison
    held_out: Comparison | None
    """On cases that were not used for tuning; None where there are none."""
    against: Comparison | None
    """Held-out cases (training cases without them): a reference's parameters, then the tuned ones."""
    importance: dict[str, float]
    front: tuple[Trial, ...]

    @property
    def found(self) -> bool:
        """True when something better than the user's parameters was found."""
        return bool(self.candidate)

    @property
    def never(self) -> list[str]:
        """Training cases in which no candidate ever succeeded, of those that several were driven over."""
        found: list[str] = []
        for case, before in zip(self.training.cases, self.training.before, strict=True):
            driven = [t.outcomes[case.key] for t in self.trials if case.key in t.outcomes]
            if len(driven) >= 2 and not before["success"] and not any(o["success"] for o in driven):
                found.append(case.key)
        return found

    @property
    def verdict(self) -> str:
        """What came of it, in a sentence or two."""
        if not self.found:
            driven = [o for t in self.trials for o in t.outcomes.values()] + list(self.training.before)
            if not any(o["success"] for o in driven):
                return (
                    "Nothing better was found: no candidate reached a single goal. Look at a run by `navstack simulate`, "
                    "widen the ranges by --param, or tune on easier scenarios."
                )
            return "Nothing better was found than the parameters as they are." + self._never_text()
        shown = self.held_out or self.training
        where = "held-out" if self.held_out is not None else "training"
        score, success, time = (shown.measure("score"), shown.measure("success"), _time(shown))
        head = f"On {len(shown.cases)} {where} runs the score goes from {score.before.value:.3f} to {score.after.value:.3f}"
        parts = [
            f"{head} (difference {score.difference.interval.text(3)}: {score.verdict})",
            f"success from {success.before.value:.0%} to {success.after.value:.0%}",
        ]
        if time is not None and time.before.groups:
            parts.append(
                f"time of runs that succeed both times by {time.difference.interval.value:+.1f} s to {time.after.value:.1f} s"
            )
        text = ", ".join(parts) + "."
        if self.held_out is not None and score.verdict != "better":
            text += (
                " What was gained in training does not show on scenarios that were not trained on: do not trust it "
                "without more scenarios."
            )
        return text + self._never_text()

    def _never_text(self) -> str:
        if not self.never:
            return ""
        shown = ", ".join(self.never[:5]) + (", .." if len(self.never) > 5 else "")
        return (
            f" No candidate ever got through {shown}: look whether it can be done at all (`navstack simulate`), and leave "
            "it out or widen the ranges."
        )


def _time(comparison: Comparison) -> Any:
    return next((m for m in comparison.measures if m.name == "time"), None)


def tune(
    study: Study,
    executor: Executor,
    trials: int,
    *,
    held_out: Course | None = None,
    held_out_executor: Executor | None = None,
    reference: tuple[Executor, str] | None = None,
    set_back: bool = True,
    hear: Callable[[Trial, int], None] | None = None,
    say: Say = lambda text: None,
) -> Tuning:
    """Runs the study to its number of trials and judges its best.

    `executor` drives training cases, `held_out_executor` those of `held_out`; `reference` drives the cases that are judged
    with other parameters, to be compared with. Raises InputError where no case can be driven at all.
    """
    problem = study.problem
    if not study.has_baseline:
        say(f"driving {len(problem.cases)} training runs with the parameters as they are")
    before = study.baseline(executor)
    _check_drivable(before)
    study.run(executor, trials, hear=hear)
    found = study.finished()
    best = best_of(problem, found)
    after: Mapping[str, Outcome] = before
    candidate: dict[str, Value] = {}
    back: tuple[str, ...] = ()
    if best is not None and _better(problem, best.outcomes, before):
        candidate, after = _changed(problem, best.candidate), best.outcomes
        if set_back and len(problem.objectives) == 1:
            say("looking for the values that are not needed")
            candidate, after, back = _set_back(problem, executor, candidate, after)
    cases, judged = problem.cases, held_out_executor
    training = compare(cases, before, after)
    proof = None
    if held_out is not None and judged is not None:
        cases = held_out.cases
        say(f"driving {len(cases)} held-out runs, before and after")
        first = evaluate(judged, "present", (), cases)
        second = first
        if candidate:
            second = evaluate(judged, "tuned", tuple(problem.space.overrides(candidate)), cases)
        proof = compare(cases, first, second)
    against = None
    if reference is not None:
        say(f"driving {len(cases)} runs with {reference[1]}")
        good = evaluate(reference[0], "reference", (), cases)
        tuned = {c.key: o for c, o in zip(cases, (proof or training).after, strict=True)}
        against = compare(cases, good, tuned)
    return Tuning(
        problem=problem,
        trials=tuple(found),
        best=best,
        candidate=candidate,
        set_back=back,
        training=training,
        held_out=proof,
        against=against,
        importance=study.importance(),
        front=tuple(pareto_front(problem, found)),
    )


def _check_drivable(before: Mapping[str, Outcome]) -> None:
    """A scenario in which the robot cannot even begin says nothing about parameters."""
    ends = ("success", "collision", "timeout", "aborted", "rejected")
    stuck = {
        key: o
        for key, o in before.items()
        if o["outcome"] not in ends and not o["time_s"] and o["outcome"] != "refused"
    }
    if stuck and len(stuck) == len(before):
        key, o = next(iter(stuck.items()))
        raise InputError(
            f"no scenario can be driven with these parameters: {key}: {o['text'] or o['outcome']}",
            outcomes=dict(before),
        )


def _better(problem: Problem, after: Mapping[str, Outcome], before: Mapping[str, Outcome]) -> bool:
    order = list(before)
    mine, theirs = problem.values([after[k] for k in order]), problem.values([before[k] for k in order])
    if len(problem.objectives) > 1 and success_rate([before[k] for k in order]) < problem.min_success - 1e-9:
        return True
    return problem.objectives[0].better(mine[0], theirs[0])


def _changed(problem: Problem, candidate: Mapping[str, Value]) -> dict[str, Value]:
    """Without what is as it was."""
    return {d.name: candidate[d.name] for d in problem.space if candidate[d.name] != d.present or d.ties}


def _hopeless(problem: Problem, least: float, ended: Sequence[Outcome]) -> bool:
    """True when the runs that are left cannot bring the mean score to `least`."""
    if problem.objectives[0].name != "score":
        return False
    left = (len(problem.cases) - len(ended)) * problem.course.best_score
    return (sum(o["score"] for o in ended) + left) / len(problem.cases) < least


def _set_back(
    problem: Problem, executor: Executor, candidate: dict[str, Value], outcomes: Mapping[str, Outcome]
) -> tuple[dict[str, Value], Mapping[str, Outcome], tuple[str, ...]]:
    """Tries every value as it was before, one after the other; what does not get worse stays so.

    What matters is left, and the robot's user has fewer values to wonder about. The order is the space's own.
    """
    cases: Sequence[Case] = problem.cases
    objective = problem.objectives[0]
    back: list[str] = []

    def value(of: Mapping[str, Outcome]) -> float:
        return objective.of([of[c.key] for c in cases])

    now = value(outcomes)
    least: float = now
    for name in list(candidate):
        less = {n: v for n, v in candidate.items() if n != name}
        if not less:
            continue
        scale: float = WORTH if objective.name in ("score", "success") else abs(now) * WORTH
        # against the best there was, so that many small losses do not add up
        allowed: float = least - scale if objective.maximize else least + scale

        tried = evaluate(
            executor,
            f"without {name}",
            tuple(problem.space.overrides(less)),
            cases,
            hopeless=partial(_hopeless, problem, allowed),
        )
        if len(tried) < len(cases):
            continue
        reached: float = value(tried)
        if not objective.better(allowed, reached):
            candidate, outcomes = less, tried
            back.append(name)
            least = max(least, reached) if objective.maximize else min(least, reached)
    return candidate, outcomes, tuple(back)
