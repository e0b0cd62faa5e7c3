"""What the pictures share: a figure cut to the area of interest, grids in metres, poses, legends, files.

The object API of matplotlib on the Agg canvas: no pyplot (half a second to import), no windows, no global state. Styles of
the user do not reach in here, and files carry neither dates nor versions: the same input gives the same bytes.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, GridGeometry, Pose2D, Transform2D
from navstack.core.errors import OutputError
from navstack.core.files import ensure_directory, written_whole
from navstack.plot import colors
from navstack.plot.colors import Paint

FORMATS = (".png", ".svg", ".pdf")
MARK_PT = 7.0
"""Radius of the discs of start and goals, in points (1/72 inch)."""

_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": colors.INK,
    "axes.edgecolor": colors.FAINT,
    "axes.linewidth": 0.8,
    "xtick.color": colors.FAINT,
    "ytick.color": colors.FAINT,
    "xtick.labelcolor": colors.INK,
    "ytick.labelcolor": colors.INK,
    "text.color": colors.INK,
    "text.parse_math": False,  # a map may be called "$1"
    "axes.formatter.useoffset": False,  # 4500012 m, not 12 and "+4.5e6" in a corner
    "axes.formatter.limits": (-9, 9),
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "navstack",
    "path.simplify_threshold": 0.2,
}


@contextmanager
def style() -> Generator[None]:
    """Matplotlib's defaults and ours, whatever the user's matplotlibrc says; everything is drawn inside."""
    import matplotlib as mpl

    untouched = {"backend", "backend_fallback", "interactive", "toolbar", "webagg.address"}
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        # straight into the dictionary: checking three hundred defaults once more takes longer than the picture
        settings: Any = mpl.rcParams
        for key in mpl.rcParamsDefault:
            if key not in untouched:
                dict.__setitem__(settings, key, dict.__getitem__(mpl.rcParamsDefault, key))
        settings.update(_STYLE)
        yield


def check_format(path: Path, formats: Sequence[str] = FORMATS) -> None:
    """OutputError when nobody can draw what the ending of `path` asks for."""
    if path.suffix.lower() not in formats:
        known = ", ".join(formats)
        raise OutputError(f"cannot draw {path.name}: its ending must be one of {known}", path=str(path))


def save(figure: Any, path: Path, dpi: float) -> Path:
    """Writes the figure in the format of the path's ending, whole or not at all, with the same bytes every time."""
    suffix = path.suffix.lower()
    metadata: dict[str, Any] = {
        ".png": {"Software": None},
        ".svg": {"Date": None, "Creator": None},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }[suffix]
    ensure_directory(path.parent)
    with written_whole(path) as beside:
        figure.savefig(beside, dpi=dpi, format=suffix[1:], metadata=metadata)
    return path


# --- the area of interest ---------------------------------------------------------------------------------------------


def area_of(points: Sequence[NDArray[np.float64]]) -> Bounds:
    """The box around points (n, 2+), metres, as far as they are finite."""
    area = Bounds()
    for part in points:
        finite = part[np.isfinite(part[:, :2]).all(axis=1)]
        if len(finite):
            (x0, y0), (x1, y1) = finite[:, :2].min(axis=0), finite[:, :2].max(axis=0)
            area = area.union(Bounds(float(x0), float(y0), float(x1), float(y1)))
    return area


def shaped(area: Bounds, widest: float = 2.5, tallest: float = 1.4, least: float = 4.0) -> Bounds:
    """`area` grown about its middle until neither side is too short for a picture."""
    width, height = area.max_x - area.min_x, area.max_y - area.min_y
    new_width = max(width, height / tallest, least)
    new_height = max(height, width / widest, least)
    mx, my = (area.min_x + area.max_x) / 2.0, (area.min_y + area.max_y) / 2.0
    return Bounds(mx - new_width / 2.0, my - new_height / 2.0, mx + new_width / 2.0, my + new_height / 2.0)


def area_of_grid(geometry: GridGeometry) -> Bounds:
    """The whole grid."""
    x0, x1, y0, y1 = geometry.extent
    return Bounds(x0, y0, x1, y1)


