"""Substitutions of launch files: `$(arg ..)`, `$(find ..)`, `$(env ..)`; nothing is executed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from navstack.core.files import is_file, resolved
from navstack.parameters.tree import parts_of

FOLDERS_UP = 5
MAX_EXPANDED = 1_000_000
"""Longest text with its substitutions (characters): arguments that repeat each other grow without end."""
_SUBSTITUTION = re.compile(r"\$\(\s*([a-z]+)((?:\s+[^()]*)?)\)")
_ARGUMENT = re.compile(r"([A-Za-z_][A-Za-z0-9_/]*):=(.*)\Z", re.DOTALL)


def launch_argument(text: str) -> tuple[str, str] | None:
    """Split an argument of roslaunch's command line: `model:=burger` -> ("model", "burger"); None for other texts."""
    found = _ARGUMENT.match(text)
    return (found[1], found[2]) if found else None


def is_expression(text: str) -> bool:
    """Return True for `$(eval ..)`: a Python expression, which may contain parentheses."""
    return re.match(r"\s*\$\(\s*eval\b", text) is not None


def substitute(text: str, arguments: Mapping[str, str], folder: Path) -> str:
    """Replace the substitutions of a text except `$(find ..)`; raise ValueError for one that cannot be replaced.

    `folder` is that of the launch file. A text that grows beyond a million characters is a ValueError as well.
    """
    if is_expression(text):
        raise ValueError(f"{text.strip()} is a Python expression, which is not evaluated; write its value")

    length = len(text)

    def bounded(found: re.Match[str]) -> str:
        nonlocal length
        filled = value(found)
        length += len(filled) - len(found[0])
        if length > MAX_EXPANDED:
            raise ValueError(
                f"a text is longer than {MAX_EXPANDED:,} characters after its substitutions ({found[0]} is one of them); "
                "shorten the arguments that it uses"
            )
        return filled

    def value(found: re.Match[str]) -> str:
        command, rest = found[1], found[2].split()
        match command, rest:
            case "arg", [name]:
                if name in arguments:
                    return arguments[name]
                raise ValueError(f"the argument {name} has no value; add {name}:=VALUE after the launch file")
            case "find", [_]:
                return found[0]
            case "env", [name]:
                if name in os.environ:
                    return os.environ[name]
                raise ValueError(f"the environment variable {name} is not set; set it or write the value")
            case "optenv", [name, *default]:
                return os.environ.get(name, " ".join(default))
            case "anon", [name]:
                return name
            case "dirname", []:
                return str(folder)
            case _:
                raise ValueError(f"{found[0]} is not supported; write its value")

    return _SUBSTITUTION.sub(bounded, text)


def find_file(text: str, launch: Path) -> Path | None:
    """Return the file that a path of a launch file names; `$(find package)` is searched in the folders above the file."""
    found = _SUBSTITUTION.match(text)
    if found is None or found[1] != "find":
        path = Path(text)
        path = path if path.is_absolute() else launch.parent / path
        return path if is_file(path) else None
    package = found[2].strip()
    rest = parts_of(text[found.end() :])
    return next((path for path in _candidates(launch, package, rest) if is_file(path)), None)


def _candidates(launch: Path, package: str, rest: list[str]) -> Iterator[Path]:
    """Places of `$(find package)/rest`: the layout of a workspace first, then paths with folders left out."""
    folders = [resolved(launch).parent, *resolved(launch).parent.parents][:FOLDERS_UP]
    for folder in folders:
        yield folder.joinpath(package, *rest)
        yield folder.joinpath(*rest)
    # exported to one folder: package__launch__include__move_base.launch
    yield folders[0] / "__".join([package, *rest])
    for skipped in range(1, len(rest)):
        for folder in folders[: FOLDERS_UP - 2]:
            yield folder.joinpath(package, *rest[skipped:])
            yield folder.joinpath(*rest[skipped:])


def param_value(text: str, kind: str) -> Any:
    """Convert the value of a `<param>` to its type as roslaunch does; raise ValueError."""
    match kind:
        case "str" | "string" | "yaml":
            return text
        case "int":
            return int(text)
        case "double":
            return float(text)
        case "bool" | "boolean":
            if text.strip().lower() in ("true", "1"):
                return True
            if text.strip().lower() in ("false", "0"):
                return False
            raise ValueError(text)
        case "auto":
            for convert in (int, float):
                try:
                    return convert(text)
                except ValueError:
                    continue
            lowered = text.strip().lower()
            return lowered == "true" if lowered in ("true", "false") else text
        case _:
            raise ValueError(text)
