"""Why a cell of a costmap has its cost: the explanation of each layer, and the one of the whole costmap."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from navstack.core import describe_cost
from navstack.core.errors import jsonable


@dataclass(frozen=True, slots=True)
class CellExplanation:
    """What one layer knows about one cell."""

    cost: int | None
    """Cost of the cell in this layer; None if the layer leaves the cell unchanged."""
    text: str
    """The explanation in words."""
    source: str | None = None
    """Observation source of the cost (or "map", "mask")."""
    stamp: float | None = None
    """Time at which the source observed the cell (s)."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True, slots=True)
class LayerShare:
    """Contribution of one layer to the cost of a cell."""

    layer: str
    """Instance name."""
    type: str
    """Class of the layer."""
    before: int
    """Cost in the master grid before this layer wrote."""
    after: int
    """Cost in the master grid after this layer wrote."""
    explanation: CellExplanation | None
    """The layer's own explanation; None if it has none."""


@dataclass(frozen=True, slots=True)
class CellProvenance:
    """Origin of the cost of one cell of a costmap, layer by layer."""

    costmap: str
    ix: int
    iy: int
    x: float
    """x of the cell's centre (m), in the costmap's frame."""
    y: float
    """y of the cell's centre (m)."""
    cost: int
    """Cost in the master grid."""
    set_by: str | None
    """Instance name of the layer that wrote this cost last; None if no layer wrote (default cost)."""
    source: str | None
    """Observation source of the cost; for an inflated cell, the source of its obstacle."""
    stamp: float | None
    """Time at which the source observed it (s)."""
    updated_at: float | None
    """Time of the costmap's last update (s)."""
    layers: tuple[LayerShare, ...]
    obstacle: CellProvenance | None = None
    """The lethal cell whose inflation set this cost."""
    stale: bool = False
    """True if the layers would now write another cost: the cell was outside the windows of the last updates."""

    @property
    def text(self) -> str:
        """The explanation in words, one line per layer."""
        by = "default cost, no layer wrote here" if self.set_by is None else f"set by {self.set_by}"
        if self.source is not None:
            by += f', from "{self.source}"' + ("" if self.stamp is None else f" at {self.stamp:.3f} s")
        lines = [
            f"{self.costmap} cell ({self.ix}, {self.iy}) at ({self.x:.3f}, {self.y:.3f}): {describe_cost(self.cost)}, {by}"
        ]
        for share in self.layers:
            text = share.explanation.text if share.explanation else "no explanation"
            lines.append(f"  {share.layer}: {share.before} -> {share.after}; {text}")
        if self.obstacle is not None:
            lines += ["  obstacle: " + self.obstacle.text.replace("\n", "\n  ")]
        if self.stale:
            lines.append("  the next update of this cell changes its cost")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as a dictionary for JSON."""
        return {
            "costmap": self.costmap,
            "cell": [self.ix, self.iy],
            "at": [self.x, self.y],
            "cost": self.cost,
            "set_by": self.set_by,
            "source": self.source,
            "stamp": self.stamp,
            "updated_at": self.updated_at,
            "stale": self.stale,
            "layers": [_share_as_dict(share) for share in self.layers],
            "obstacle": self.obstacle.as_dict() if self.obstacle else None,
            "text": self.text,
        }


def _share_as_dict(share: LayerShare) -> dict[str, Any]:
    found = share.explanation
    return {
        "layer": share.layer,
        "type": share.type,
        "before": share.before,
        "after": share.after,
        "cost": found.cost if found else None,
        "text": found.text if found else None,
        "source": found.source if found else None,
        "stamp": found.stamp if found else None,
        "data": jsonable(found.data) if found else {},
    }
