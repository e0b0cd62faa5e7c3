"""The picture of the goal manager's state machine, drawn from its transition table."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from navstack.move_base import ROWS, Mode
from navstack.plot import canvas, colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Edges = dict[tuple[Mode, Mode], list[str]]

_ACTIVE = (Mode.PLANNING, Mode.CONTROLLING, Mode.CLEARING)
_AT = {
    Mode.IDLE: (1.5, 4.6),
    Mode.PLANNING: (6.6, 7.1),
    Mode.CONTROLLING: (13.2, 7.1),
    Mode.CLEARING: (9.9, 2.2),
}
_COLOR = {
    Mode.IDLE: "#E8E8E8",
    Mode.PLANNING: "#FCE9C0",
    Mode.CONTROLLING: "#CBE5F7",
    Mode.CLEARING: "#F3D3E4",
}
_ARROWS: dict[tuple[Mode, Mode], tuple[Any, Any, tuple[float, float], str]] = {
    (Mode.IDLE, Mode.PLANNING): ((2.1, 5.02), (5.4, 7.1), (2.75, 6.2), "right"),
    (Mode.PLANNING, Mode.CONTROLLING): ((7.8, 7.25), (12.0, 7.25), (9.9, 7.35), "center"),
    (Mode.CONTROLLING, Mode.PLANNING): ((12.0, 6.9), (7.8, 6.9), (9.9, 6.55), "center"),
    (Mode.PLANNING, Mode.CLEARING): ((6.1, 6.68), (8.7, 2.35), (6.75, 4.1), "right"),
    (Mode.CLEARING, Mode.PLANNING): ((9.2, 2.62), (7.1, 6.68), (8.45, 4.75), "left"),
    (Mode.CONTROLLING, Mode.CLEARING): ((13.2, 6.68), (10.9, 2.62), (12.5, 4.1), "left"),
    (Mode.CONTROLLING, Mode.IDLE): ((13.2, 7.52), (0.9, 5.02), (3.3, 8.02), "left"),
    (Mode.CLEARING, Mode.IDLE): ((8.7, 2.0), (1.2, 4.18), (4.2, 1.72), "left"),
}
"""Start, end, position and alignment of the label of each arrow, in the coordinates of the picture."""
_WIDTH_IN = 12.4
_HALF_WIDTH, _HALF_HEIGHT = 1.2, 0.42


def edges() -> tuple[Edges, Edges, dict[Mode, list[str]]]:
    """Return the events by arrow: between two states, from all states with an active goal, and self-transitions.

    The second are keyed by (PLANNING, target): their events lead to the target from each of these states.
    """
    all_: Edges = {}
    for row in ROWS:
        names = all_.setdefault((row.mode, row.to), [])
        if row.event.name not in names:
            names.append(row.event.name)
    common: Edges = {}
    for target in (Mode.IDLE, Mode.PLANNING):
        shared = [e for e in all_[_ACTIVE[0], target] if all(e in all_.get((m, target), []) for m in _ACTIVE)]
        common[Mode.PLANNING, target] = shared
    own: Edges = {}
    loops: dict[Mode, list[str]] = {mode: [] for mode in Mode}
    for (source, target), names in all_.items():
        left = [n for n in names if source is Mode.IDLE or n not in common.get((Mode.PLANNING, target), [])]
        if source is target:
            loops[source] = left
        elif left:
            own[source, target] = left
    return own, common, loops


def plot_states(path: str | os.PathLike[str] | None = None, *, ax: Axes | None = None, dpi: float = 130.0) -> Any:
    """Draw the state machine to a .png, .svg or .pdf, into the axes `ax`, or a new figure.

    Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    own, common, loops = edges()
    with canvas.style():
        axes = ax
        if axes is None:
            axes = canvas.figure_for(path, _WIDTH_IN, 7.2).add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(0.0, 15.5)
        axes.set_ylim(0.0, 9.0)
        axes.axis("off")
        axes.text(
            0.3,
            8.6,
            "move_base: states of the goal manager and the events that change them",
            fontsize=12,
            weight="bold",
        )
        _frame(axes)
        for mode in Mode:
            _box(axes, mode, loops[mode])
        _draw_transitions(axes, own)
        _draw_common(axes, common)
        if ax is not None:
            # the texts have the size that fits the width of a figure of its own
            shrink = min(1.0, axes.get_window_extent().width / axes.figure.dpi / _WIDTH_IN)
            for text in axes.texts:
                text.set_fontsize(shrink * float(text.get_fontsize()))
        return canvas.finish(axes.figure, axes, path, dpi)


