"""The package as users install it: wheel, sdist and editable install in fresh environments; no network is needed.

The dependencies come from the environment of the tests, the build backend too (extra `test`); an environment without it gets it
from the package index.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
DATA = ("params/turtlebot/navstack.yaml", "maps/office.yaml", "maps/office.png", "maps/office.places.yaml")


def run(*command: str | Path, cwd: Path, python_path: str = "") -> subprocess.CompletedProcess[str]:
    """Run a command outside of the repository; PYTHONPATH is only what is given."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    if python_path:
        env["PYTHONPATH"] = python_path
    return subprocess.run([str(c) for c in command], cwd=cwd, env=env, capture_output=True, text=True, timeout=300)


def succeed(*command: str | Path, cwd: Path, python_path: str = "") -> str:
    done = run(*command, cwd=cwd, python_path=python_path)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def backend(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The folder of the build backend for PYTHONPATH; empty if the environment has it."""
    if importlib.util.find_spec("hatchling") and importlib.util.find_spec("editables"):
        return ""
    folder = tmp_path_factory.mktemp("backend")
    succeed(sys.executable, "-m", "pip", "install", "-q", "--target", folder, "hatchling", "editables", cwd=folder)
    return str(folder)


def build(source: Path, out: Path, backend: str, *targets: str) -> list[Path]:
    """Build `targets` (wheel, sdist) of a source folder into `out`."""
    flags = [flag for target in targets for flag in ("-t", target)]
    succeed(sys.executable, "-m", "hatchling", "build", "-d", out, *flags, cwd=source, python_path=backend)
    return sorted(out.iterdir())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, backend: str) -> Path:
    (path,) = build(ROOT, tmp_path_factory.mktemp("wheel"), backend, "wheel")
    return path


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory, backend: str) -> Path:
    """The folder that a user of the sdist has after unpacking it."""
    folder = tmp_path_factory.mktemp("sdist")
    (path,) = build(ROOT, folder / "dist", backend, "sdist")
    with tarfile.open(path) as archive:
        archive.extractall(folder, filter="data")
    return folder / path.name.removesuffix(".tar.gz")


def install(folder: Path, backend: str, *what: str | Path) -> Path:
    """A fresh environment with navstack and the dependencies of this one; returns its Python."""
    succeed(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    packages = Path(succeed(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip())
    own = dict.fromkeys([sysconfig.get_path("purelib"), sysconfig.get_path("platlib")])
    packages.joinpath("dependencies.pth").write_text("\n".join(own) + "\n")
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index")
    succeed(*pip, "--no-build-isolation", *what, cwd=folder, python_path=backend)
    return python


def test_the_wheel_works_from_another_folder(tmp_path: Path, wheel: Path, backend: str) -> None:
    python = install(tmp_path / "venv", backend, wheel)
    code = "import navstack; from navstack.core.data_files import data_folder as f; print(navstack.__file__, f('maps'))"
    for file in succeed(python, "-c", code, cwd=tmp_path).split():
        assert Path(file).is_relative_to(tmp_path / "venv")
    command = python.with_name("navstack")
    out = succeed(command, "info", cwd=tmp_path)
    assert "turtlebot" in out and "office" in out and "navfn" in out
    assert "0 errors, 0 warnings" in succeed(command, "check", "turtlebot", cwd=tmp_path)
    assert "navfn" in succeed(command, "plan", "office", "--start", "0.8,7.45", "--goal", "2,7.45", cwd=tmp_path)


def contents(archive: Path) -> dict[str, str]:
    with zipfile.ZipFile(archive) as files:
        return {name: hashlib.sha256(files.read(name)).hexdigest() for name in files.namelist()}


def test_the_sdist_builds_the_same_wheel(tmp_path: Path, wheel: Path, unpacked: Path, backend: str) -> None:
    (rebuilt,) = build(unpacked, tmp_path, backend, "wheel")
    assert contents(rebuilt) == contents(wheel)
    assert {f"navstack/{name}" for name in DATA} <= contents(wheel).keys()
    assert not [name for name in contents(wheel) if name.startswith(("params/", "maps/", "tests/", "tools/"))]


def test_an_editable_install_uses_the_data_at_the_top(tmp_path: Path, unpacked: Path, backend: str) -> None:
    python = install(tmp_path / "venv", backend, "-e", unpacked)
    code = (
        "import navstack; from navstack.core.data_files import data_folder as f; "
        "print(navstack.__file__, f('params'), f('maps'))"
    )
    assert succeed(python, "-c", code, cwd=tmp_path).split() == [
        str(unpacked / "navstack" / "__init__.py"),
        str(unpacked / "params"),
        str(unpacked / "maps"),
    ]
    assert "0 errors" in succeed(python.with_name("navstack"), "check", "turtlebot", cwd=tmp_path)
    assert not list((tmp_path / "venv").glob("lib/*/site-packages/navstack"))


@pytest.mark.parametrize(
    "arguments", [("check", "turtlebot"), ("info",), ("plan", "office", "--start", "1,1", "--goal", "2,2")]
)
def test_an_import_from_a_zip_archive_is_refused(tmp_path: Path, wheel: Path, arguments: tuple[str, ...]) -> None:
    done = run(sys.executable, "-m", "navstack", *arguments, cwd=tmp_path, python_path=str(wheel))
    assert done.returncode == 2
    assert "install navstack with pip (it cannot run from a zip archive)" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_checkout_uses_the_data_at_the_top() -> None:
    from navstack.core import data_folder

    for name in DATA:
        kind = "params" if name.startswith("params") else "maps"
        assert (data_folder(kind).parent / name).is_file()
    assert data_folder("params") == ROOT / "params"
