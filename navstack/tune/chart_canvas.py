"""Figures of the tuning charts. Imports matplotlib on first use."""

from __future__ import annotations

from typing import Any, Final

DPI: Final = 110.0
DASHED: Final = (0, (4, 2))


def new_figure(width: float, height: float, *, title: str) -> Any:
    """An empty figure (inches) with a title at the top left."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
    return figure