# --- figures ----------------------------------------------------------------------------------------------------------


class Picture:
    """A figure with one pair of axes in metres, a title above and room for a legend beside it."""

    def __init__(
        self, area: Bounds, *, title: str, subtitle: str = "", width_in: float = 9.2, legend_in: float = 2.35
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        # a file name that is no UTF-8 holds lone surrogates, which no font draws
        title, subtitle = (text.encode("utf-8", "replace").decode() for text in (title, subtitle))
        self.area = area = shaped(area, least=0.0)
        left, right, bottom, top = 0.62, 0.18, 0.55, 0.72 if subtitle else 0.5
        w, h = area.max_x - area.min_x, area.max_y - area.min_y
        inner_w = width_in - left - right - legend_in
        inner_h = inner_w * h / w
        tallest = 6.6
        if inner_h > tallest:
            inner_w, inner_h = inner_w * tallest / inner_h, tallest
        size = (left + inner_w + right + legend_in, bottom + inner_h + top)
        self.figure = Figure(figsize=size)
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes(
            (left / size[0], bottom / size[1], inner_w / size[0], inner_h / size[1]), facecolor="#F4F4F4"
        )
        self.axes.set_aspect("equal", adjustable="box", anchor="NW")
        self.axes.set_xlim(area.min_x, area.max_x)
        self.axes.set_ylim(area.min_y, area.max_y)
        self.axes.set_xlabel("x (m)")
        self.axes.set_ylabel("y (m)")
        # long numbers ("10.25", "-1234.5") would push the label off the picture: it is made wider by as much
        written = self.axes.yaxis.get_tightbbox(self.canvas.get_renderer())
        lacking = 0.05 - written.x0 / self.figure.dpi if written is not None else 0.0
        if lacking > 0.0:
            left += lacking
            size = (size[0] + lacking, size[1])
            self.figure.set_size_inches(*size)
            self.axes.set_position((left / size[0], bottom / size[1], inner_w / size[0], inner_h / size[1]))
        self.points_per_m = 72.0 * min(inner_w / w, inner_h / h)
        """How many points (1/72 inch) a metre takes."""
        self._legend_at = ((left + inner_w + 0.12) / size[0], (bottom + inner_h) / size[1])
        x = left / size[0]
        y = (bottom + inner_h) / size[1]
        self.subtitle = self.figure.text(x, y + 0.12 / size[1], subtitle, fontsize=8.5, color="#666666", va="baseline")
        self.figure.text(
            x, y + (0.36 if subtitle else 0.16) / size[1], title, fontsize=12, fontweight="bold", va="baseline"
        )

    def legend(self, handles: Sequence[Any], labels: Sequence[str], **options: Any) -> Any:
        """The legend, outside to the right of the axes."""
        return self.figure.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=self._legend_at,
            borderaxespad=0.0,
            handlelength=2.2,
            labelspacing=0.75,
            handler_map=_handlers(),
            **options,
        )


# --- what is drawn ----------------------------------------------------------------------------------------------------


MOST_CELLS = 1600
"""So many cells along a side are drawn one by one; of finer grids, blocks."""


def visible(
    cells: NDArray[Any],
    paint: Paint,
    geometry: GridGeometry,
    area: Bounds,
    pose: Transform2D,
    *,
    clear: int | None = None,
) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """RGBA of the cells that `area` (m, the picture's frame) shows, and their extent (m, the grid's own frame).

    `pose`: where the grid's frame lies in the picture's.
    """
    corners = np.array([(x, y) for x in (area.min_x, area.max_x) for y in (area.min_y, area.max_y)])
    seen = pose.inverse().apply_points(corners)
    (x0, y0), (x1, y1) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    window = geometry.window_of(Bounds(x0, y0, x1, y1))
    part = cells[window.slices]
    block = max(1, math.ceil(max(part.shape) / MOST_CELLS))
    rgba = paint(np.ascontiguousarray(part), block=block, clear=clear)
    r = geometry.resolution
    left, bottom = geometry.origin_x + window.x0 * r, geometry.origin_y + window.y0 * r
    return rgba, (left, left + rgba.shape[1] * block * r, bottom, bottom + rgba.shape[0] * block * r)


