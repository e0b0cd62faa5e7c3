"""`navstack compile`: compile kernels before they are needed, as for an image or in CI."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.output import compile_kernels, stdout
from navstack.core import InputError, cache_folder, import_all_kernels, recorded_specializations


def compile_(
    names: Annotated[
        list[str], typer.Argument(metavar="[NAME]..", help="Planners, controllers and smoothers: only their kernels.")
    ] = [],
    all_: Annotated[bool, typer.Option("--all", help="Compile all kernels, as without names.")] = False,
) -> int:
    """Compile the kernels of all commands, or of some plugins, into the cache.

    Every command compiles what it needs at its first use; this does it ahead, on all cores.

    Exit codes: 0 compiled, 2 invalid input.
    """
    if names and all_:
        raise InputError("--all and names exclude each other")
    folder = cache_folder()
    if folder is None:
        raise InputError("no cache folder: set XDG_CACHE_HOME to a folder that can be written")
    import_all_kernels()
    known = {use for each in recorded_specializations() for use in each.uses}
    for name in names:
        if name not in known:
            raise InputError(f'no kernels are recorded for "{name}"; known are: {", ".join(sorted(known))}')
    count = compile_kernels(names or None, required=True)
    stdout().print(
        f"{count} specializations compiled; the cache is {folder}" if count else f"the cache is complete: {folder}"
    )
    return 0
