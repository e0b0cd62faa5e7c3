"""`navstack localize --global --starts N`: from how many places of a log a localizer finds the pose."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navstack.cli.localize_options import LocalizeQuery
    from navstack.drives.starts import Starts
    from navstack.interfaces import Localizer


def localize_starts(
    query: LocalizeQuery, count: int, scans: tuple[int, int], *, seed: int, title: str, out: Path | None, json_: bool
) -> None:
    """Run the starts with each method, print a table, and write starts.json, starts.png and starts.csv."""
    from navstack.cli.drive_options import print_drive_notes
    from navstack.cli.output import counting_bar, loading_kernels, print_files, print_json
    from navstack.drives import drive_frames
    from navstack.drives.starts import run_starts

    every, first = scans
    found: dict[str, Starts] = {}
    with loading_kernels(quiet=json_):
        for name, method in query.methods.items():

            def make(number: int, method: Any = method) -> Localizer:
                localizer, _ = method.build(seed + number)
                localizer.set_map(query.grid)
                return localizer

            with counting_bar("starts", quiet=json_) as progress:
                found[name] = run_starts(
                    lambda: drive_frames(query.drive, every=every, first=first), make, count, progress
                )
    document = {name: starts.summary() for name, starts in found.items()}
    files = _write(found, document, query, title, out)
    if json_:
        print_json({"starts": document, "files": files})
        return
    print_drive_notes(query.drive)
    _print(found)
    print_files(files)


def _print(found: dict[str, Starts]) -> None:
    import numpy as np

    from navstack.cli.localize_report import short_names
    from navstack.cli.output import stdout, titled_table

    table = titled_table("global starts", left=("",), right=short_names(list(found)))
    columns: list[dict[str, str]] = []
    for starts in found.values():
        rate, times = starts.rate(), starts.table()
        rows = {
            "starts": f"{len(starts.results)}",
            "found": f"{len(starts.of('found'))}",
            "found, rate": f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]",
            "stayed uncertain": f"{len(starts.of('uncertain'))}",
            "certain of a wrong pose": f"{len(starts.of('wrong'))}",
        }
        if len(times):
            median, late = np.median(times, axis=0).tolist(), np.quantile(times, 0.95, axis=0).tolist()
            for name, unit, digits, a, b in zip(
                ("scans", "time", "distance"), ("", " s", " m"), (0, 1, 1), median, late, strict=True
            ):
                rows[f"{name}, median (95 % below)"] = f"{a:.{digits}f}{unit} ({b:.{digits}f}{unit})"
            errors = [r.error for r in starts.of("found")]
            rows["error then, median"] = f"{np.median(errors):.3f} m" if errors else "-"
        columns.append(rows)
    for label in dict.fromkeys(label for rows in columns for label in rows):
        table.add_row(label, *(rows.get(label, "-") for rows in columns))
    stdout().print(table)


def _write(
    found: dict[str, Starts], document: dict[str, Any], query: LocalizeQuery, title: str, out: Path | None
) -> dict[str, str]:
    from navstack.core.files import ensure_directory, write_json, write_text
    from navstack.plot.starts import plot_starts

    if out is None:
        return {}
    ensure_directory(out)
    write_json(out / "starts.json", document)
    files = {"results": str(out / "starts.json")}
    for number, (name, starts) in enumerate(found.items()):
        suffix = "" if number == 0 else "_versus"
        picture, table = out / f"starts{suffix}.png", out / f"starts{suffix}.csv"
        plot_starts(starts, query.grid, picture, title=f"{title}: {name}")
        lines = ["scan,x,y,yaw,outcome,scans,seconds,metres,error,wrong"]
        for r in starts.results:
            x, y, yaw = r.pose
            error = "" if r.error != r.error else f"{r.error:.4f}"
            lines.append(
                f"{r.scan},{x:.4f},{y:.4f},{yaw:.4f},{r.outcome},{r.scans},{r.seconds:.3f},{r.metres:.3f},{error},{r.wrong}"
            )
        write_text(table, "\n".join(lines) + "\n")
        files |= {f"picture{suffix}".replace("_", " "): str(picture), f"table{suffix}".replace("_", " "): str(table)}
    return files
