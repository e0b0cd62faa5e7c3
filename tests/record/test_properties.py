from __future__ import annotations

import io
import json
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, Event, Footprint, GridGeometry, Window, jsonable
from navstack.record import Record, RunRecorder
from navstack.record.archive import check, write
from navstack.record.recorder import render_log


def a_recorder() -> RunRecorder:
    return RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={})


def through_a_file(recorder: RunRecorder) -> Record:
    """Writes and reads as `save` and `load` do, in memory."""
    meta, events, arrays = recorder._members()
    buffer = io.BytesIO()
    write(buffer, meta, events, arrays)
    with zipfile.ZipFile(buffer) as archive:
        read = {
            n[:-4]: np.lib.format.read_array(io.BytesIO(archive.read(n)))
            for n in archive.namelist()
            if n.endswith(".npy")
        }
        meta = json.loads(archive.read("meta.json"))
        events = [json.loads(line) for line in archive.read("events.jsonl").split(b"\n")[:-1]]
    check(meta, events, read)
    return Record(meta, events, read)


UPDATES = st.lists(
    st.tuples(
        st.sampled_from(["patch", "patch", "patch", "nothing", "move", "resize", "lie"]),
        st.integers(0, 8),
        st.integers(0, 6),
        st.integers(1, 5),
        st.integers(1, 5),
        st.integers(0, 255),
    ),
    min_size=1,
    max_size=12,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(UPDATES)
def test_any_history_of_a_costmap_is_restored(updates):
    recorder = a_recorder()
    costmap = Costmap(GridGeometry(9, 7, 0.1))
    states = []
    for i, (what, x0, y0, w, h, cost) in enumerate(updates):
        g = costmap.geometry
        window = Window(min(x0, g.nx), min(y0, g.ny), min(x0 + w, g.nx), min(y0 + h, g.ny))
        if what in ("patch", "lie"):
            costmap.data[window.slices] = cost
        elif what == "move":
            costmap.geometry = g.moved_to(g.origin_x + 0.1 * w, g.origin_y)
        elif what == "resize":
            costmap = Costmap(GridGeometry(w + 1, h + 1, 0.2), np.full((h + 1, w + 1), cost, np.uint8))
        changed = {"patch": window, "nothing": Window(0, 0, 0, 0)}.get(what)
        recorder.costmap(float(i), "global", costmap, changed)
        states.append((costmap.geometry, costmap.data.copy()))
    run = through_a_file(recorder)
    for i, (geometry, data) in enumerate(states):
        back = run.costmap_at("global", float(i))
        assert back is not None
        assert back.geometry == geometry
        assert np.array_equal(back.data, data)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.floats(0, 1e6), st.text(max_size=6), st.text(max_size=20), st.dictionaries(st.text(max_size=5), JSON)
        ),
        max_size=6,
    )
)
def test_any_event_is_restored_and_takes_at_most_one_line_of_the_log(reported):
    recorder = a_recorder()
    reported = [(t, kind, text, data) for t, kind, text, data in reported if kind != "feedback"]
    for t, kind, text, data in reported:
        recorder.on_event(Event(t, kind, text, data))
    # what is said again and again takes one line
    runs = [i for i, one in enumerate(reported) if i == 0 or one[1:3] != reported[i - 1][1:3]]
    assert len(render_log(*recorder._members()[:2]).splitlines()) == 3 + len(runs)
    run = through_a_file(recorder)
    assert [(e.time, e.kind, e.text, e.data) for e in run.events] == [
        (t, k, text, jsonable(d)) for t, k, text, d in reported
    ]


def test_sets_are_sorted():
    assert jsonable({"b", "a", "c"}) == ["a", "b", "c"]
    assert jsonable(frozenset({3, 1, 2})) == [1, 2, 3]


def test_file_names_that_are_not_utf_8(tmp_path):
    name = "map\udcff"  # as Python spells a file name that is not UTF-8
    recorder = RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={"map": name})
    recorder.on_event(Event(0.0, "info", name, {name: name}))
    recorder.save(tmp_path)
    run = Record.load(tmp_path)
    assert run.scenario == {"map": name}
    assert run.events == (Event(0.0, "info", name, {name: name}),)
    assert "\\udcff" in (tmp_path / "run.log").read_text(encoding="utf-8").lower()
