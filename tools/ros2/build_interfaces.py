"""Generates and compiles ROS 2 interfaces with the generators of rosidl and gcc: `build_interfaces.py DISTRO DEFINITIONS OUT`.

Run by the Python of an environment of `tools/ros2_environment.py`; no ROS installation, ament or cmake is needed. OUT
gets `lib/` and `lib/python3.x/site-packages/`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy

PACKAGES = ("bond", "tf2_msgs", "geographic_msgs", "map_msgs", "nav2_msgs")
"""In the order of their dependencies."""
TOGETHER = 12
"""Generated sources that are compiled as one."""
PREFIX = Path(sys.prefix)
SITE = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
GENERATE = {
    "rosidl_generator_c": "from rosidl_generator_c import generate_c; generate_c({!r})",
    "rosidl_typesupport_fastrtps_c": (
        "from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c as g; g({!r})"
    ),
    "rosidl_typesupport_introspection_c": "from rosidl_typesupport_introspection_c import generate_c; generate_c({!r})",
    "rosidl_typesupport_c": (
        "from rosidl_typesupport_c import generate_c; generate_c({!r}, "
        "['rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c'])"
    ),
    "rosidl_generator_py": (
        "from rosidl_generator_py.generate_py_impl import generate_py; generate_py({!r}, ['rosidl_typesupport_c'])"
    ),
}
"""Code that runs each generator on a file of arguments."""
SOURCES = {
    "rosidl_generator_c": ("detail/*__functions.c", "detail/*__type_support.c", "detail/*__description.c"),
    "rosidl_typesupport_fastrtps_c": ("detail/*__type_support_c.cpp",),
    "rosidl_typesupport_introspection_c": ("detail/*__type_support.c",),
    "rosidl_typesupport_c": ("*__type_support.cpp",),
}
"""What each generator writes into `msg/`, `srv/` and `action/`, that is compiled."""


def read_definitions(file: Path, distro: str) -> dict[str, dict[str, str]]:
    """Return the text of each interface by package and path (`action/Spin.action`).

    A section begins with `== PACKAGE/KIND/NAME`, or with `== PACKAGE/KIND/NAME DISTRO` for one that differs.
    """
    found: dict[str, dict[str, str]] = {}
    for part in file.read_text().split("== ")[1:]:
        title, _, body = part.partition("\n")
        name, _, of = title.partition(" ")
        if of in ("", distro):
            package, kind, short = name.split("/")
            found.setdefault(package, {})[f"{kind}/{short}.{kind}"] = body
    return found


class Build:
    """Builds packages into one folder."""

    def __init__(self, work: Path, out: Path) -> None:
        self.work, self.out = work, out
        self.libraries = out / "lib"
        self.site = out / SITE
        self.site.mkdir(parents=True)
        self.described = {folder.name: folder for folder in (PREFIX / "share").iterdir() if folder.is_dir()}
        includes = [PREFIX / "include", *(folder for folder in (PREFIX / "include").iterdir() if folder.is_dir())]
        includes += [Path(sysconfig.get_paths()["include"]), Path(numpy.get_include())]
        self.includes = [f"-I{folder}" for folder in includes]

    def packages(self, texts: dict[str, dict[str, str]]) -> None:
        """Generate all packages, with a process for each generator, and compile them in the order of their dependencies."""
        arguments: dict[str, list[str]] = {generator: [] for generator in GENERATE}
        for name in PACKAGES:
            for generator, file in self._described(name, texts[name]).items():
                arguments[generator].append(file)
        running = []
        for generator, code in GENERATE.items():
            lines = "\n".join(code.format(file) for file in arguments[generator])
            running.append((generator, subprocess.Popen([sys.executable, "-c", lines])))
        for generator, process in running:
            if process.wait() != 0:
                raise SystemExit(f"{generator} failed")
        for name in PACKAGES:
            self.includes += [f"-I{self.work / 'c' / name}", f"-I{self.work / 'introspection' / name}"]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            compiled = {name: self._compile(name, pool) for name in PACKAGES}
            for name, objects in compiled.items():
                self._link_package(name, objects)

    def _described(self, name: str, texts: dict[str, str]) -> dict[str, str]:
        """Write the definitions, hashes and folders of a package; return a file of arguments for each generator."""
        from rosidl_adapter import convert_to_idl
        from rosidl_generator_type_description import generate_type_hash

        source, idl, described = (self.work / part / name for part in ("src", "idl", "description"))
        for path, text in texts.items():
            file = source / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
            (idl / file.parent.name).mkdir(parents=True, exist_ok=True)
            convert_to_idl(source, name, Path(path), idl)
        stems = [path.rpartition(".")[0] for path in texts]
        common = {
            "package_name": name,
            "idl_tuples": [f"{idl}:{stem}.idl" for stem in stems],
            "ros_interface_dependencies": [],
            "target_dependencies": [],
        }
        paths = [f"{package}:{folder}" for package, folder in self.described.items()]
        generate_type_hash(
            self._arguments(name, "hash", {**common, "output_dir": str(described), "include_paths": paths})
        )
        self.described[name] = described
        tuples = [f"{stem}.idl:{described / stem}.json" for stem in stems]
        headers = self.work / "c" / name
        python = self.site / name
        for folder in {stem.split("/")[0] for stem in stems} | {"msg"}:
            (python / folder).mkdir(parents=True, exist_ok=True)
            (headers / name / folder).mkdir(parents=True, exist_ok=True)
        (python / "__init__.py").touch()
        found: dict[str, str] = {}
        for generator in GENERATE:
            target = python if generator == "rosidl_generator_py" else headers / name
            if generator == "rosidl_typesupport_introspection_c":
                # its sources have the names of those of rosidl_generator_c
                target = self.work / "introspection" / name / name
            arguments = {
                **common,
                "output_dir": str(target),
                "template_dir": str(PREFIX / "share" / generator / "resource"),
                "type_description_tuples": tuples,
            }
            found[generator] = self._arguments(name, generator, arguments)
            self._visibility(generator, name, headers / name / "msg")
        return found

    def _arguments(self, name: str, step: str, values: Mapping[str, object]) -> str:
        file = self.work / f"{name}_{step}.json"
        file.write_text(json.dumps(values))
        return str(file)

    def _visibility(self, generator: str, name: str, folder: Path) -> None:
        """Write the header that declares what is exported; ament does that by configure_file."""
        template = PREFIX / "share" / generator / "resource" / f"{generator}__visibility_control.h.in"
        if template.is_file():
            text = template.read_text().replace("@PROJECT_NAME_UPPER@", name.upper()).replace("@PROJECT_NAME@", name)
            (folder / template.name.removesuffix(".in")).write_text(text)

    def _compile(self, name: str, pool: ThreadPoolExecutor) -> dict[str, list[Future[Path]]]:
        """Begin to compile a package; return the objects of each library."""
        python = self.site / name
        groups: dict[str, list[Path]] = {}
        for generator, patterns in SOURCES.items():
            folder = self.work / "c" / name / name
            if generator == "rosidl_typesupport_introspection_c":
                folder = self.work / "introspection" / name / name
            groups[generator] = [
                file
                for pattern in patterns
                for file in self._together(f"{name}_{generator}", sorted(folder.glob(f"*/{pattern}")))
            ]
        groups["rosidl_generator_py"] = self._together(f"{name}_py", sorted(python.glob("*/_*_s.c")))
        groups["entry"] = [python / f"_{name}_s.ep.rosidl_typesupport_c.c"]
        return {key: [pool.submit(self._object, file) for file in files] for key, files in groups.items()}

    def _together(self, name: str, files: list[Path]) -> list[Path]:
        """Return files that include the given ones: most of the time of gcc goes into the headers that these share.

        Descriptions stay apart: their names clash.
        """
        if not files or files[0].name.endswith("__description.c"):
            return files
        suffix = files[0].suffix
        found = []
        for number in range(0, len(files), TOGETHER):
            unit = self.work / f"{name}_{files[0].stem}_{number}{suffix}"
            unit.write_text("".join(f'#include "{file}"\n' for file in files[number : number + TOGETHER]))
            found.append(unit)
        return found

    def _link_package(self, name: str, objects: dict[str, list[Future[Path]]]) -> None:
        python = self.site / name
        for key, found in objects.items():
            target = self.libraries / f"lib{name}__{key}.so"
            if key == "entry":
                target = python / f"{name}_s__rosidl_typesupport_c.so"
            self._link([future.result() for future in found], target)
        for file in (*python.glob("*.c"), *python.glob("*/*.c")):
            file.unlink()

    def _object(self, file: Path) -> Path:
        target = self.work / "objects" / (str(file).strip("/").replace("/", "_") + ".o")
        target.parent.mkdir(exist_ok=True)
        compiler = ["g++", "-std=c++17"] if file.suffix == ".cpp" else ["gcc", "-std=gnu11"]
        subprocess.run(
            [*compiler, "-O0", "-fPIC", "-w", "-c", str(file), "-o", str(target), *self.includes], check=True
        )
        return target

    def _link(self, objects: list[Path], target: Path) -> None:
        libraries = [f"-L{folder}" for folder in (self.libraries, PREFIX / "lib")]
        names = [
            file.name[3:-3] for folder in (self.libraries, PREFIX / "lib") for file in sorted(folder.glob("lib*.so"))
        ]
        names = [name for name in names if "_cpp" not in name or name == "rosidl_typesupport_fastrtps_cpp"]
        names = [name for name in names if f"lib{name}.so" != target.name]
        subprocess.run(
            [
                "g++",
                "-shared",
                "-o",
                str(target),
                *map(str, objects),
                *libraries,
                "-Wl,--as-needed",
                *(f"-l{n}" for n in names),
            ],
            check=True,
        )


def main() -> None:
    """Build all packages."""
    distro, definitions, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    texts = read_definitions(definitions, distro)
    with tempfile.TemporaryDirectory() as folder:
        build = Build(Path(folder), out)
        build.packages(texts)


if __name__ == "__main__":
    main()
