"""Sweeps cut short: the journal, kills and resumption, a Dask cluster that loses a part."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hertzloop.scene.setup import load
from hertzloop.studies.cases import dask_pool
from hertzloop.studies.cases.axis import axes_from
from hertzloop.studies.cases.design import design_of
from hertzloop.studies.cases.journal import Journal, JournalError
from hertzloop.studies.sweep import sweep as study
from hertzloop.studies.sweep.plan import SweepPlan
from hertzloop.studies.sweep.results_file import read_results
from tests.commands import refused, succeed
from tests.hertzloop.commands import ended, hertzloop, next_line, start, wait_for
from tests.hertzloop.scenes import json_in
from tests.studies.sweeping import COARSE, ONE_WORKER
from tests.tiers import default


@pytest.mark.parametrize("text", [b"\xff\n", b'{"a": 1}\n{"x": 1}\n'])
def test_a_damaged_journal_is_left_alone_with_a_sentence(tmp_path, text):
    path = tmp_path / "j"
    path.write_bytes(text)
    with pytest.raises(JournalError, match="its line 1 is damaged"):
        Journal(path, {"a": 1})
    assert path.read_bytes() == text


def test_two_sweeps_do_not_write_one_journal(tmp_path):
    path = tmp_path / "j"
    with Journal(path, {"a": 1}) as journal:
        journal.add({"case": 0})
        with pytest.raises(JournalError, match="in use by another command"):
            Journal(path, {"a": 1})
    with Journal(path, {"a": 1}) as journal:
        assert list(journal.done) == [0]


def test_a_torn_last_line_is_run_again(tmp_path):
    path = tmp_path / "j"
    with Journal(path, {"a": 1}) as journal:
        journal.add({"case": 0, "x": 1.5})
        journal.add({"case": 1, "x": float("nan")})
    whole = path.read_bytes()
    path.write_bytes(whole[:-4])
    with Journal(path, {"a": 1}) as journal:
        assert list(journal.done) == [0]
        journal.add({"case": 1, "x": float("nan")})
    assert path.read_bytes() == whole


def test_a_changed_digit_in_the_journal_is_named_and_its_case_run_again(tmp_path):
    scene, over = load("aluminium-3mm", COARSE), ["controller.latency_us=0:3:1"]
    design = design_of(scene, axes_from(over), "grid", 256, scene.run.seed)
    out, report, kept = (tmp_path / name for name in ("r.csv", "r.json", "kept"))
    journal = study.journal_of(out)

    def keep(finished: int) -> None:
        if finished:
            shutil.copy(journal, kept)

    study.sweep(SweepPlan(scene, design, ONE_WORKER), out, on_progress=keep)
    whole = out.read_bytes()
    out.unlink()
    lines = kept.read_bytes().splitlines(keepends=True)
    lines[3] = lines[3].replace(b'"rebound_m_s": 0.', b'"rebound_m_s": 1.')
    journal.write_bytes(b"".join(lines))
    words = ["--set", COARSE[0], "--workers", "1", "--over", *over, "-o", out, "--json", report]
    said = succeed("sweep", "aluminium-3mm", *words)
    assert "line 4 of" in said
    assert "was damaged. Its case was run again." in said
    assert out.read_bytes() == whole
    told = json_in(report)
    assert (told["ran"], told["damaged_lines"]) == (1, [4])


def test_the_journal_of_another_sweep_is_left_alone(tmp_path):
    path = tmp_path / "j"
    with Journal(path, {"span": "impact"}) as journal:
        journal.add({"case": 0})
    before = path.read_bytes()
    with pytest.raises(JournalError, match="its entry 'span' differs"):
        Journal(path, {"span": "run"})
    assert path.read_bytes() == before


def _lines(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [
        json.loads(line)
        for line in path.read_bytes().splitlines(keepends=True)[1:]
        if line.endswith(b"\n")
    ]


def _wait_for(path: Path, cases: int, process: subprocess.Popen[Any]) -> None:
    _wait_until(lambda: len(_lines(path)) >= cases, process)


def _wait_until(look: Callable[[], bool], process: subprocess.Popen[Any]) -> None:
    """Wait for what a command that goes on brings about."""
    wait_for(lambda: process.poll() is not None or look())
    assert process.poll() is None, "it ended before it could be cut short"


BIG = [
    "sweep",
    "aluminium-3mm",
    "--set",
    "run.accuracy=0.05",
    "--over",
    "controller.latency_us=0:199:1",
    "--over",
    "sensors.bits=4:7:1",
]


def begun(out: Path, sweep: list[str], *words: str) -> subprocess.Popen:
    """A sweep in a session of its own, which heeds a closed terminal."""
    return start(*sweep, "-o", str(out), *words, start_new_session=True, preexec_fn=_heeds_all)


# So many that no machine is done with them before workers are there, or what ends them arrives.
HUGE = [*BIG, "--over", "controller.kappa=0.1:0.9:0.01"]


@pytest.mark.full
def test_a_killed_sweep_goes_on_without_losing_or_repeating_a_case(tmp_path):
    out = tmp_path / "r.parquet"
    process = begun(out, BIG)
    _wait_for(study.journal_of(out), 200, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert not out.exists()
    kept = {row["case"]: row for row in _lines(study.journal_of(out))}
    words = [*BIG, "-o", str(out)]
    refused("its entry 'design' differs", *words, "--over", "controller.kappa=1,2")
    report = tmp_path / "r.json"
    hertzloop(*words, "--json", str(report))
    rows, _ = read_results(out)
    assert [row["case"] for row in rows] == list(range(800))
    assert json_in(report)["ran"] == 800 - len(kept)
    assert all(rows[case]["digest"] == row["digest"] for case, row in kept.items())
    assert "has the results of this sweep" in succeed(*words)


def _children(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _semaphores(pid: int) -> set[Path]:
    """Those of multiprocessing that a process has, which have names; mapped before they had."""
    maps = Path(f"/proc/{pid}/maps").read_text().splitlines()
    mapped = {int(line.split()[4]) for line in maps if "/dev/shm/" in line}
    named = Path("/dev/shm").glob("sem.mp-*")
    return {path for path in named if path.exists() and path.stat().st_ino in mapped}


def _heeds_all() -> None:
    """Who runs the tests may ignore a closed terminal."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


