"""Jobs: results do not depend on the executor, on dead workers or on interruptions."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from navstack.core import InputError, InternalError, OutputError
from navstack.studies.executors import ProcessExecutor
from navstack.studies.jobs import Job, JobResult, SerialExecutor
from navstack.studies.results_file import ResultsFile
from navstack.studies.task import run_jobs
from tests.studies import work

NUMBERS = [Job(f"number {i}", i) for i in range(12)]


def lines(file: Path) -> list[str]:
    return file.read_text().splitlines()


def test_results_do_not_depend_on_the_number_of_processes(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("serial", "one", "two")]
    here = run_jobs(work.double, NUMBERS, executor=SerialExecutor(work.double), results=files[0])
    one = run_jobs(work.double, NUMBERS, processes=1, results=files[1])
    two = run_jobs(work.double, NUMBERS, processes=2, results=files[2])
    assert here == one == two
    assert [r.key for r in here] == [j.key for j in NUMBERS]
    assert here[2].value == {"twice": 4, "third": 2 / 3, "nothing": None}
    assert len({f.read_bytes() for f in files}) == 1
    assert len(lines(files[0])) == 1 + len(NUMBERS)


def test_a_failure_is_a_result_and_other_jobs_continue() -> None:
    results = run_jobs(work.fail, NUMBERS[:4], processes=2)
    assert [r.value for r in results] == [0, None, None, 3]
    assert [r.failed for r in results] == [False, True, True, False]
    assert results[1].error == {"cells": 7, "code": 208, "name": "NO_VALID_PATH", "message": "no way from 1"}
    assert results[2].error is not None
    assert results[2].error["message"] == "ZeroDivisionError: by hand"
    assert "in fail" in results[2].error["traceback"]


def test_a_dead_worker_is_replaced_and_its_job_retried(tmp_path: Path) -> None:
    jobs = [Job(str(i), (str(tmp_path), i)) for i in range(8)]
    assert [r.value for r in run_jobs(work.die_once, jobs, processes=2)] == list(range(8))
    assert (tmp_path / "died").exists()


def test_a_job_that_kills_its_worker_twice_is_a_failure() -> None:
    results = run_jobs(work.die, NUMBERS[:4], processes=2)
    assert [r.value for r in results] == [0, None, 2, 3]
    assert results[1].error is not None
    assert results[1].error["name"] == "WORKER_DIED"
    assert "SIGKILL" in results[1].error["message"] and "memory" in results[1].error["message"]


def test_a_killed_idle_worker_loses_no_job() -> None:
    with ProcessExecutor(work.double, 1) as executor:
        executor.submit(NUMBERS[0])
        assert executor.collect().key == "number 0"
        worker = multiprocessing.active_children()[0].pid
        assert worker is not None
        os.kill(worker, signal.SIGKILL)
        executor.submit(NUMBERS[1])
        assert executor.collect().value["twice"] == 2


def test_a_worker_runs_many_jobs_and_caches_its_data() -> None:
    assert [r.value for r in run_jobs(work.Counting(), NUMBERS, processes=1)] == list(range(1, 13))


def test_workers_use_the_current_folder_and_print_to_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NAVSTACK_OF_NOW", "yes")
    (result,) = run_jobs(work.surroundings, [Job("a", "NAVSTACK_OF_NOW")], processes=1)
    assert result.value == [str(tmp_path), "yes"]
    assert "to stderr" not in capfd.readouterr().out


def test_finished_jobs_are_skipped(tmp_path: Path) -> None:
    file = tmp_path / "out" / "results.jsonl"
    with ResultsFile(file, {"a": 1}, [j.key for j in NUMBERS], resume=False) as half:
        half.add(JobResult("number 3", value="kept"))
        half.add(JobResult("number 4", error={"message": "failed then"}))
    with file.open("a") as end:
        end.write('{"key":"number 5","value":{"twi')  # killed in the middle of a line
    heard: list[str] = []
    results = run_jobs(
        work.double,
        NUMBERS,
        what={"a": 1},
        processes=1,
        results=file,
        resume=True,
        on_result=lambda r: heard.append(r.key),
    )
    assert results[3].value == "kept"
    assert results[4].value["twice"] == 8 and results[5].value["twice"] == 10
    assert sorted(heard) == sorted(j.key for j in NUMBERS if j.key != "number 3")
    assert [json.loads(line)["key"] for line in lines(file)[1:]] == [j.key for j in NUMBERS]
    # and nothing at all when everything is there
    heard.clear()
    again = run_jobs(
        work.fail, NUMBERS, what={"a": 1}, results=file, resume=True, on_result=lambda r: heard.append(r.key)
    )
    assert again == results and not heard


@pytest.mark.parametrize("cut", [5, 40, -3, -30])
def test_a_file_truncated_anywhere_is_resumed(tmp_path: Path, cut: int) -> None:
    file, whole = tmp_path / "cut", tmp_path / "whole"
    want = run_jobs(work.double, NUMBERS, executor=SerialExecutor(work.double), results=whole)
    file.write_bytes(whole.read_bytes()[:cut])
    got = run_jobs(work.double, NUMBERS, executor=SerialExecutor(work.double), results=file, resume=True)
    assert got == want
    assert file.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize(
    ("content", "what", "resume", "match"),
    [
        (None, {"params": "jackal", "seeds": 5}, False, "already contains 2 of 3 results; continue with --resume"),
        (None, {"params": "husky", "seeds": 5}, True, 'params was "jackal", now it is "husky"; use the same'),
        (None, {"params": "jackal"}, True, "seeds was 5, now it is null"),
        ("a,b\n1,2\n", {}, True, "results:1 is not a result of these jobs"),
        ("a,b", {}, True, "results:1 is not a result of these jobs"),
        ("[]\n", {}, True, "results:1 is not a result of these jobs"),
    ],
)
def test_a_file_of_other_jobs_is_rejected(
    tmp_path: Path, content: str | None, what: dict[str, object], resume: bool, match: str
) -> None:
    file, keys = tmp_path / "results", ["a", "b", "c"]
    if content is None:
        with ResultsFile(file, {"params": "jackal", "seeds": 5}, keys, resume=False) as first:
            first.add(JobResult("a", 1))
            first.add(JobResult("b", 2))
    else:
        file.write_text(content)
    before = file.read_bytes()
    with pytest.raises(InputError, match=match):
        ResultsFile(file, what, keys, resume=resume)
    assert file.read_bytes() == before


def test_other_jobs_and_damaged_lines(tmp_path: Path) -> None:
    file = tmp_path / "results"
    with ResultsFile(file, {}, ["a", "b"], resume=False) as first:
        first.add(JobResult("a", 1))
    with pytest.raises(InputError, match="the list of jobs differs"):
        ResultsFile(file, {}, ["a", "b", "c"], resume=True)
    head = lines(file)[0]
    file.write_text(f'{head}\nrubbish\n{{"key":"b","value":1}}\n')
    with pytest.raises(InputError, match="results:2 is not a result"):
        ResultsFile(file, {}, ["a", "b"], resume=True)


def test_two_processes_do_not_write_the_same_file(tmp_path: Path) -> None:
    with (
        ResultsFile(tmp_path / "results", {}, ["a"], resume=False),
        pytest.raises(OutputError, match="another process"),
    ):
        ResultsFile(tmp_path / "results", {}, ["a"], resume=True)


def test_a_folder_that_cannot_be_created(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="--out"):
        run_jobs(work.double, NUMBERS, results=tmp_path / "file" / "results")
    with pytest.raises(OutputError, match="cannot write"):
        run_jobs(work.double, NUMBERS, results=tmp_path)


class Closing(SerialExecutor):
    """Says whether it was closed."""

    def __init__(self) -> None:
        super().__init__(work.double)
        self.closed = False

    def close(self) -> None:
        self.closed = True


def test_incorrect_use_is_rejected() -> None:
    with pytest.raises(InternalError, match="number 0"):
        run_jobs(work.double, [NUMBERS[0], NUMBERS[0]])
    with pytest.raises(InputError, match="at least 1"):
        run_jobs(work.double, NUMBERS, processes=0)
    with pytest.raises(InternalError, match="cannot be sent"):
        run_jobs(lambda x: x, NUMBERS, processes=1)
    with pytest.raises(InternalError, match="the job 'odd' cannot be sent"):
        run_jobs(work.double, [Job("odd", lambda: 1)], processes=1)
    closed = Closing()
    with pytest.raises(InternalError, match="number 0"):
        run_jobs(work.double, [NUMBERS[0], NUMBERS[0]], executor=closed)
    assert closed.closed
    with pytest.raises(InternalError, match="submit"):
        ProcessExecutor(work.double, 1).collect()
    assert run_jobs(work.double, [], processes=2) == []


def lives(pid: int) -> bool:
    """True if the process is running; False for a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def half_done(results: Path, inputs: list[Path]) -> bool:
    begun = all(Path(f"{file}.pid").exists() and Path(f"{file}.pid").read_text() for file in inputs)
    return begun and results.exists() and len(lines(results)) == 3


