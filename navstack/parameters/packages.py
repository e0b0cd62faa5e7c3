"""Find the folder of a ROS package near a file: `$(find package)` without ROS.

A folder is a package by the name in its `package.xml` (`manifest.xml`: by its own name). Without such a file in it or above
it, a folder is the package that it is called like. Files that were exported to one folder are named `package__path__of__the
file`; there the folder is the package, perhaps without the first folders of a path. Another folder never stands for a package:
a file of the same name in it belongs to another package.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from navstack.core import is_dir, is_file, read_bytes, resolved

FOLDERS_UP = 6
"""Most folders above a file that are searched."""
_BARE_UP = 4
"""Those without any manifest."""
DEPTH = 3
"""How deep packages are in a workspace: repository, metapackage, package."""
MAX_FOLDERS = 2_000
"""Most folders that a search reads."""
_OF_REPOSITORY = (".git", ".gitignore", ".github", ".travis.yml", "README.md", "README.rst", "LICENSE")
_OF_WORKSPACE = (".catkin_workspace", ".catkin_tools", ".rosinstall")
_LEFT_OUT = frozenset({"build", "devel", "install", "node_modules", "__pycache__"})
_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_REFERENCE = re.compile(rb"\$\(\s*find\s+([^()\s]+)\s*\)[^\"']*\.(?:ya?ml|launch|xml)")
_MAX_MANIFEST = 1_000_000


def package_file(package: str, parts: list[str], near: Path) -> Path | None:
    """Return the file with these parts of its path in a package that is near a file; None without package or file."""
    exported = "__" in near.name
    for folder in _packages(package, near):
        path = folder.joinpath(*parts)
        if is_file(path):
            return path
        if exported and (found := _in_export(folder, package, parts)) is not None:
            return found
    return None


def why_missing(package: str, parts: list[str], near: Path) -> tuple[str, str]:
    """Say why `package_file` finds nothing, the package or the file is absent, and how to correct that."""
    several = _by_manifest(package, near)
    if len(several) > 1:
        places = " and ".join(str(folder) for folder in several[:2])
        return f"the package {package} exists twice: {places}", "remove one of them"
    folders = list(_packages(package, near))
    if folders:
        path = "/".join(parts)
        return (
            f"the package {package} (the folder {folders[-1].name}) has no {path}",
            "add the file or correct the path",
        )
    return f"the package {package} is not here", (
        "put it next to the package of the launch file, with its package.xml or in a folder that is called like it"
    )


def workspace(near: Path) -> Iterator[Path]:
    """Yield the folders with a manifest near a file: those of the nearest folder above it first.

    None for a file outside of packages, repositories and workspaces: the packages next to it are those of anybody.
    """
    seen: set[Path] = set()
    folders = _above(near)
    if not any(_name_of(f) is not None or _has(f, *_OF_WORKSPACE, *_OF_REPOSITORY) for f in folders):
        return
    for above in folders:
        for folder in _below(above):
            if folder not in seen:
                seen.add(folder)
                yield folder


def _packages(package: str, near: Path) -> Iterator[Path]:
    """The folder that is the package, or the places of an exported one."""
    found = _by_manifest(package, near)
    if found:
        if len(found) == 1:
            yield found[0]
        return
    above = _above(near)
    for folder in above:
        for place in (folder, folder / package):
            if place.name == package and is_dir(place) and not _is_inside_package(place):
                yield place
                if "__" not in near.name:
                    return
    if "__" in near.name and _is_export_of(package, near):
        yield from above[:2]


def _by_manifest(package: str, near: Path) -> list[Path]:
    """The folders whose manifest has the name of the package, below the nearest folder above the file that has one."""
    above = _above(near)
    for folder in above:
        for place in (folder, folder / package):
            if _name_of(place) == package:
                return [place]
    for folder in above if any(_name_of(folder) is not None for folder in above) else ():
        found = [place for place in _below(folder) if _name_of(place) == package]
        if found:
            return found
    return []


def _above(near: Path) -> list[Path]:
    """The folders above a file in which packages are searched, the nearest first.

    They end with the neighbors of its package, with its repository (README, .git ..) or with the `src` of its workspace: other
    robots that happen to be stored near by do not count.
    """
    home = Path.home()
    folders = [f for f in list(resolved(near).parents)[:FOLDERS_UP] if f.parent != f and f != home]
    own = next((number for number, folder in enumerate(folders) if _name_of(folder) is not None), None)
    if own is None:
        return folders[:_BARE_UP]
    last = own + 1
    for number in range(own + 1, len(folders)):
        folder = folders[number]
        if folder.name == "src" or _has(folder, *_OF_WORKSPACE):
            last = number
            break
        if _has(folder, *_OF_REPOSITORY):
            last = number
    return folders[: last + 1]


def _has(folder: Path, *names: str) -> bool:
    return any(folder.joinpath(name).exists() for name in names)


def _below(folder: Path) -> Iterator[Path]:
    """The folders with a manifest in a folder, at most DEPTH deep; packages are not nested."""
    level, read = [folder], 0
    for _ in range(DEPTH + 1):
        below: list[Path] = []
        for place in level:
            read += 1
            if read > MAX_FOLDERS:
                return
            if _name_of(place) is not None:
                yield place
            else:
                below += _folders_in(place)
        level = below


def _folders_in(folder: Path) -> list[Path]:
    try:
        inside = sorted(p for p in folder.iterdir() if not p.name.startswith(".") and p.name not in _LEFT_OUT)
        return [p for p in inside if p.is_dir() and not p.is_symlink()]
    except OSError:
        return []


def _name_of(folder: Path) -> str | None:
    """The name of the package whose manifest is in a folder."""
    manifest = folder / "package.xml"
    try:
        if is_file(manifest):
            found = _NAME.search(_COMMENT.sub(b"", read_bytes(manifest, _MAX_MANIFEST)))
            return found[1].decode("utf-8", "replace") if found else None
        return folder.name if is_file(folder / "manifest.xml") else None
    except OSError:
        return None


def _is_inside_package(folder: Path) -> bool:
    """True for a folder of a package, which is no package by its name."""
    return any(_name_of(place) is not None for place in (folder, *list(folder.parents)[:FOLDERS_UP]))


# --- exports: package__launch__move_base.launch -----------------------------------------------------------------------


def _is_export_of(package: str, near: Path) -> bool:
    """True if an exported file is of the package: by its name, or because it refers to no other one."""
    first = near.name.partition("__")[0]
    if first == package:
        return True
    if first not in ("launch", "config", "param", "params"):
        return False  # the name of another package
    try:
        return {name.decode("utf-8", "replace") for name in _REFERENCE.findall(read_bytes(near, _MAX_MANIFEST))} == {
            package
        }
    except OSError:
        return False


def _in_export(folder: Path, package: str, parts: list[str]) -> Path | None:
    """A file of an exported package: under its whole path in one name, or without the first folders of its path."""
    whole = folder / "__".join([package, *parts])
    if is_file(whole):
        return whole
    for skipped in range(1, len(parts)):
        if folder.joinpath(parts[skipped - 1]).is_dir():
            return None  # the export has this folder, so it left none out
        path = folder.joinpath(*parts[skipped:])
        if is_file(path):
            return path
    return None
