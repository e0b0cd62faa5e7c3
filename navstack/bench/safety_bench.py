"""The search for contacts: thousands of scenes with and without the collision monitor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from navstack.bench.contact_causes import UNEXPLAINED
from navstack.bench.safety_drive import Contact, SafetyDrive, contacts_of, explain_contacts
from navstack.bench.safety_scene import DEAD_TIME_S, DURATION_S, PERIOD_S, robot_kinds
from navstack.bench.table import Column, Table
from navstack.jobs import Job, JobResult


@dataclass(frozen=True, slots=True)
class SafetyTask:
    """Drives the scene of a number twice."""

    def __call__(self, number: int) -> dict[str, Any]:
        """The contacts with the monitor, explained, and those without it, for JSON."""
        monitored = SafetyDrive(number, monitored=True)
        with_it: Sequence[Contact] = explain_contacts(number) if monitored.run() else ()
        plain = SafetyDrive(number, monitored=False)
        without = contacts_of(plain)
        return {
            "number": number,
            "robot": monitored.scene.robot.name,
            "with": [contact.as_dict() for contact in with_it],
            "without": [contact.as_dict() for contact in without],
            "driven_with_m": monitored.moved,
            "driven_without_m": plain.moved,
        }


def safety_jobs(first: int, count: int) -> list[Job]:
    """A job for each of the scenes `first` .. `first + count - 1`."""
    return [Job(f"scene {number}", number) for number in range(first, first + count)]


def stopping_distance(speed: float, decel: float) -> float:
    """Return the distance (m) from the scan that shows an obstacle to standstill.

    Dead time and one period at full speed (m/s), then braking with `decel` (m/s²).
    """
    return speed * (DEAD_TIME_S + PERIOD_S) + speed * speed / (2.0 * decel)


def unexplained(results: Sequence[JobResult]) -> list[dict[str, Any]]:
    """Return the contacts with the monitor that nothing explains."""
    return [
        {"scene": result.value["number"], **contact}
        for result in results
        if not result.failed
        for contact in result.value["with"]
        if contact["cause"] == UNEXPLAINED
    ]


def safety_tables(results: Sequence[JobResult]) -> list[Table]:
    """Contacts per robot and obstacle with and without the monitor, their causes, and the stopping distances."""
    values = [result.value for result in results if not result.failed]
    tables = [_rates(values), _causes(values), _bounds()]
    found = unexplained(results)
    if found:
        columns = (Column("scene", "scene"), Column("time", "time s"), Column("obstacle", "obstacle"))
        tables.append(Table(UNEXPLAINED, columns, [{**row, "scene": str(row["scene"])} for row in found]))
    return tables


def _kind_of(contact: dict[str, Any]) -> str:
    name = str(contact["obstacle"])
    return "wall" if name == "map" else "box" if name.startswith("box") else "person"


def _rates(values: Sequence[dict[str, Any]]) -> Table:
    rows: list[dict[str, Any]] = []
    for kind in (*(kind.name for kind in robot_kinds()), "all"):
        mine = [value for value in values if kind in (value["robot"], "all")]
        for which in ("without", "with"):
            contacts = [contact for value in mine for contact in value[which]]
            kinds = Counter(_kind_of(contact) for contact in contacts)
            hit = sum(1 for value in mine if value[which])
            rows.append(
                {
                    "robot": kind,
                    "monitor": "yes" if which == "with" else "no",
                    "scenes": len(mine),
                    "hit": hit,
                    "share": 100.0 * hit / len(mine) if mine else None,
                    **{name: kinds[name] for name in ("wall", "box", "person")},
                    "driven": sum(float(value[f"driven_{which}_m"]) for value in mine) / max(len(mine), 1),
                }
            )
    columns = (
        Column("robot", "robot"),
        Column("monitor", "monitor"),
        Column("scenes", "scenes"),
        Column("hit", "scenes with contacts"),
        Column("share", "%", 1),
        Column("wall", "contacts with walls"),
        Column("box", "with boxes"),
        Column("person", "with people"),
        Column("driven", "m per scene", 2),
    )
    return Table("contacts", columns, rows)


def _causes(values: Sequence[dict[str, Any]]) -> Table:
    contacts = [contact for value in values for contact in value["with"]]
    causes = Counter((str(contact["cause"]), _kind_of(contact)) for contact in contacts)
    rows = [
        {"cause": cause, **{kind: causes[cause, kind] for kind in ("wall", "box", "person")}}
        for cause in sorted({cause for cause, _ in causes} | {UNEXPLAINED})
    ]
    columns = (Column("cause", "contacts with the monitor"), *(Column(k, k) for k in ("wall", "box", "person")))
    return Table("causes", columns, rows)


def _bounds() -> Table:
    rows = [
        {
            "robot": kind.name,
            "speed": kind.max_velocity[0],
            "decel": kind.max_decel[0],
            "distance": stopping_distance(kind.max_velocity[0], kind.max_decel[0]),
        }
        for kind in robot_kinds()
    ]
    columns = (
        Column("robot", "robot"),
        Column("speed", "speed m/s"),
        Column("decel", "deceleration m/s²"),
        Column("distance", "stopping distance m", 3),
    )
    return Table(f"stopping distances ({DURATION_S:g} s per scene)", columns, rows)
