"""Read and write maps of map_server: a YAML file and an image <-> an OccupancyGrid.

Source of the rules: map_server/src/main.cpp and image_loader.cpp. Row 0 of an image is its top, row 0 of a grid its bottom:
only this module flips them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from navstack.core import (
    GridGeometry,
    MapError,
    NotRegularFileError,
    OccupancyGrid,
    TooLargeError,
    atomic_write,
    data_folder,
    ensure_directory,
    open_regular,
    read_bytes,
    short_repr,
    write_text,
)
from navstack.parameters import DictNode, parse_value, plain

if TYPE_CHECKING:
    from PIL.Image import Image

MODES: Final = ("trinary", "scale", "raw")
IMAGE_SUFFIXES: Final = frozenset({".pgm", ".png", ".bmp", ".jpg", ".jpeg", ".gif", ".tif", ".tiff", ".ppm", ".pnm"})
MAX_CELLS: Final = 80_000_000
"""Largest image: 80 million cells, 447 m x 447 m at 5 cm. Larger maps are mistakes or attacks."""

_Convert = Callable[[NDArray[np.uint8], NDArray[np.uint8] | None], NDArray[np.int8]]
"""Channels (ny, nx, k) and alpha (ny, nx) or None -> occupancy (ny, nx)."""

_BAND: Final = 4_000_000
"""Cells of an image that are converted at once."""

MAX_BYTES: Final = 100_000
"""Largest YAML file."""

_FORMATS: Final = ("PPM", "PNG", "BMP", "JPEG", "GIF", "TIFF", "TGA", "PCX", "XPM", "WEBP")
"""Formats that SDL_image, which map_server uses, reads as well. Pillow starts programs for some of the others (EPS)."""

_NO_SCALE: Final = (
    "it has floating-point pixels, and the file does not say which values are black and white (map_server does not read it "
    "either); it needs 8 bits per pixel, 0 for occupied and 255 for free"
)
_PLACES: Final = ".places.yaml"
_EXAMPLES: Final = {
    "image": "image: map.pgm",
    "resolution": "resolution: 0.05",
    "origin": "origin: [0.0, 0.0, 0.0]",
    "negate": "negate: 0",
    "occupied_thresh": "occupied_thresh: 0.65",
    "free_thresh": "free_thresh: 0.196",
    "mode": "mode: trinary",
}
_SAVED: Final = {-1: 205, 0: 254, 100: 0}
"""Pixels of map_saver by value."""
_REQUIRED: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True)
class _Yaml:
    """Content of a map's YAML file with the line of each key."""

    path: Path
    values: dict[str, Any]
    lines: dict[str, int]

    def error(self, key: str, problem: str) -> MapError:
        """Return a MapError with the line of `key`."""
        line = self.lines.get(key, 1)
        return MapError(f"{self.path}:{line}: {problem}", file=str(self.path), line=line, key=key)

    def value(self, key: str) -> Any:
        """Return the value of a required key."""
        if key not in self.values:
            raise self.error(key, f'"{key}" is missing; add for example "{_EXAMPLES[key]}"')
        return self.values[key]

    def number(self, key: str) -> float:
        """Return a finite number. Also accepts `5e-2`, which YAML 1.1 reads as text."""
        number = _as_float(self.value(key))
        if number is None or not math.isfinite(number):
            raise self.error(
                key,
                f'"{key}" must be a number, not {short_repr(self.values[key])}; write for example "{_EXAMPLES[key]}"',
            )
        return number

    def fraction(self, key: str) -> float:
        """Return a number from 0 to 1."""
        number = self.number(key)
        if not 0.0 <= number <= 1.0:
            raise self.error(
                key,
                f'"{key}" must be between 0 (white) and 1 (black), not {number:g}; write for example "{_EXAMPLES[key]}"',
            )
        return number


