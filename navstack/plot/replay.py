"""Picture of a replay: navstack's commands and those in the log over time."""

from __future__ import annotations

import os
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.plot import canvas, colors

_WIDTH, _HEIGHT = 10.0, 5.6
_PANELS: Final = ((3.0, 1.75), (0.55, 1.95))
_LABELS: Final = ("forward (m/s)", "turn (rad/s)")


def plot_replay(
    times: NDArray[np.float64],
    commands: NDArray[np.float64],
    recorded: NDArray[np.float64],
    rejected: NDArray[np.bool_],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str = "commands of a replay",
    first_difference: float | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw commands of navstack and of the log, (n, 3) vx, vy, wz at `times` (n,) s; NaN where there is none.

    `rejected` marks the cycles in which every sample was rejected. To a .png, .svg or .pdf, into two axes `ax`, or a new figure.
    Returns the file; without a path the axes. Raises OutputError, and InputError without cycles.
    """
    canvas.check_target(path, ax)
    if not len(times):
        raise InputError("the replay has no cycles: the log has no messages in the chosen part")
    with canvas.style():
        if ax is not None:
            panels = canvas.stacked_axes(ax, [height for _, height in _PANELS])
            panels[0].set_title(title, fontsize=9.0)
        else:
            figure = canvas.figure_for(path, _WIDTH, _HEIGHT)
            left, right = 0.72 / _WIDTH, 7.6 / _WIDTH
            figure.text(left, 1.0 - 0.3 / _HEIGHT, title, fontsize=12, fontweight="bold", va="baseline")
            panels = [figure.add_axes((left, b / _HEIGHT, right - left, h / _HEIGHT)) for b, h in _PANELS]
        for axes, column, label in zip(panels, (0, 2), _LABELS, strict=True):
            _draw(axes, times, commands[:, column], recorded[:, column], rejected, first_difference)
            axes.set_ylabel(label)
        panels[-1].set_xlabel("time in the log (s)")
        if ax is not None:
            panels[0].legend(fontsize=7, loc="upper right")
            return panels
        handles, labels = panels[0].get_legend_handles_labels()
        figure = panels[0].figure
        figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.772, 0.87), fontsize=8, frameon=False)
        return canvas.finish(figure, panels, path, dpi)


def _draw(
    axes: Any,
    times: NDArray[np.float64],
    command: NDArray[np.float64],
    recorded: NDArray[np.float64],
    rejected: NDArray[np.bool_],
    first: float | None,
) -> None:
    axes.set_xlim(times[0], max(float(times[-1]), float(times[0]) + 1.0))
    axes.grid(axis="x", color="#E3E3E3", lw=0.6)
    axes.set_axisbelow(True)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], rejected.astype(np.int8), [0]))))
    ends = np.append(times[1:], times[-1] + 0.05)
    label: str | None = "no valid command"
    for begin, end in edges.reshape(-1, 2).tolist():
        axes.axvspan(times[begin], ends[end - 1], color=colors.VERMILLION, alpha=0.25, lw=0, zorder=0, label=label)
        label = None
    if first is not None:
        axes.axvline(first, color=colors.INK, lw=1.0, ls=(0, (2, 2)), label="first difference")
    axes.plot(times, recorded, color=colors.ORANGE, lw=1.6, drawstyle="steps-post", label="in the log")
    axes.plot(times, command, color=colors.BLUE, lw=1.3, drawstyle="steps-post", label="navstack")
    axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