def draw_grid(
    axes: Any,
    cells: NDArray[Any],
    paint: Paint,
    geometry: GridGeometry,
    *,
    area: Bounds,
    pose: Transform2D = Transform2D(),
    clear: int | None = None,
    zorder: float = 0.0,
) -> Any:
    """Draws the part of a grid that `area` shows; see `visible`. The image."""
    rgba, extent = visible(cells, paint, geometry, area, pose, clear=clear)
    limits = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(rgba, origin="lower", extent=extent, interpolation="antialiased", zorder=zorder, aspect="equal")
    if not pose.is_identity():
        image.set_transform(transform_of(pose) + axes.transData)
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])
    return image


def transform_of(pose: Transform2D) -> Any:
    """The rigid transform as matplotlib's."""
    from matplotlib.transforms import Affine2D

    return Affine2D().rotate(pose.yaw).translate(pose.x, pose.y)


def draw_line(
    axes: Any, poses: NDArray[np.float64], color: str, *, width: float, casing: bool = False, **options: Any
) -> Any:
    """A line through poses (n, 2+); with a white casing it stays legible on any ground."""
    from matplotlib.patheffects import Normal, Stroke

    effects = [Stroke(linewidth=width + 1.6, foreground="white", alpha=0.85), Normal()] if casing else None
    options.setdefault("solid_capstyle", "round")
    (line,) = axes.plot(poses[:, 0], poses[:, 1], color=color, linewidth=width, path_effects=effects, **options)
    return line


@dataclass(frozen=True, slots=True)
class Mark:
    """A start or a goal: a disc with a text in it and an arrow for the heading."""

    pose: Pose2D
    text: str
    color: str
    hollow: bool = False
    """Coloured on white instead of white on colour: a goal that was not reached."""


def draw_marks(axes: Any, marks: Sequence[Mark], points_per_m: float, *, zorder: float = 8.0) -> None:
    """Draws marks; those that would hide each other share the disc of the first and list their texts in it."""
    radius_pt = MARK_PT
    groups: list[list[Mark]] = []
    for mark in marks:
        if not mark.pose.is_finite():
            continue
        for group in groups:
            if group[0].pose.distance_to(mark.pose) * points_per_m < 1.5 * radius_pt:
                group.append(mark)
                break
        else:
            groups.append([mark])
    for group in groups:
        at = group[0].pose
        for mark in group:
            _arrow(axes, at, mark.pose.yaw, mark.color, radius_pt / points_per_m, zorder)
        color = group[0].color
        face, edge = ("white", color) if any(mark.hollow for mark in group) else (color, "white")
        label = ",".join(mark.text for mark in group)
        size = radius_pt * (1.0 + 0.22 * max(len(label) - 2, 0))
        axes.plot([at.x], [at.y], "o", ms=2 * size, color=face, mec=edge, mew=1.2, zorder=zorder + 0.1)
        axes.annotate(
            label,
            (at.x, at.y),
            color=edge,
            fontsize=8,
            fontweight="bold",
            ha="center",
            va="center_baseline",
            zorder=zorder + 0.2,
            annotation_clip=True,
        )


def draw_footprint(axes: Any, footprint: Any, pose: Pose2D, *, zorder: float = 4.8) -> Any:
    """The outline at a pose; the artist."""
    (outline,) = axes.fill(
        *footprint.at(pose).T, facecolor=colors.FOOTPRINT + "40", edgecolor=colors.BLUE, lw=0.8, zorder=zorder
    )
    return outline


def draw_heading(axes: Any, pose: Pose2D, color: str, points_per_m: float) -> None:
    """A small disc with an arrow."""
    _arrow(axes, pose, pose.yaw, color, 4.5 / points_per_m, 6.0)
    axes.plot([pose.x], [pose.y], "o", ms=5, color=color, mec="white", mew=0.8, zorder=6.1)