def load_map(path: str | Path) -> OccupancyGrid:
    """Return the occupancy grid that map_server publishes for a YAML file, or a packaged map by name, in the frame `map`.

    The path of the image (pgm, png, bmp, ..) is relative to the YAML file. Supports the modes trinary, scale and raw, `negate`,
    and the yaw of `origin`. Raises MapError with file and line for an invalid map.
    """
    return _load(_file_of(path), lowest=1.0, highest=99.0)


def _file_of(path: str | Path) -> Path:
    """Return the file of a map: a packaged one if there is no file of this name."""
    file = Path(path)
    return map_path(str(path)) if str(path) in map_names() and not file.is_file() else file


def load_mask(path: str | Path) -> OccupancyGrid:
    """Return the mask of a costmap filter as Nav2's map_server publishes it.

    Differs from `load_map` in the mode scale: Nav2 maps it to 0 .. 100, rounded. White is 0, which means no limit; in ROS 1's
    map_server it is 1, a limit of 1 %.
    """
    return _load(path, lowest=0.0, highest=100.0)


def _load(path: str | Path, *, lowest: float, highest: float) -> OccupancyGrid:
    """Load a map. `lowest`, `highest`: values of the two thresholds in the mode scale."""
    document = _read_yaml(Path(path))
    resolution = document.number("resolution")
    if resolution <= 0.0:
        raise document.error(
            "resolution", f'"resolution" must be a positive number of meters per cell, not {resolution:g}'
        )
    x, y, yaw = _origin(document)
    mode, negate, occupied, free = _rules(document)
    span = (lowest, highest)

    def occupancy(channels: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> NDArray[np.int8]:
        return _occupancy(channels, alpha, mode=mode, negate=negate, occupied=occupied, free=free, span=span)

    data = _read_image(document, occupancy)
    ny, nx = data.shape
    return OccupancyGrid(data, GridGeometry(nx, ny, resolution, x, y), yaw, "map", raw=mode == "raw")


def _rules(document: _Yaml) -> tuple[str, bool, float, float]:
    """Return mode, negate, occupied_thresh and free_thresh."""
    negate = _negate(document)
    occupied, free = document.fraction("occupied_thresh"), document.fraction("free_thresh")
    if free >= occupied:
        raise document.error(
            "free_thresh",
            f"free_thresh ({free:g}) must be smaller than occupied_thresh ({occupied:g}); "
            f"the usual values of map_server are 0.196 and 0.65",
        )
    mode = str(document.values.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise document.error(
            "mode", f'"mode" must be one of {", ".join(MODES)}, not {short_repr(document.values["mode"])}'
        )
    return mode, negate, occupied, free


def save_map(grid: OccupancyGrid, path: str | Path, *, like: str | Path | None = None) -> tuple[Path, Path]:
    """Write `grid` as the YAML file `path` and a pgm image next to it, each atomically; return both paths.

    Grids of -1, 0 and 100 are written as by map_saver (mode trinary, pixels 205, 254, 0), others in mode raw. With `like`, the
    YAML file (or packaged name) of another map, its fields are kept: mode, negate, thresholds, and those that map_server does
    not know; values that its mode cannot express are written as without it. In all cases `load_map` restores the same cells.
    Raises OutputError if the files cannot be written, MapError if `like` is no map.
    """
    from PIL import Image

    target = Path(path)
    if target.suffix.lower() not in (".yaml", ".yml"):
        target = target.with_name(target.name + ".yaml")
    source = None if like is None else _read_yaml(_file_of(like))
    kept = None if source is None else _kept(source, grid)
    ensure_directory(target.parent)
    image_path = target.with_suffix(".pgm")
    if kept is None:
        trinary = bool(np.isin(grid.data, (-1, 0, 100)).all())
        fields = {
            "mode": "trinary" if trinary else "raw",
            "negate": "0",
            "occupied_thresh": "0.65",
            "free_thresh": "0.196",
        }
        table = np.arange(256, dtype=np.uint8)
        if trinary:
            table[[value & 255 for value in _SAVED]] = list(_SAVED.values())
        pixels = table[grid.data.view(np.uint8)]
    else:
        fields, pixels = kept
    others = {} if source is None else {key: source.values[key] for key in source.values if key not in _EXAMPLES}
    with atomic_write(image_path) as beside:
        Image.fromarray(np.ascontiguousarray(pixels[::-1])).save(beside)
    geometry = grid.geometry
    origin = ", ".join(map(_yaml_float, (geometry.origin_x, geometry.origin_y, grid.origin_yaw)))
    lines = [f"image: {image_path.name}", f"mode: {fields.pop('mode')}"]
    lines += [f"resolution: {_yaml_float(geometry.resolution)}", f"origin: [{origin}]"]
    lines += [f"{key}: {value}" for key, value in fields.items()]
    more = yaml.safe_dump(others, sort_keys=False, default_flow_style=None) if others else ""
    write_text(target, "\n".join(lines) + "\n" + more)
    return target, image_path


def _kept(source: _Yaml, grid: OccupancyGrid) -> tuple[dict[str, str], NDArray[np.uint8]] | None:
    """Return the fields of a map and the pixels (ny, nx) that mean the grid's values by them; None if some have no pixel."""
    mode, negate, occupied, free = _rules(source)
    gray = np.arange(256, dtype=np.uint8).reshape(1, 256, 1)
    meant = _occupancy(gray, None, mode=mode, negate=negate, occupied=occupied, free=free, span=(1.0, 99.0))[0]
    table = np.zeros(256, np.uint8)
    for value in np.unique(grid.data).tolist():
        pixels = np.nonzero(meant == value)[0]
        if len(pixels) == 0:
            return None
        usual = _SAVED.get(value, -1)
        table[value & 255] = usual if usual in pixels else pixels[len(pixels) // 2]
    fields = {"mode": mode, "negate": str(int(negate))}
    fields |= {"occupied_thresh": _yaml_float(occupied), "free_thresh": _yaml_float(free)}
    return fields, table[grid.data.view(np.uint8)]


def _yaml_float(value: float) -> str:
    """Return the shortest text that reads back as the same float. YAML 1.1 requires a dot in it."""
    text = repr(float(value))
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


# --- YAML -------------------------------------------------------------------------------------------------------------


def _read_yaml(path: Path) -> _Yaml:
    def error(problem: str, line: int = 1) -> MapError:
        return MapError(f"{path}:{line}: {problem}", file=str(path), line=line)

    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise MapError(
            f"{path} is an image; pass the YAML file of the map, which names the image. Create {path.stem}.yaml with\n"
            + "\n".join(f"  {_EXAMPLES[k] if k != 'image' else 'image: ' + path.name}" for k in _REQUIRED),
            file=str(path),
        )
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except (TooLargeError, NotRegularFileError) as exc:
        raise MapError(f"{path} {exc.strerror}; pass the YAML file of a map", file=str(path)) from None
    except FileNotFoundError:
        close = sorted(p.name for p in path.parent.glob("*.yaml"))[:5] if path.parent.is_dir() else []
        hint = f"; the folder contains {', '.join(close)}" if close else "; check the path"
        if path.suffix == "" and path.parent == Path():
            hint += f'; for a packaged map, use navstack.map_path("{path}")'
        raise MapError(f"the map {path} does not exist{hint}", file=str(path)) from None
    except IsADirectoryError:
        inside = sorted(p.name for p in path.glob("*.yaml"))[:5]
        hint = f"; pass {path / inside[0]}" if inside else "; pass the YAML file of the map"
        raise MapError(f"{path} is a folder, not the YAML file of a map{hint}", file=str(path)) from None
    except UnicodeDecodeError as exc:
        if b"\0" in exc.object or b"image" not in exc.object:
            raise MapError(f"{path} is not a text file; pass the YAML file of the map", file=str(path)) from None
        line = exc.object.count(b"\n", 0, exc.start) + 1
        raise MapError(
            f"{path}:{line}: the byte 0x{exc.object[exc.start]:02x} is not UTF-8; save the file as UTF-8",
            file=str(path),
        ) from None
    except OSError as exc:
        raise MapError(f"cannot read the map {path}: {exc.strerror or exc}", file=str(path)) from exc
    root, findings = parse_value(text, str(path))
    wrong = next((f for f in findings if f.severity == "error"), None)
    if wrong is not None:
        reason = wrong.message.removeprefix("invalid YAML: ")
        raise error(f"invalid YAML: {reason}; compare it with a file of map_server", wrong.location.line)
    # yaml-cpp, which map_server uses, takes the first value, most other readers the last
    twice = next((f for f in findings if f.rule == "duplicated" and f.severity == "warning"), None)
    if twice is not None:
        problem = f"{twice.message.partition(', and the second')[0]}, to different values; remove one of them"
        raise error(problem, twice.location.line)
    values: Any = None if root is None else plain(root)
    if root is None or values is None:
        raise error("the file is empty; the YAML file of a map has the keys " + ", ".join(_REQUIRED))
    if not isinstance(root, DictNode):
        raise error(
            f"the YAML file of a map must be a mapping with the keys {', '.join(_REQUIRED)}, not a {type(values).__name__}",
            root.at.line,
        )
    return _Yaml(path, values, {key: at.line for key, (at, _) in root.items.items()})


def _as_float(value: Any) -> float | None:
    if isinstance(value, bool):
        return None
    if isinstance(value, (int, float, str)):
        try:
            return float(value)
        except (ValueError, OverflowError):
            return None
    return None


def _origin(document: _Yaml) -> tuple[float, float, float]:
    value = document.value("origin")
    numbers = [_as_float(v) for v in value] if isinstance(value, list) else []
    finite = [n for n in numbers if n is not None and math.isfinite(n)]
    if len(numbers) != 3 or len(finite) != 3:
        raise document.error(
            "origin",
            f'"origin" must be three numbers [x, y, yaw] (m, m, rad), not {short_repr(value)}; write for example [0.0, 0.0, 0.0]',
        )
    return finite[0], finite[1], finite[2]


def _negate(document: _Yaml) -> bool:
    value = document.value("negate")
    if isinstance(value, bool) or value in (0, 1):
        return bool(value)
    raise document.error("negate", f'"negate" must be 0 or 1, not {short_repr(value)}')


# --- image ------------------------------------------------------------------------------------------------------------


def _read_image(document: _Yaml, occupancy: _Convert) -> NDArray[np.int8]:
    """Return the occupancy of the image (ny, nx), row 0 at the bottom."""
    from PIL import Image, UnidentifiedImageError

    name = document.value("image")
    if not isinstance(name, str) or not name.strip():
        raise document.error(
            "image", f'"image" must be a file name, not {short_repr(name)}; write for example "image: map.pgm"'
        )
    path = document.path.parent / name  # an absolute name stays absolute
    too_large = document.error(
        "image", f"the image {path} is larger than the limit of {MAX_CELLS:,} cells; crop or resample it"
    )
    try:
        with open_regular(path) as opened, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about damaged metadata
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(opened, formats=_FORMATS)
            if image.width * image.height > MAX_CELLS:
                raise Image.DecompressionBombError
            if image.mode == "F":
                raise ValueError(_NO_SCALE)
            return _in_bands(image, occupancy)
    except FileNotFoundError:
        hint = "; the path is relative to the YAML file: correct it, or copy the image there"
        if (beside := document.path.parent / Path(name).name).is_file():
            hint = f'; the folder of the YAML file contains it: write "image: {beside.name}"'
        raise document.error("image", f"the image {path} does not exist{hint}") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise too_large from None
    except UnidentifiedImageError:
        raise document.error("image", f"{path} is not a readable image (pgm, png, bmp); save it again") from None
    except NotRegularFileError as exc:
        raise document.error("image", f"the image {path} {exc.strerror}; name an image file") from None
    # pillow's decoders raise many kinds of exceptions for broken files
    except Exception as exc:
        reason = getattr(exc, "strerror", None) or str(exc) or type(exc).__name__
        raise document.error("image", f"the image {path} cannot be read: {reason}; save it again") from exc


def _in_bands(image: Image, occupancy: _Convert) -> NDArray[np.int8]:
    """Convert an image band by band: all its channels at once would take ten times the memory of its cells."""
    nx, ny = image.size
    data = np.empty((ny, nx), np.int8)
    rows = max(1, _BAND // max(1, nx))
    for top in range(0, ny, rows):
        bottom = min(top + rows, ny)
        data[ny - bottom : ny - top] = occupancy(*_channels(image.crop((0, top, nx, bottom))))[::-1]
    return data


def _channels(image: Image) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the channels (ny, nx, k) to average, and the alpha channel (ny, nx) or None. Row 0 is the top."""
    if image.mode.startswith("I"):  # 16 bits or more, values 0 .. 65535
        raw = np.asarray(image)
        if raw.size and (int(raw.min()) < 0 or int(raw.max()) > 65535):
            raise ValueError(f"its pixels range from {raw.min()} to {raw.max()}, not within 0 .. 65535")
        return (raw // 257).astype(np.uint8)[:, :, None], None
    # ROS differs: for an image with a palette, SDL returns the palette indices to map_server; here the colors are used
    if image.mode in ("P", "PA", "LA", "La", "RGBa"):
        image = image.convert("RGBA" if image.mode != "P" or "transparency" in image.info else "RGB")
    elif image.mode not in ("L", "RGB", "RGBA"):
        image = image.convert("L" if image.mode == "1" else "RGB")
    pixels = np.asarray(image)
    if pixels.ndim == 2:
        return pixels[:, :, None], None
    if pixels.shape[2] == 4:
        return pixels[:, :, :3], pixels[:, :, 3]
    return pixels, None


def _occupancy(
    channels: NDArray[np.uint8],
    alpha: NDArray[np.uint8] | None,
    *,
    mode: str,
    negate: bool,
    occupied: float,
    free: float,
    span: tuple[float, float],
) -> NDArray[np.int8]:
    """Return the occupancy (ny, nx) int8, row 0 at the top, from a table over all possible sums of channels."""
    if alpha is not None and mode == "trinary":
        channels = np.concatenate((channels, alpha[:, :, None]), axis=2)
    count = channels.shape[2]
    mean = np.arange(255 * count + 1) / count
    if negate:
        mean = 255.0 - mean
    if mode == "raw":
        table = mean.astype(np.uint8).view(np.int8)
    else:
        share = (255.0 - mean) / 255.0
        table = np.full(share.shape, -1, np.int8)
        if mode == "scale":
            values = span[0] + (span[1] - span[0]) * ((share - free) / (occupied - free))
            # ROS 1 truncates, Nav2 rounds
            table[:] = np.clip(values if span[0] > 0.0 else np.rint(values), -1.0, 100.0).astype(np.int8)
        table[share < free] = 0
        table[share > occupied] = 100
    sums = channels[:, :, 0] if count == 1 else channels.sum(axis=2, dtype=np.uint16)
    data = table[sums]
    if mode == "scale" and alpha is not None:
        data[(alpha == 0) & (data != 0) & (data != 100)] = -1
    return data


def map_names() -> list[str]:
    """Return the names of the packaged maps, sorted."""
    found = (entry.name for entry in data_folder("maps").iterdir())
    return sorted(name.removesuffix(_PLACES) for name in found if name.endswith(_PLACES))


def map_path(name: str) -> Path:
    """Return the YAML file of a packaged map. Raises MapError with the known names."""
    return packaged_map_file(name, ".yaml")


def packaged_map_file(name: str, ending: str) -> Path:
    """Return a file of a packaged map: `.yaml`, `.png` or `.places.yaml`. Raises MapError with the known names."""
    known = map_names()
    if name not in known:
        raise MapError(f'unknown packaged map "{name}"; choose one of {", ".join(known)}', map=name, known=known)
    return data_folder("maps") / f"{name}{ending}"