def _draw_transitions(axes: Axes, own: Edges) -> None:
    """Draw the arrows between single states."""
    for pair, names in own.items():
        start, end, label, side = _ARROWS[pair]
        bend = {
            (Mode.CONTROLLING, Mode.IDLE): "angle,angleA=90,angleB=90",
            (Mode.CLEARING, Mode.IDLE): "angle,angleA=180,angleB=90,rad=6",
        }.get(pair, "arc3,rad=0")
        if pair == (Mode.CONTROLLING, Mode.IDLE):
            # this arrow runs above the frame
            axes.plot([13.2, 13.2, 0.9], [7.52, 7.95, 7.95], color=colors.BLACK, lw=1.1, solid_joinstyle="round")
            start, bend = (0.9, 7.95), "arc3,rad=0"
        _arrow(axes, start, end, bend, colors.BLACK)
        axes.text(*label, "\n".join(names), fontsize=8, ha=side, va="bottom" if side == "center" else "center")


def _draw_common(axes: Axes, common: Edges) -> None:
    """Draw the arrows that leave every state with an active goal."""
    _arrow(axes, (3.9, 4.6), (2.7, 4.6), "arc3,rad=0", colors.VERMILLION)
    ends = "\n".join(common[Mode.PLANNING, Mode.IDLE])
    axes.text(3.8, 4.4, "active states:\n" + ends, fontsize=8, ha="right", va="top", color=colors.VERMILLION)
    _arrow(axes, (3.9, 5.7), (6.0, 6.68), "arc3,rad=0", colors.BLUE)
    again = "\n".join(common[Mode.PLANNING, Mode.PLANNING])
    axes.text(4.1, 5.5, "active states:\n" + again, fontsize=8, ha="left", va="top", color=colors.BLUE)


def _frame(axes: Axes) -> None:
    from matplotlib.patches import FancyBboxPatch

    box = FancyBboxPatch(
        (3.9, 0.4), 11.3, 7.35, "round,pad=0,rounding_size=0.25", fc="none", ec="#999999", ls="--", lw=1.0
    )
    axes.add_patch(box)
    axes.text(15.0, 0.55, "goal active", fontsize=9, ha="right", color="#666666", style="italic")


def _box(axes: Axes, mode: Mode, loops: list[str]) -> None:
    from matplotlib.patches import FancyBboxPatch

    x, y = _AT[mode]
    axes.add_patch(
        FancyBboxPatch(
            (x - _HALF_WIDTH, y - _HALF_HEIGHT),
            2.0 * _HALF_WIDTH,
            2.0 * _HALF_HEIGHT,
            "round,pad=0,rounding_size=0.15",
            fc=_COLOR[mode],
            ec=colors.BLACK,
            lw=1.2,
            zorder=5,
        )
    )
    axes.text(x, y, mode.value, fontsize=11, weight="bold", ha="center", va="center", zorder=6)
    place = {
        Mode.IDLE: (0.3, 0.55, "left", "bottom"),
        Mode.PLANNING: (4.1, 3.6, "left", "top"),
        Mode.CONTROLLING: (15.0, 6.5, "right", "top"),
        Mode.CLEARING: (11.3, 2.5, "left", "top"),
    }[mode]
    text = f"{mode.value}\nself-transitions:\n" + "\n".join(loops)
    axes.text(place[0], place[1], text, fontsize=7, ha=place[2], va=place[3], color="#555555")


def _arrow(axes: Axes, start: Any, end: Any, connection: str, color: str) -> None:
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "-|>",
            "color": color,
            "lw": 1.1,
            "connectionstyle": connection,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
