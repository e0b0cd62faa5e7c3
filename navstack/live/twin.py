"""A session at one moment, to be simulated again in another thread: for its record, and for explanations."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from navstack.core.errors import InternalError
from navstack.live.checkpoints import Checkpoint, snapshot
from navstack.parameters.configuration import Configuration
from navstack.record import Record, RunRecorder
from navstack.scenario import Run, Scenario
from navstack.scenario.file.writer import write_scenario

NEAR_S: Final = 5.0
"""Before a command that is explained, the record begins this much earlier (s)."""
SLACK_S: Final = 1e-3
"""Tolerance of requested times (s), as `navstack.explain` has it."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a scenario came from, to write it to a file again."""

    map_file: Path | None = None
    sources: tuple[str, ...] = ()
    """The parameters' `--params`."""


@dataclass(frozen=True, slots=True)
class Twin:
    """A session at one moment, to be simulated again."""

    scenario: Scenario
    """With the interactions so far."""
    origin: Origin
    cycles: int
    done: bool
    digest: bytes
    """Digest of all cycles."""
    configuration: Configuration
    """The parameters in force."""
    until: float
    """The present time (s)."""
    goals: tuple[tuple[str, float], ...]
    """Id of each goal so far, and when it was sent (s)."""
    checkpoints: tuple[Checkpoint, ...]

    def recorded(self) -> RunRecorder:
        """Simulates the run again, with its record. Raises InternalError if it differs from the session."""
        again = Run(self.scenario)
        digest = hashlib.blake2b()
        for _ in range(self.cycles):
            again.step()
            digest.update(digest_of(again))
        self._check(digest.digest())
        if self.done:
            again.step()  # finishes the record
        assert again.recorder is not None
        return again.recorder

    def record_for_command(self, time: float) -> Record:
        """Returns a record with the last command until `time` (s): from a checkpoint on, or, without one, of the whole run."""
        by_hand = max(
            (i.time for i in self.scenario.interactions if i.kind == "teleop" and i.time <= time), default=-1.0
        )
        before = [checkpoint for checkpoint in self.checkpoints if checkpoint.time < time]
        nearer = [self._nearer(checkpoint, time - NEAR_S) for checkpoint in before[-1:]]
        for checkpoint in (*nearer, *reversed(before)):
            record = self._record_from(checkpoint, time)
            searches = (*record.local_plan_times, *(event.time for event in record.events_of("control_failed")))
            begun = len(record.times) > 0 and record.times[0] <= time + SLACK_S
            if begun and (min(searches, default=math.inf) <= time + SLACK_S or by_hand >= record.times[0]):
                return record
        return self.recorded().record()

    def record_for_goal(self, number: int) -> tuple[Record, str | None]:
        """Returns a record with a goal (from 1), and its id: from a checkpoint on, or, without one, of the whole run."""
        if 1 <= number <= len(self.goals):
            name, sent = self.goals[number - 1]
            before = [checkpoint for checkpoint in self.checkpoints if checkpoint.time < sent]
            if before:
                return self._record_from(before[-1], math.inf), name
        return self.recorded().record(), None

    def _nearer(self, checkpoint: Checkpoint, time: float) -> Checkpoint:
        """Returns a checkpoint at about `time` (s), without a record on the way: recording and checking it takes longer."""
        if checkpoint.time >= time:
            return checkpoint
        run, history = checkpoint.copied.restore()
        run.replace_upcoming(self.scenario.interactions[checkpoint.done :])
        digest, cycles = checkpoint.digest.copy(), checkpoint.cycles
        while cycles < self.cycles and run.robot.time < time:
            before = run.robot.time
            while cycles < self.cycles and run.robot.time <= before:  # interactions come between two times only
                run.step()
                digest.update(digest_of(run))
                cycles += 1
        done = len(self.scenario.interactions) - len(run.upcoming)
        copied = snapshot((run, history), shared=(self.scenario, run.scenario, self.scenario.map))
        return checkpoint if copied is None else Checkpoint(run.robot.time, cycles, done, digest, copied)

    def _record_from(self, checkpoint: Checkpoint, time: float) -> Record:
        """Simulates the run again from a checkpoint until `time` (s), or until now. Raises InternalError as `recorded`."""
        run = self._resumed(checkpoint)
        digest = checkpoint.digest.copy()
        for _ in range(self.cycles - checkpoint.cycles):
            if run.robot.time > time + SLACK_S:
                break
            run.step()
            digest.update(digest_of(run))
        else:
            self._check(digest.digest())
            if self.done:
                run.step()
        assert run.recorder is not None
        record = run.recorder.record()
        record.resume = lambda: self._resumed(checkpoint)
        return record

    def _resumed(self, checkpoint: Checkpoint) -> Run:
        """Returns the run at a checkpoint, with a record that begins there."""
        run: Run
        run, _ = checkpoint.copied.restore()
        run.replace_upcoming(self.scenario.interactions[checkpoint.done :])
        run.record_from_here(self.scenario)
        return run

    def _check(self, digest: bytes) -> None:
        if digest != self.digest:
            raise InternalError(
                "the run simulated again differs from the session; this is a bug in navstack, please report it with the "
                "saved scenario"
            )

    def save_scenario(self, path: Path) -> Scenario:
        """Writes the session as a scenario file and returns what it loads to. Raises OutputError."""
        return write_scenario(self.scenario, path, map_file=self.origin.map_file, sources=self.origin.sources)


def digest_of(run: Run) -> bytes:
    """Bytes that differ if a cycle differs."""
    return struct.pack("<7d", run.robot.time, *run.robot.pose, *run.move_base.command)
