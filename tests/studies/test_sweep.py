"""Sweeps in worker processes and on a Dask cluster write the same lines."""

from __future__ import annotations

import json
import os
import signal
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from navstack.core import InputError
from navstack.parameters import load_configuration
from navstack.studies.comparison import Case
from navstack.studies.evaluation import RunOutcome, RunWork, run_job
from navstack.studies.executors import DaskExecutor
from navstack.studies.search_space import candidates
from navstack.studies.sweep import Sweep, run_sweep
from tests.studies.bowl import Bowl, space

# resources that the cluster leaves to the garbage collector
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")


def sweep(evaluation: Bowl | None = None, samples: int = 6) -> Sweep:
    base = load_configuration(["turtlebot"])
    searched = space(base)
    return Sweep(
        base, searched, candidates(searched, "lhs", samples=samples, points=1, seed=0), evaluation or Bowl(), {"a": 1}
    )


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    import dask
    from distributed import LocalCluster

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            dask.config.set({"distributed.admin.log-format": "", "distributed.scheduler.allowed-failures": 5}),
            LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as made,
        ):
            yield made


@pytest.mark.slow
def test_processes_and_cluster_write_the_same_lines(tmp_path: Path, cluster: Any) -> None:
    here = run_sweep(sweep(), tmp_path / "one.jsonl", workers=1)
    run_sweep(sweep(), tmp_path / "two.jsonl", workers=2)
    run_sweep(sweep(), tmp_path / "dask.jsonl", scheduler=cluster.scheduler_address)
    lines = (tmp_path / "one.jsonl").read_bytes()
    assert (tmp_path / "two.jsonl").read_bytes() == lines
    assert (tmp_path / "dask.jsonl").read_bytes() == lines
    assert len(here) == 6 * 4
    assert all(r.value["outcome"] in ("success", "timeout") for r in here)
    assert all("sim_time=" in json.loads(line)["key"] for line in lines.splitlines()[1:])


@pytest.mark.slow
def test_no_run_is_lost_or_repeated_if_a_worker_is_killed(tmp_path: Path, cluster: Any) -> None:
    wanted = sweep(Slow(3), samples=5)
    expected = run_sweep(wanted, None, workers=2)
    killed: list[int] = []

    def kill(result: object) -> None:
        if not killed:
            killed.append(next(w.pid for w in cluster.workers.values() if w.pid is not None))
            os.kill(killed[0], signal.SIGKILL)

    found = run_sweep(wanted, tmp_path / "runs.jsonl", scheduler=cluster.scheduler_address, on_result=kill)
    assert killed
    assert found == expected
    assert len((tmp_path / "runs.jsonl").read_text().splitlines()) == 1 + 15


class Slow(Bowl):
    """Slow enough to be interrupted."""

    def drive(self, case: Case, configuration: Any, *, record: bool = False) -> tuple[RunOutcome, None]:
        import time

        time.sleep(0.03)
        return super().drive(case, configuration)[0], None


@pytest.mark.slow
def test_a_killed_sweep_resumes(tmp_path: Path) -> None:
    whole = run_sweep(sweep(), tmp_path / "whole.jsonl", workers=1)
    lines = (tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "part.jsonl").write_text("".join(lines[:8]) + lines[8][:20])
    received: list[str] = []
    found = run_sweep(
        sweep(), tmp_path / "part.jsonl", workers=1, resume=True, on_result=lambda r: received.append(r.key)
    )
    assert found == whole
    assert len(received) == 24 - 7
    assert (tmp_path / "part.jsonl").read_text() == "".join(lines)


@pytest.mark.slow
def test_an_unreachable_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("navstack.studies.executors.CONNECT_TIMEOUT_S", 0.5)
    work = RunWork(load_configuration(["turtlebot"]), Bowl())
    for address in ("tcp://127.0.0.1:1", "nonsense://"):
        with pytest.raises(InputError, match=r"no Dask scheduler answers at .*start one with `dask scheduler`"):
            DaskExecutor(work, address)


def test_invalid_candidates_have_results_too() -> None:
    work = RunWork(load_configuration(["turtlebot"]), Bowl())
    job = run_job("1", ("DWAPlannerROS/sim_time=-3",), work.evaluation.cases[0])
    outcome = work(job.input)
    assert (outcome["outcome"], outcome["success"], outcome["score"]) == ("refused", False, -1.0)
    assert "sim_time" in outcome["text"]


@pytest.mark.slow
def test_summary_ranks_candidates() -> None:
    wanted = sweep()
    report = wanted.report(run_sweep(wanted, None, workers=1))
    ranking = report.document["ranking"]
    assert [row["candidate"] for row in report.tables[0].rows] == [str(row["candidate"]) for row in ranking]
    assert [row["score"] for row in ranking] == sorted((row["score"] for row in ranking), reverse=True)
    assert {row["candidate"] for row in ranking} == set(range(6))