def _arrow(axes: Any, at: Pose2D, yaw: float, color: str, radius: float, zorder: float) -> None:
    c, s = math.cos(yaw), math.sin(yaw)
    axes.annotate(
        "",
        xy=(at.x + 3.1 * radius * c, at.y + 3.1 * radius * s),
        xytext=(at.x, at.y),
        arrowprops={
            "arrowstyle": "-|>,head_length=0.5,head_width=0.28",
            "color": color,
            "lw": 2.0,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=zorder,
        annotation_clip=True,
    )


# --- legend -----------------------------------------------------------------------------------------------------------


class Ramp:
    """A legend's handle for the costs between free and inscribed."""


def _handlers() -> dict[Any, Any]:
    from matplotlib.legend_handler import HandlerBase
    from matplotlib.patches import Rectangle

    class RampHandler(HandlerBase):
        """A swatch that runs through the ramp."""

        def create_artists(
            self,
            legend: Any,
            orig_handle: Any,
            xdescent: float,
            ydescent: float,
            width: float,
            height: float,
            fontsize: float,
            trans: Any,
        ) -> list[Any]:
            del legend, orig_handle, fontsize
            table = colors.cost_colors() / 255.0
            steps = 32
            parts = [
                Rectangle(
                    (-xdescent + width * i / steps, -ydescent),
                    width / steps * 1.05,
                    height,
                    facecolor=table[1 + round(251 * i / (steps - 1))],
                    edgecolor="none",
                    transform=trans,
                )
                for i in range(steps)
            ]
            frame = Rectangle(
                (-xdescent, -ydescent), width, height, facecolor="none", edgecolor=colors.FAINT, lw=0.5, transform=trans
            )
            return [*parts, frame]

    return {Ramp: RampHandler()}


def swatch(rgb: tuple[int, int, int]) -> Any:
    """A legend's handle: a box of one colour."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colors.hex_of(rgb), edgecolor=colors.FAINT, linewidth=0.5)


def cost_legend(costs: NDArray[np.uint8] | None) -> tuple[list[Any], list[str]]:
    """Handles and labels of the cost bands; only those that occur when `costs` are given."""
    bands = (
        (swatch(colors.FREE_RGB), "free (0)", (0, 0)),
        (Ramp(), "inflated (1 to 252)", (1, 252)),
        (swatch(colors.INSCRIBED_RGB), "inscribed (253)", (253, 253)),
        (swatch(colors.LETHAL_RGB), "lethal (254)", (254, 254)),
        (swatch(colors.UNKNOWN_RGB), "unknown (255)", (255, 255)),
    )
    present = np.ones(256, bool) if costs is None else np.bincount(costs.ravel(), minlength=256) > 0
    kept = [(handle, label) for handle, label, (low, high) in bands if present[low : high + 1].any()]
    return [handle for handle, _ in kept], [label for _, label in kept]


def occupancy_legend() -> tuple[list[Any], list[str]]:
    """Handles and labels of a map's cells."""
    return (
        [swatch(colors.FREE_RGB), swatch(colors.LETHAL_RGB), swatch(colors.UNKNOWN_RGB)],
        ["free", "occupied", "unknown"],
    )


def disc(color: str, *, hollow: bool = False) -> Any:
    """A legend's handle: the disc of a start or a goal."""
    from matplotlib.lines import Line2D

    face, edge = ("white", color) if hollow else (color, "white")
    return Line2D([], [], ls="none", marker="o", ms=9, color=face, mec=edge, mew=1.4 if hollow else 1.0)


def frame_handle() -> Any:
    """A legend's handle: the dashed frame of a rolling window."""
    from matplotlib.patches import Patch

    return Patch(facecolor="none", edgecolor=colors.INK, linestyle=(0, (3, 2)), linewidth=1.0)


def pose_of(row: NDArray[np.float64]) -> Pose2D:
    """A row x, y, yaw as a pose."""
    x, y, yaw = (float(v) for v in row)
    return Pose2D(x, y, yaw)