ENDS = [signal.SIGINT, signal.SIGKILL, signal.SIGHUP]


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("sent", default(ENDS, ENDS[:1]))
def test_nothing_is_left_of_a_sweep_that_is_ended(tmp_path, sent):
    """No worker, and no semaphore; Ctrl-C and a terminal that is closed tell all of them."""
    out = tmp_path / "r.csv"
    process = begun(out, HUGE, "--workers", "2")
    _wait_until(lambda: len(_workers(process.pid)) == 1, process)
    started, semaphores = _children(process.pid), _semaphores(process.pid)
    assert semaphores
    if sent == signal.SIGKILL:
        process.send_signal(sent)
    else:
        os.killpg(process.pid, sent)
    _, said = process.communicate(timeout=60)  # until who removes the semaphores has ended, too
    if sent != signal.SIGKILL:
        assert process.returncode == 130
        assert said.splitlines()[-1].startswith("interrupted; finished cases are kept")
        assert "resource_tracker" not in said
        assert "Traceback" not in said
    assert not any(path.exists() for path in semaphores)
    wait_for(lambda: not any(_runs(pid) for pid in started))


def _workers(pid: int) -> list[int]:
    return [p for p in _children(pid) if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]


@pytest.mark.full
@pytest.mark.usefixtures("warm_kernels")
def test_a_worker_that_dies_ends_a_sweep_with_a_sentence(tmp_path):
    out = tmp_path / "r.csv"
    process = begun(out, HUGE, "--workers", "3")
    _wait_until(lambda: len(_workers(process.pid)) == 2, process)
    # Until all processes are at it, and this one has taken from what was left for them.
    _wait_for(study.journal_of(out), len(_lines(study.journal_of(out))) + 1000, process)
    workers = _workers(process.pid)
    os.kill(workers[0], signal.SIGKILL)
    try:
        _, said = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 1
    assert " ".join(said.split()).endswith(
        "error: a worker process died; finished cases are kept. Run the same command again "
        "to continue."
    )
    assert "Traceback" not in said
    assert not any(_runs(pid) for pid in workers)
    assert len(_lines(study.journal_of(out))) >= 1000


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A Dask scheduler and workers, each a process."""
    started = [subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", "--port",
                                 "0", "--host", "127.0.0.1", "--no-dashboard"],
                                stderr=subprocess.PIPE, text=True)]  # fmt: skip
    try:
        while "Scheduler at:" not in (line := next_line(started[0], started[0].stderr)):
            pass
        address = line.split()[-1]
        for _ in range(workers):
            started.append(
                subprocess.Popen(
                    [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny",
                     "--nthreads", "1", "--no-dashboard"], stderr=subprocess.DEVNULL,
                )
            )  # fmt: skip
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.full
def test_a_dask_cluster_that_loses_a_worker_gives_the_rows_of_one_machine(tmp_path):
    out, report = tmp_path / "r.csv", tmp_path / "r.json"
    with cluster(2) as (address, workers):
        process = begun(out, BIG, "--dask", address, "--json", str(report))
        _wait_for(study.journal_of(out), 200, process)
        workers[0].kill()
        ended(process)
    rows, _ = read_results(out)
    assert [row["case"] for row in rows] == list(range(800))
    assert not any(row["status"] for row in rows)
    assert json_in(report)["ran"] == 800
    local = tmp_path / "local.csv"
    succeed(*BIG, "-o", local, "--workers", "1")
    assert local.read_bytes() == out.read_bytes()


@pytest.mark.full
def test_a_lost_scheduler_is_named_and_finished_cases_are_kept(tmp_path):
    out = tmp_path / "r.csv"
    with cluster(1) as (address, _):
        process = begun(out, HUGE, "--dask", address)
        _wait_for(study.journal_of(out), 100, process)
    ended(process, 1, "was lost; finished cases are kept")
    assert len(_lines(study.journal_of(out))) >= 100


@pytest.mark.full
def test_a_cluster_without_workers_is_waited_for_with_a_word(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_pool, "_WORKERLESS_S", 4.0)
    monkeypatch.setattr(dask_pool, "_LOOK_S", 1.0)
    with cluster(0) as (address, _):
        words = [*HUGE, "-o", tmp_path / "r.csv", "--dask", address]
        said = refused("error: the Dask scheduler", *words, code=1)
    assert f"{address} has no workers; waiting 4 s for one" in said


@pytest.mark.full
def test_a_scheduler_that_is_not_there_is_named(tmp_path):
    words = ["--over", "sensors.bits=4,5", "-o", tmp_path / "r.csv", "--dask", "tcp://127.0.0.1:1"]
    sentence = "no Dask scheduler answers at tcp://127.0.0.1:1"
    refused(sentence, "sweep", *words, code=1)
    refused("Give the address of a scheduler", "sweep", *words[:-1], "no-port")
