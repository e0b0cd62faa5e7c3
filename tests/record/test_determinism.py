"""The same run gives the same file byte for byte: twice, in another process, with another hash seed."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from navstack.core import OutputError, Pose2D
from navstack.record import buffers as scans
from navstack.record import columns
from tests.record import synthetic

ROOT = Path(__file__).resolve().parents[2]
CODE = (
    "import sys; from pathlib import Path; from tests.record import synthetic; "
    "synthetic.record_run(8.0).save(Path(sys.argv[1]))"
)


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    synthetic.record_run(8.0).save(folder)
    return folder


def test_on_disk(tmp_path, monkeypatch):
    """A record that grows on disk is the same file; nothing else is left behind, and it can be read in between."""
    monkeypatch.setattr(columns, "BLOCK_BYTES", 500)
    monkeypatch.setattr(scans, "WAITING_RANGES", 200)
    for name, folder in (("memory", None), ("disk", tmp_path)):
        recorder = synthetic.record_run(8.0, scans=True, spool=folder)
        again = recorder.record()
        recorder.local_plan(8.0, synthetic.local_plan(np.random.default_rng(3), Pose2D(0.0, 0.0), 7, ("goal", "new")))
        recorder.save(tmp_path / name)
        assert again.local_plan(3).plan.costs is not None and len(again.scans) == 8
    assert digests(tmp_path / "disk") == digests(tmp_path / "memory")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "memory"]


def test_a_full_disk_is_an_error_while_it_records(tmp_path, monkeypatch):
    def full(**options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(columns.tempfile, "TemporaryFile", full)
    monkeypatch.setattr(columns, "BLOCK_BYTES", 500)
    with pytest.raises(OutputError, match=r"No space left on device; choose another folder"):
        synthetic.record_run(8.0, spool=tmp_path)


def test_twice(here, tmp_path):
    synthetic.record_run(8.0).save(tmp_path)
    assert digests(tmp_path) == digests(here)


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["0", "12345"])
def test_in_another_process(here, tmp_path, seed):
    subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path)], cwd=ROOT, check=True, env={**os.environ, "PYTHONHASHSEED": seed}
    )
    assert digests(tmp_path) == digests(here)


def test_different_runs_give_different_files(here, tmp_path):
    synthetic.record_run(8.0, seed=2).save(tmp_path)
    assert digests(tmp_path)["run.npz"] != digests(here)["run.npz"]


def test_the_file_has_no_time_stamps(here):
    with zipfile.ZipFile(here / "run.npz") as archive:
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_saving_does_not_change_the_recorder(tmp_path):
    recorder = synthetic.record_run(4.0)
    recorder.save(tmp_path / "a")
    recorder.save(tmp_path / "b")
    assert digests(tmp_path / "a") == digests(tmp_path / "b")
