"""The rule of `--out` in all commands: a name with a suffix is a file, otherwise a folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

# a letter first: `runs/speed_0.5` and `results.v2.1` are folders
_SUFFIX: Final = re.compile(r"\.[A-Za-z][A-Za-z0-9]*\Z")


def names_a_file(out: Path) -> bool:
    """True for a name with a suffix that is not an existing folder."""
    from navstack.core.files import is_dir

    return _SUFFIX.match(out.suffix) is not None and not is_dir(out)


def file_in(default: str) -> Callable[[Path | None], Path | None]:
    """Checks and completes `--out` of a command that writes one file: in a folder, the file is called `default`."""

    def complete(out: Path | None) -> Path | None:
        if out is None or names_a_file(out):
            return out
        return out / default

    return complete


def folder_only(out: Path | None) -> Path | None:
    """Checks `--out` of a command that writes several files. Raises OutputError for the name of a file."""
    from navstack.core.errors import OutputError

    if out is not None and names_a_file(out):
        raise OutputError(
            f"--out {out} names a file, but the command writes several files; name a folder, without a suffix: "
            f"{out.with_suffix('')}",
            path=str(out),
        )
    return out


def chosen_files(out: Path, products: Mapping[str, str]) -> dict[str, Path]:
    """The files that `--out` asks for, of a command with several products (what -> default file name).

    In a folder: all of them. A name with a suffix asks for the product of that kind only. Raises OutputError for a suffix
    that no product has.
    """
    from navstack.core.errors import OutputError
    from navstack.core.files import ensure_directory

    if not names_a_file(out):
        folder = ensure_directory(out)
        return {what: folder / name for what, name in products.items()}
    formats = {what: _formats(name) for what, name in products.items()}
    for what, suffixes in formats.items():
        if out.suffix.lower() in suffixes:
            ensure_directory(out.parent)
            return {what: out}
    known = "; ".join(f"{', '.join(suffixes)} for the {what}" for what, suffixes in formats.items())
    raise OutputError(
        f"cannot write {out.name}: the suffix must be {known}; a name without a suffix is a folder for all of them",
        path=str(out),
    )


def _formats(name: str) -> tuple[str, ...]:
    from navstack.plot.canvas import FORMATS

    suffix = Path(name).suffix
    return FORMATS if suffix in FORMATS else (suffix,)
