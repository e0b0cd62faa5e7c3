"""Animations of runs: what the robot observed, planned and drove, frame by frame, as GIF or MP4."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.files import atomic_write, ensure_directory
from navstack.plot import canvas
from navstack.plot.encoders import find_ffmpeg, write_gif, write_mp4
from navstack.plot.film import Film
from navstack.plot.run import circumstances
from navstack.record import Record


def animate_run(
    record: Record,
    path: str | os.PathLike[str],
    *,
    fps: float = 10.0,
    speed: float = 4.0,
    title: str | None = None,
    dpi: float = 90.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Writes a run as .gif or .mp4, with `fps` frames per second and `speed` simulated seconds per second.

    `progress(done, total)` is called after every frame. Frames are encoded one by one, so that the memory does not grow with
    the run. Raises OutputError for another suffix, a missing ffmpeg (MP4) or an unwritable folder; InputError for `fps` or
    `speed` that are not positive, and for a run without samples. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be a positive number, not {value}", **{name: value})
    if not len(record.times):
        raise InputError("the run has no samples to animate")
    ffmpeg = find_ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        film = Film(record, title or circumstances(record) or "run", dpi)
        times = _frame_times(record, fps, speed)
        with atomic_write(out) as partial:
            if ffmpeg is None:
                write_gif(film.frame, times, fps, partial, progress)
            else:
                write_mp4(film.frame, times, fps, partial, progress, ffmpeg)
    return out


def _frame_times(record: Record, fps: float, speed: float) -> NDArray[np.float64]:
    first, last = float(record.times[0]), float(record.times[-1])
    count = int(np.ceil((last - first) * fps / speed)) + 1
    return np.minimum(first + np.arange(count) * (speed / fps), last)
