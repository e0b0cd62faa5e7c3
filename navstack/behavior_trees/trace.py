"""What a tree did: how often each node ran, the last changes of their results, and why RecoveryNodes tried again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from navstack.behavior_trees.nodes import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Leaf, Node, Status

MAX_CHANGES: Final = 2000
MAX_RETRIES: Final = 200
NANO: Final = 1_000_000_000


class Traced(Protocol):
    """The tree as its trace sees it."""

    name: str
    now_ns: int
    ticks: int
    status: Status
    nodes: list[Node]
    failed: deque[Leaf]


@dataclass(frozen=True, slots=True)
class Change:
    """A node returned another status than the time before; IDLE is a halt while it was RUNNING."""

    time: float
    """s."""
    tick: int
    path: str
    status: Status


@dataclass(frozen=True, slots=True)
class Retry:
    """A RecoveryNode ran its second child because the first one had failed."""

    time: float
    """s."""
    tick: int
    path: str
    """The RecoveryNode."""
    attempt: int
    """From 1."""
    allowed: int
    """number_of_retries."""
    cause: str
    """The leaf that failed; empty if no leaf did."""
    code: int
    """Its error code; 0 if it has none."""
    message: str

    @property
    def reason(self) -> str:
        """Why it did; the leaf is named relative to the RecoveryNode."""
        code = f" with code {self.code}" if self.code else ""
        why = f": {self.message:.120}" if self.message else ""
        return f"{self.cause.removeprefix(self.path + '/')} failed{code}{why}" if self.cause else "no leaf failed"

    def __str__(self) -> str:
        return f"{self.time:.2f} s, {self.path}, retry {self.attempt} of {self.allowed}: {self.reason}"


class Trace:
    """Record of the ticks of a tree. Its size is bounded: the oldest changes are forgotten, the counts are not."""

    def __init__(self, tree: Traced) -> None:
        self._tree = tree
        self._changes: deque[tuple[int, int, Node, Status]] = deque(maxlen=MAX_CHANGES)
        self._retries: deque[Retry] = deque(maxlen=MAX_RETRIES)
        self.retry_count = 0
        """Retries in all."""
        self._first_tick = 0

    def clear(self) -> None:
        """Forget everything."""
        self._changes.clear()
        self._retries.clear()
        self.retry_count = 0
        self._first_tick = self._tree.ticks
        for item in self._tree.nodes:
            item.counts[:] = [0, 0, 0, 0, 0]

    def changed(self, item: Node, status: Status) -> None:
        """Note that the result of a node has changed."""
        tree = self._tree
        self._changes.append((tree.now_ns, tree.ticks, item, status))

    def retried(self, item: Node, attempt: int, allowed: int) -> None:
        """Note that a RecoveryNode runs its second child after the failure of the first one."""
        leaf = self.cause_below(item.children[0])
        self.retry_count += 1
        tree = self._tree
        self._retries.append(
            Retry(
                tree.now_ns / NANO,
                tree.ticks,
                item.path,
                attempt,
                allowed,
                leaf.path if leaf is not None else "",
                leaf.code if leaf is not None else 0,
                leaf.message if leaf is not None else "",
            )
        )

    def cause_below(self, item: Node) -> Leaf | None:
        """Return the leaf below a node to which its failure in this tick is due: the last one with an error code, or the last."""
        first, end = item.index, item.index + item.size
        below = [leaf for leaf in self._tree.failed if first <= leaf.index < end]
        return next((leaf for leaf in reversed(below) if leaf.code), below[-1] if below else None)

    @property
    def changes(self) -> list[Change]:
        """The last changes, the oldest first."""
        return [Change(time / NANO, tick, item.path, status) for time, tick, item, status in self._changes]

    @property
    def retries(self) -> list[Retry]:
        """The last retries, the oldest first."""
        return list(self._retries)

    def running(self) -> list[str]:
        """Return the paths of the leaves that run now."""
        return [item.path for item in self._tree.nodes if isinstance(item, Leaf) and item.status is RUNNING]

    def lines(self, *, everything: bool = False) -> Iterator[str]:
        """Yield the tree with its counts: the nodes that ran, or all."""
        depth: dict[int, int] = {}
        for item in self._tree.nodes:
            level = depth.get(item.index, 0)
            for child in item.children:
                depth[child.index] = level + 1
            counts = item.counts
            ran = sum(counts[1:])
            if not ran and not everything:
                continue
            words = (
                ("running", RUNNING),
                ("succeeded", SUCCESS),
                ("failed", FAILURE),
                ("skipped", SKIPPED),
                ("halted", IDLE),
            )
            parts = [f"{word} {counts[status]}" for word, status in words if counts[status]]
            last = f" [{item.message}]" if isinstance(item, Leaf) and item.message else ""
            now = " <- running" if item.status is RUNNING else ""
            yield f"{'  ' * level}{item.label}: {', '.join(parts) or 'never ran'}{last}{now}"

    def _grouped(self) -> Iterator[str]:
        """Yield a line for all retries of one node for one reason."""
        groups: dict[tuple[str, str], list[Retry]] = {}
        for retry in self._retries:
            groups.setdefault((retry.path, retry.reason), []).append(retry)
        for (path, reason), found in groups.items():
            begin, end = found[0].time, found[-1].time
            when = f"{begin:.2f} s" if begin == end else f"{begin:.2f} to {end:.2f} s"
            times = "once" if len(found) == 1 else f"{len(found)} times"
            yield f"  {path} retries {times}, {when}: {reason}"

    def text(self, *, everything: bool = False) -> str:
        """Return the trace as compact text: the result, the nodes that ran with their counts, the retries and their causes."""
        tree = self._tree
        ticks = tree.ticks - self._first_tick
        head = f"{Path(tree.name).name}: {tree.status.name} after {ticks} ticks, at {tree.now_ns / NANO:.2f} s"
        found = [head, *self.lines(everything=everything)]
        if self.retry_count:
            shown = len(self._retries)
            more = f", the last {shown}" if shown < self.retry_count else ""
            found += [f"retries ({self.retry_count}{more}):", *self._grouped()]
        return "\n".join(found)

    __str__ = text
