"""Writes an ament_python package with the nodes, their launch files, and the parameters and the map of the user."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import yaml

from navstack import __version__
from navstack.core import InputError, is_file, resolved
from navstack.ros_node import write_packages

PACKAGE: Final = "navstack_ros2"
MARKER: Final = "written by navstack ros2 install"
"""A package.xml with these words may be replaced."""
NODES: Final = ("navigator", "sim")
"""Executables of the package, and commands of `navstack ros2`."""
_DEPENDS: Final = (
    *("rclpy", "launch_ros", "lifecycle_msgs", "nav2_msgs", "nav_msgs", "geometry_msgs", "map_msgs", "sensor_msgs"),
    *("std_msgs", "tf2_msgs", "visualization_msgs", "diagnostic_msgs", "bond"),
)


def _package_xml() -> str:
    lines = "".join(f"  <exec_depend>{package}</exec_depend>\n" for package in _DEPENDS)
    return (
        '<?xml version="1.0"?>\n'
        f"<!-- {MARKER} {__version__} -->\n"
        '<package format="3">\n'
        f"  <name>{PACKAGE}</name>\n"
        f"  <version>{__version__}</version>\n"
        "  <description>navstack's nodes: the navigator in place of Nav2's servers, and the simulated robot</description>\n"
        '  <maintainer email="navstack@example.org">navstack</maintainer>\n'
        "  <license>BSD-3-Clause</license>\n"
        f"{lines}"
        "  <export>\n    <build_type>ament_python</build_type>\n  </export>\n"
        "</package>\n"
    )


def _setup(folders: list[str]) -> str:
    nodes = ", ".join(f'"{name} = {PACKAGE}.nodes:{name}"' for name in NODES)
    return (
        f"# {MARKER}\n"
        "from glob import glob\n\n"
        "from setuptools import setup\n\n"
        "setup(\n"
        f'    name="{PACKAGE}",\n'
        f'    version="{__version__}",\n'
        f'    packages=["{PACKAGE}"],\n'
        "    data_files=[\n"
        f'        ("share/ament_index/resource_index/packages", ["resource/{PACKAGE}"]),\n'
        f'        ("share/{PACKAGE}", ["package.xml"]),\n'
        f'        *((f"share/{PACKAGE}/{{folder}}", glob(f"{{folder}}/*")) for folder in {folders!r}),\n'
        "    ],\n"
        f'    entry_points={{"console_scripts": [{nodes}]}},\n'
        ")\n"
    )


def _nodes() -> str:
    """Return the module of the executables: they run the Python that has navstack, perhaps not that of colcon."""
    functions = "".join(f'\n\ndef {name}() -> None:\n    _run("{name}")\n' for name in NODES)
    return (
        f'"""Nodes of navstack; {MARKER}."""\n\n'
        "import os\nimport sys\n\n"
        f"PYTHON = {sys.executable!r}\n\n\n"
        "def _run(command: str) -> None:\n"
        '    os.execv(PYTHON, [PYTHON, "-m", "navstack", "ros2", command, *sys.argv[1:]])\n'
        f"{functions}"
    )


def package_files(params: list[str], map_: str) -> dict[str, bytes]:
    """Return the files of the package by their paths.

    `params` are names of packaged sets or YAML files, `map_` the name of a packaged map or a YAML file: files are copied
    into the package. Raises InputError for a file that is not there.
    """
    files: dict[str, bytes] = {}
    chosen: list[str] = []
    for number, source in enumerate(params):
        path = Path(source)
        if path.is_dir():
            raise InputError(f"{source} is a folder; give its files, each with --params", argument="--params")
        if path.suffix not in (".yaml", ".yml"):
            chosen.append(source)
            continue
        name = f"config/{path.name}"
        if name in files:
            name = f"config/{number}_{path.name}"
        files[name] = _read(path, "--params")
        chosen.append(name)
    world = map_
    if Path(map_).suffix in (".yaml", ".yml"):
        world = f"maps/{Path(map_).name}"
        files |= _map_files(Path(map_))
    root = Path(__file__).parent / "package"
    for file in sorted(root.glob("*/*")):
        name = str(file.relative_to(root)).removesuffix(".in")
        text = file.read_text(encoding="utf-8")
        text = text.replace("@PARAMS@", _default(chosen, name)).replace("@MAP@", _default([world], name))
        files[name] = text.encode()
    folders = sorted({name.partition("/")[0] for name in files})
    files |= {
        "package.xml": _package_xml().encode(),
        "setup.py": _setup(folders).encode(),
        "setup.cfg": f"[develop]\nscript_dir=$base/lib/{PACKAGE}\n[install]\ninstall_scripts=$base/lib/{PACKAGE}\n".encode(),
        f"resource/{PACKAGE}": b"",
        f"{PACKAGE}/__init__.py": b"",
        f"{PACKAGE}/nodes.py": _nodes().encode(),
    }
    return files


def _default(names: list[str], file: str) -> str:
    """Return parameters or a map as the text of a launch file; files of the package by its share folder."""
    if file.endswith(".xml"):
        return " --params ".join(f"$(find-pkg-share {PACKAGE})/{n}" if "/" in n else n for n in names)
    return " --params ".join(f"{{SHARE}}/{n}" if "/" in n else n for n in names)


def _map_files(path: Path) -> dict[str, bytes]:
    """Return a map's YAML file, which names its image beside it, and the image."""
    text = _read(path, "--map").decode(errors="replace")
    try:
        content = yaml.safe_load(text)
        image = path.parent / str(content["image"])
    except (yaml.YAMLError, TypeError, KeyError):
        raise InputError(
            f'{path} is no map: it has no "image"; give the YAML file of a map', argument="--map"
        ) from None
    described = yaml.safe_dump({**content, "image": image.name}, sort_keys=False)
    return {f"maps/{path.name}": described.encode(), f"maps/{image.name}": _read(image, "--map")}


def _read(path: Path, argument: str) -> bytes:
    if not is_file(path):
        raise InputError(f"{argument}: there is no file {path}; check the path", argument=argument, path=str(path))
    try:
        return path.read_bytes()
    except OSError as exc:
        raise InputError(f"{argument}: {path} cannot be read: {exc.strerror}", argument=argument) from exc


def install(folder: Path, params: list[str], map_: str, *, force: bool) -> Path:
    """Write the package below `folder`, and return its folder; see `write_packages`."""
    (written,) = write_packages(resolved(folder), {PACKAGE: package_files(params, map_)}, MARKER, force=force)
    return written
