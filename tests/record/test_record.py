from __future__ import annotations

from navstack.record import Record
from tests.record import synthetic


def test_a_saved_run_comes_back_as_it_was(tmp_path):
    recorder = synthetic.record_run(12.0, scans=True)
    files = recorder.save(tmp_path / "out")
    assert sorted(files) == ["log", "record"]
    loaded, kept = Record.load(tmp_path / "out"), recorder.record()
    assert loaded.meta == kept.meta
    assert loaded.events == kept.events
    assert sorted(loaded.arrays) == sorted(kept.arrays)
    for name, array in kept.arrays.items():
        assert loaded.arrays[name].dtype == array.dtype
        assert loaded.arrays[name].tobytes() == array.tobytes()
