"""Assembles the report of a goal from the record of its run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from navstack.core import Event
from navstack.core.errors import InputError, RecordError
from navstack.explain.goal import curves, history
from navstack.explain.goal.report import TERMINAL, GoalReport
from navstack.explain.goal.summary import summary_of
from navstack.explain.goal.timeline import timeline_of
from navstack.record import Record


def explain_goals(record: Record) -> tuple[GoalReport, ...]:
    """Reports every goal of a run, in order of arrival. Raises RecordError for a run without goals."""
    ids = list(dict.fromkeys(str(e.data["id"]) for e in record.events_of("status") if "id" in e.data))
    if not ids:
        raise RecordError(f"{record.path or 'the record'} contains no goal: none was sent during the recording")
    return tuple(_report(record, number, goal_id) for number, goal_id in enumerate(ids, 1))


def explain_goal(record: Record, number: int, goal_id: str | None = None) -> GoalReport:
    """Reports goal `number` (from 1). `goal_id`: its id, for a record that begins after the first goal.

    Raises InputError for an unknown number, RecordError as `explain_goals`.
    """
    if goal_id is not None:
        return _report(record, number, goal_id)
    reports = explain_goals(record)
    if not 1 <= number <= len(reports):
        known = "only goal 1" if len(reports) == 1 else f"goals 1 to {len(reports)}"
        raise InputError(f"--goal {number}: this run has {known}", argument="--goal", value=number)
    return reports[number - 1]


def _expired_limit(record: Record, last: Event, duration: float) -> float | None:
    """The time limit of the run's goals (s) if a goal that was cancelled after `duration` (s) had exceeded it."""
    limit = record.scenario.get("time_limit_s")
    if last.data.get("error_name") != "CANCELED" or not isinstance(limit, (int, float)) or duration < limit:
        return None
    return float(limit)


def _report(record: Record, number: int, goal_id: str) -> GoalReport:
    statuses = [e for e in record.events_of("status") if e.data.get("id") == goal_id]
    accepted = next((e.time for e in statuses if e.data["status"] == "ACTIVE"), None)
    last = statuses[-1]
    ended = last.time if last.data["status"] in TERMINAL else history.last_time(record)
    events = history.events_of(record, goal_id)
    pose = history.goal_pose(record, events, number)
    times, rows = curves.cycles(record, accepted, ended)
    plans = [e for e in events if e.kind == "plan"]
    report = GoalReport(
        number=number,
        id=goal_id,
        pose=pose,
        sent=statuses[0].time,
        accepted=accepted,
        ended=ended,
        status=str(last.data["status"]),
        text=str(last.data.get("text", "")),
        error_code=int(last.data.get("error_code", 0)),
        error_name=str(last.data.get("error_name", "NONE")),
        message=str(last.data.get("message", "")),
        summary="",
        spans=history.state_spans(record, events, accepted, ended, goal_id),
        recoveries=history.recovery_runs(events, ended),
        timeline=(),
        plan_times=np.array([e.time for e in plans]),
        plan_lengths=np.array([float(e.data.get("length_m", math.nan)) for e in plans]),
        failed_plans=history.failures(events, "plan_failed"),
        failed_commands=history.failures(events, "control_failed"),
        times=times,
        distance=curves.distance_to(record.poses[rows], pose),
        remaining=curves.remaining_length(record, times, rows, {e.time for e in plans}),
        velocity=record.velocities[rows],
        expired_limit_s=_expired_limit(record, last, ended - statuses[0].time),
    )
    poses = record.poses[rows]
    return replace(report, timeline=timeline_of(record, report, events, poses), summary=summary_of(report, poses))
