from __future__ import annotations

import itertools
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.core import Footprint, InputError, OutputError
from navstack.plot import animate_run, colors
from navstack.record import RunRecorder
from tests.plot.test_pictures import a_run, count
from tests.record import synthetic


@pytest.fixture(scope="module")
def short():
    return synthetic.record_run(8.0).record()


@pytest.fixture(scope="module")
def film(short, tmp_path_factory) -> Path:
    return animate_run(short, tmp_path_factory.mktemp("film") / "run.gif", fps=5, speed=4)


def frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as image:
        out = []
        for i in range(image.n_frames):
            image.seek(i)
            out.append(np.asarray(image.convert("RGB")).astype(int))
        return out


@pytest.mark.slow
def test_number_and_duration_of_frames(film):
    with Image.open(film) as image:
        # 7.8 s at 4 simulated s per second and 5 frames per second: 10 steps and the first frame
        assert image.n_frames == 11
        assert image.info.get("loop") == 0
        durations = []
        for i in range(image.n_frames):
            image.seek(i)
            durations.append(image.info["duration"])
    assert durations == [200] * 10 + [2000]


@pytest.mark.slow
def test_the_driven_path_grows(film):
    shown = frames(film)
    assert all(frame.shape == shown[0].shape for frame in shown)
    trail = [count(frame, colors.DRIVEN) for frame in shown]
    assert trail[-1] > trail[5] > trail[0]
    assert all((a != b).any() for a, b in itertools.pairwise(shown))
    # the palette contains the colors with a meaning exactly; the background stays white
    assert count(shown[-1], colors.GOAL, 0) > 100
    assert count(shown[-1], colors.COLLISION, 0) > 20
    assert (shown[-1][:3] == 255).all()


@pytest.mark.slow
def test_a_film_shows_recoveries_over_the_robot_and_trajectories_while_they_are_driven():
    from navstack.plot import canvas
    from navstack.plot.film import Film

    record = synthetic.record_run(6.0).record()
    (at,) = (event.time for event in record.events_of("recovery"))
    with canvas.style():
        film = Film(record, "", 90.0)
        before, after = count(film.frame(at - 0.05), colors.RECOVERY), count(film.frame(at), colors.RECOVERY)
        assert after > before + 60  # the diamond around the robot, above its footprint
        last = float(record.local_plan_times[-1])
        driven, stale = count(film.frame(last), colors.GREEN), count(film.frame(last + 5.0), colors.GREEN)
        assert driven > stale + 60


@pytest.mark.slow
def test_a_film_shows_the_scans(tmp_path):
    with_scans = frames(animate_run(synthetic.record_run(3.0, scans=True).record(), tmp_path / "a.gif", fps=2))
    without = frames(animate_run(synthetic.record_run(3.0).record(), tmp_path / "b.gif", fps=2))
    assert count(with_scans[0], colors.SCAN) > count(without[0], colors.SCAN) + 100


@pytest.mark.slow
def test_animations_are_reproducible(short, film, tmp_path):
    again = animate_run(short, tmp_path / "again.gif", fps=5, speed=4)
    assert again.read_bytes() == film.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["again.gif"]


@pytest.mark.slow
def test_progress_is_reported_for_every_frame(short, tmp_path):
    reported = []
    animate_run(
        short, tmp_path / "run.gif", fps=2, speed=4, dpi=50, progress=lambda done, total: reported.append((done, total))
    )
    assert reported == [(i, 5) for i in range(1, 6)]


@pytest.mark.slow
def test_runs_with_few_data(tmp_path):
    animate_run(a_run([(0, 0), (1, 0)], n=3), tmp_path / "bare.gif", dpi=50)
    assert len(frames(animate_run(a_run([(0, 0), (1, 0)], n=1), tmp_path / "one.gif", dpi=50))) == 1
    empty = RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={}).record()
    with pytest.raises(InputError, match="no samples"):
        animate_run(empty, tmp_path / "none.gif")
    assert not (tmp_path / "none.gif").exists()


@pytest.mark.parametrize("bad", [{"fps": 0.0}, {"fps": float("nan")}, {"speed": -1.0}, {"speed": float("inf")}])
def test_invalid_speeds(short, tmp_path, bad):
    with pytest.raises(InputError, match=rf"{next(iter(bad))} must be a positive number"):
        animate_run(short, tmp_path / "run.gif", **bad)
    assert list(tmp_path.iterdir()) == []


def test_unknown_suffixes(short, tmp_path):
    with pytest.raises(OutputError, match=r"\.gif, \.mp4"):
        animate_run(short, tmp_path / "run.avi")


@pytest.mark.slow
def test_a_failure_leaves_no_partial_file(short, tmp_path):
    def stop(done, total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate_run(short, tmp_path / "run.gif", fps=5, dpi=50, progress=stop)
    assert list(tmp_path.iterdir()) == []


# --- MP4 --------------------------------------------------------------------------------------------------------------

STAND_IN = """#!{python}
import sys
arguments = sys.argv[1:]
width, height = map(int, arguments[arguments.index("-s") + 1].split("x"))
{body}
"""
COUNTS = """
content = sys.stdin.buffer.read()
assert len(content) % (width * height * 3) == 0, len(content)
open(arguments[-1], "w").write(f"{width} {height} {len(content) // (width * height * 3)}")
"""
REFUSES = """
sys.stdin.buffer.read(1000)
print("first complaint", file=sys.stderr)
print("Unknown encoder 'libx264'", file=sys.stderr)
sys.exit(1)
"""


def stand_in(folder: Path, body: str, monkeypatch) -> None:
    program = folder / "ffmpeg"
    program.write_text(STAND_IN.format(python=sys.executable, body=body))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def test_mp4_without_ffmpeg(short, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match=r"needs the program ffmpeg.*run\.gif"):
        animate_run(short, tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_mp4_frames_have_even_sizes(short, tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    stand_in(tmp_path / "bin", COUNTS, monkeypatch)
    path = animate_run(short, tmp_path / "run.mp4", fps=5, speed=4, dpi=61)
    width, height, count_ = map(int, path.read_text().split())
    assert width % 2 == height % 2 == 0
    assert count_ == 11 + 10  # the last frame is shown for two seconds


@pytest.mark.slow
def test_mp4_reports_the_error_of_ffmpeg(short, tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    stand_in(tmp_path / "bin", REFUSES, monkeypatch)
    with pytest.raises(OutputError, match=r"Unknown encoder 'libx264'.*\.gif"):
        animate_run(short, tmp_path / "run.mp4", fps=5, speed=4)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin"]
