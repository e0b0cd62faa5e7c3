"""Encoders of animations: GIF with pillow, MP4 with the program ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import OutputError
from navstack.plot import colors

Frames = Callable[[float], NDArray[np.uint8]]
"""Returns the pixels (h, w, 3) of the frame at a time (s)."""
Progress = Callable[[int, int], None]
"""Called with the number of finished frames and of all frames."""

_HOLD_S = 2.0
"""Duration of the last frame (s of the animation)."""


def write_gif(frame: Frames, times: NDArray[np.float64], fps: float, path: Path, progress: Progress | None) -> None:
    """Write the frames at `times` (s of the run) as an endless GIF. GIF rounds the frame duration to 10 ms."""
    from PIL import Image

    palette = _Palette([frame(float(t)) for t in times[:: max(1, len(times) // 5)]])

    def frames() -> Iterator[Image.Image]:
        for done, t in enumerate(times[1:], 2):
            yield palette.paint(frame(float(t)))
            if progress is not None:
                progress(done, len(times))

    first = palette.paint(frame(float(times[0])))
    if progress is not None:
        progress(1, len(times))
    shown = [max(2, round(100.0 / fps)) * 10] * len(times)
    shown[-1] = int(_HOLD_S * 1000)
    # pillow does not close a file that it opened itself when a frame raises
    with path.open("wb") as out:
        first.save(
            out, format="GIF", save_all=True, append_images=frames(), duration=shown, loop=0, optimize=False, disposal=1
        )


class _Palette:
    """One palette of 256 colors for all frames, which avoids flicker and keeps the file small.

    It contains every color with a meaning exactly; the remaining entries are shared by the shades between them.
    """

    def __init__(self, frames: list[NDArray[np.uint8]]) -> None:
        from PIL import Image

        exact = colors.exact_colors()
        shades = Image.fromarray(np.concatenate(frames)).quantize(256 - len(exact), method=Image.Quantize.MEDIANCUT)
        self._table = np.concatenate((exact, np.array(shades.getpalette("RGB"), np.uint8).reshape(-1, 3)))
        # palette entry of every RGB value, filled on demand
        self._entry = np.zeros(1 << 24, np.uint8)
        self._known = np.zeros(1 << 24, np.bool_)

    def paint(self, frame: NDArray[np.uint8]) -> Any:
        """Return the frame as a pillow image, with the nearest color of the palette for every pixel."""
        from PIL import Image

        rgb = frame.astype(np.uint32)
        codes = (rgb[:, :, 0] << 16) | (rgb[:, :, 1] << 8) | rgb[:, :, 2]
        new = np.unique(codes[~self._known[codes]])
        for part in np.array_split(new, len(new) // 4096 + 1):
            split = np.stack((part >> 16, part >> 8 & 255, part & 255), axis=1).astype(np.int32)
            distance = ((split[:, None, :] - self._table.astype(np.int32)) ** 2).sum(axis=2)
            self._entry[part] = distance.argmin(axis=1)
            self._known[part] = True
        image = Image.fromarray(self._entry[codes], mode="P")
        image.putpalette(self._table.tobytes())
        return image


def find_ffmpeg(path: Path) -> str:
    """Return the path of ffmpeg. Raises OutputError if it is not installed."""
    program = shutil.which("ffmpeg")
    if program is None:
        raise OutputError(
            f"cannot write {path.name}: MP4 needs the program ffmpeg, which is not installed; "
            f"install it, or write {path.stem}.gif",
            path=str(path),
        )
    return program


def write_mp4(
    frame: Frames,
    times: NDArray[np.float64],
    fps: float,
    path: Path,
    progress: Progress | None,
    program: str,
) -> None:
    """Write the frames at `times` (s of the run) as H.264. Raises OutputError if ffmpeg fails."""
    first = frame(float(times[0]))
    # H.264 with 4:2:0 chroma requires even sizes
    height, width = first.shape[0] // 2 * 2, first.shape[1] // 2 * 2
    command = [
        *(program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p"),
        *("-crf", "20", "-threads", "1", "-bitexact", "-map_metadata", "-1", "-movflags", "+faststart"),
        *("-f", "mp4", str(path)),
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stderr is not None
    held = round(_HOLD_S * fps)
    try:
        for done, t in enumerate(times, 1):
            pixels = np.ascontiguousarray(frame(float(t))[:height, :width]).tobytes()
            for _ in range(1 + (held if done == len(times) else 0)):
                process.stdin.write(pixels)
            if progress is not None:
                progress(done, len(times))
    except BrokenPipeError:
        pass  # ffmpeg failed; its error output is reported below
    except BaseException:
        process.kill()
        raise
    finally:
        _, errors = process.communicate()
    if process.returncode != 0:
        reason = errors.decode(errors="replace").strip().splitlines() or ["no error message"]
        raise OutputError(f"ffmpeg failed to write {path.name}: {reason[-1]}; write a .gif", path=str(path))
