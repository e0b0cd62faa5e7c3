from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core.errors import OutputError
from navstack.core.files import atomic_write, ensure_directory, write_text


def test_writes_are_atomic(tmp_path: Path) -> None:
    target = tmp_path / "log.txt"
    write_text(target, "old")
    with pytest.raises(RuntimeError), atomic_write(target) as beside:
        beside.write_text("half")
        raise RuntimeError("power cut")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_folder_that_cannot_be_created(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="--out"):
        ensure_directory(tmp_path / "file" / "out")
    with pytest.raises(OutputError, match="cannot write"):
        write_text(tmp_path / "absent" / "x.txt", "")


def test_folder_without_write_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # root may write everywhere: the answer of the system is patched
    monkeypatch.setattr("navstack.core.files.os.access", lambda *_: False)
    with pytest.raises(OutputError, match="permission"):
        ensure_directory(tmp_path)