SCRIPT = """
import signal
import sys
from pathlib import Path
from navstack.studies.jobs import Job
from navstack.studies.task import run_jobs
from tests.studies import work

if __name__ == "__main__":
    # whatever runs the tests: a shell's background jobs ignore it, and so would their children
    signal.signal(signal.SIGINT, signal.default_int_handler)
    files = sys.argv[2:]
    jobs = [Job(str(i), file) for i, file in enumerate(files)]
    run_jobs(work.wait_for, jobs, processes=2, results=Path(sys.argv[1]), resume=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_is_resumed(tmp_path: Path, how: signal.Signals) -> None:
    """Two of four jobs wait on a pipe forever; the run is killed when the others are in the file, and its workers end too."""
    results, inputs = tmp_path / "results", [tmp_path / str(i) for i in range(4)]
    for i, file in enumerate(inputs):
        if i in (0, 2):
            file.write_text(f"content {i}")
        else:
            os.mkfifo(file)
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen([sys.executable, script, results, *inputs], stderr=subprocess.DEVNULL)
    try:
        while process.poll() is None and not half_done(results, inputs):
            pass
        assert process.poll() is None
        process.send_signal(how)
        assert process.wait() == -how
    finally:
        process.kill()
        process.wait()
    assert {json.loads(line)["key"] for line in lines(results)[1:]} == {"0", "2"}
    for i in (1, 3):
        while lives(int(Path(f"{inputs[i]}.pid").read_text())):
            pass
        inputs[i].unlink()
        inputs[i].write_text(f"content {i}")
    again = run_jobs(
        work.wait_for, [Job(str(i), str(f)) for i, f in enumerate(inputs)], processes=2, results=results, resume=True
    )
    assert [r.value for r in again] == [f"content {i}" for i in range(4)]


def test_workers_never_see_an_interrupt() -> None:
    """Not while they start either: Ctrl-C goes to every process of the terminal. This process gets it."""
    with ProcessExecutor(work.blocks_interrupts, 1) as executor:
        executor.submit(Job("one", {"number": 1}))
        assert executor.collect().value is True
    assert not work.blocks_interrupts(1)


def test_the_time_left_counts_jobs_by_their_weight(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The whole run of `bench speed` takes as long as ten scenes."""
    from navstack.studies import task

    now = 0.0
    monkeypatch.setattr(task.time, "monotonic", lambda: now)
    monkeypatch.setattr("sys.stderr.isatty", lambda: False, raising=False)
    jobs = [Job("long", 0, 10.0), *(Job(f"short {k}", 0) for k in range(10))]
    with task.progress_of(jobs, [], quiet=False) as report:
        now = 600.0
        report(JobResult("long", None, None))
    assert "1 of 11 done, 10.0 min left" in capfd.readouterr().err


def test_the_jobs_of_the_speed_benchmark_are_weighted() -> None:
    from navstack.studies.speed import SCENES, STAGES_OF_RUN, WHOLE_RUN, SpeedTask

    weights = {job.key: job.weight for job in SpeedTask(None, 7).jobs()}
    assert weights[WHOLE_RUN] == weights[STAGES_OF_RUN] == 8.0
    assert all(weights[name] < 1.0 for name in SCENES)
