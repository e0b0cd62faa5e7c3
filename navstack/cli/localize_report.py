"""What `navstack localize` prints and writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid
    from navstack.drives.follow import Track
    from navstack.drives.relations import RelationResult
    from navstack.localization.metrics import PoseErrors

_LONGEST_NAME: Final = 24


def print_tracks(tracks: dict[str, Track], relations: dict[str, RelationResult]) -> None:
    """Print a table with a column for each track."""
    from navstack.cli.output import stdout, titled_table

    columns = {name: _rows(track, relations.get(name)) for name, track in tracks.items()}
    table = titled_table("localization", left=("",), right=short_names(list(columns)))
    labels = list(dict.fromkeys(label for rows in columns.values() for label in rows))
    for label in labels:
        table.add_row(label, *(rows.get(label, "-") for rows in columns.values()))
    stdout().print(table)


def short_names(names: list[str]) -> tuple[str, ...]:
    """Return names for columns; long ones are printed above the table and get a letter."""
    from navstack.cli.output import stdout

    if all(len(name) <= _LONGEST_NAME for name in names):
        return tuple(names)
    letters = tuple("ABCDEFGH"[: len(names)])
    for letter, name in zip(letters, names, strict=True):
        stdout().print(f"{letter}: {name}", markup=False)
    return letters


def _rows(track: Track, relations: RelationResult | None) -> dict[str, str]:
    """Return the results of a track by name."""
    import numpy as np

    estimated = np.isfinite(track.poses).all(axis=1)
    rows = {
        "scans": f"{len(track.indices)}",
        "without an estimate": f"{int((~estimated).sum())}",
        "lost": f"{int(track.lost.sum())}",
        "particles, median": f"{np.median(track.particles):.0f}",
        "particles, most": f"{track.particles.max()}",
        "time per scan": f"{track.ms_per_scan:.2f} ms",
    }
    if track.known.sum() > 1:
        absolute, steps, far = track.absolute(), track.relations(), track.relative(10.0).position
        rows |= {
            "absolute error, rms": f"{absolute.position.rms:.3f} m",
            "absolute error, 95 %": f"{absolute.position.p95:.3f} m",
            "absolute error, most": f"{absolute.position.max:.3f} m",
            "heading error, rms": f"{math.degrees(absolute.heading.rms):.2f}°",
            "heading error, most": f"{math.degrees(absolute.heading.max):.2f}°",
            "sure, but 0.5 m off": f"{track.sure_but_wrong} scans",
            **_relation_rows("scan to scan", steps),
        }
        if far.count:
            rows |= {"over 10 m, rms": f"{far.rms:.3f} m", "over 10 m, most": f"{far.max:.3f} m"}
    if relations is not None:
        rows |= {
            "relations": f"{relations.errors.position.count}",
            "relations outside": f"{relations.outside}",
            "relations between scans": f"{relations.interpolated}",
            **_relation_rows("relations", relations.errors),
            "relations, squares": f"{relations.square_m2[0]:.4f} ± {relations.square_m2[1]:.4f} m²",
        }
    return rows


def _relation_rows(name: str, errors: PoseErrors) -> dict[str, str]:
    """Return mean, standard deviation and maximum of the errors of relations."""
    moved, turned = errors.position, errors.heading
    return {
        f"{name}, mean": f"{moved.mean:.3f} ± {moved.std:.3f} m",
        f"{name}, most": f"{moved.max:.3f} m",
        f"{name}, heading": f"{math.degrees(turned.mean):.2f} ± {math.degrees(turned.std):.2f}°",
    }


def write_tracks(
    tracks: dict[str, Track],
    document: dict[str, Any],
    grid: OccupancyGrid,
    title: str,
    out: Path | None,
    animate: Path | None,
) -> dict[str, str]:
    """Write the products of `--out` and `--animate`; return their names."""
    from navstack.core.files import ensure_directory, write_json
    from navstack.plot.localization import animate_track, plot_track, plot_track_errors

    files: dict[str, str] = {}
    if out is not None:
        ensure_directory(out)
        write_json(out / "localize.json", document)
        plot_track(tracks, grid, out / "localize.png", title=title)
        plot_track_errors(tracks, out / "errors.png")
        files |= {"results": "localize.json", "picture": "localize.png", "errors": "errors.png"}
        for number, track in enumerate(tracks.values()):
            name = "trajectory.csv" if number == 0 else "trajectory_versus.csv"
            _write_trajectory(track, out / name)
            files[name.removesuffix(".csv").replace("_", " ")] = name
        files = {what: str(out / name) for what, name in files.items()}
    if animate is not None:
        files["animation"] = str(animate_track(next(iter(tracks.values())), grid, animate, title=title))
    return files


def _write_trajectory(track: Track, path: Path) -> None:
    from navstack.core.files import write_text

    lines = ["scan,stamp,x,y,yaw,reference_x,reference_y,reference_yaw,particles,explained,lost"]
    for i in range(len(track.indices)):
        values = [track.stamps[i], *track.poses[i], *track.references[i]]
        texts = ",".join("" if v != v else f"{v:.6f}" for v in values)
        explained = "" if track.explained[i] != track.explained[i] else f"{track.explained[i]:.4f}"
        lines.append(f"{track.indices[i]},{texts},{track.particles[i]},{explained},{int(track.lost[i])}")
    write_text(path, "\n".join(lines) + "\n")
