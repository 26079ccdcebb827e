"""The processes of a sweep: when there are any, what each of them runs, and that none is left."""

import errno
import threading
from multiprocessing import active_children
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from hertzloop.results.spans import Span
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases import pool as crew
from hertzloop.studies.cases import workers as workers_module
from hertzloop.studies.cases.evaluate import Numbered, chunked, run_cases, scene_of
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import Rows
from hertzloop.studies.cases.workers import WorkersLost
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT
from tests.tiers import default

TOML = to_toml(load("aluminium-3mm", ["run.accuracy=0.1"]).scene)


def write(folder: Path) -> Path:
    """A law that does nothing."""
    law = folder / "mine.py"
    law.write_text("def command(p, s, samples, i):\n    return 0.0\n")
    return law


def cases(count: int) -> list[Numbered]:
    return chunked([(number, {"run.seed": number}) for number in range(count)])


HERE: list[int] = []  # numbers of the cases that this process runs


def noted(setup: Setup, span: Span, numbered: Numbered) -> Rows:
    HERE.extend(number for number, _ in numbered)
    return run_cases(setup, span, numbered)


def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let workers start with the second case."""
    monkeypatch.setattr(crew, "_LOOK_S", 0.0)
    monkeypatch.setattr(crew, "_WORTH_S", 0.0)


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("ends", [None, KeyboardInterrupt])
def test_nothing_of_a_pool_is_left(ends, monkeypatch):
    at_once(monkeypatch)
    threads, children = set(threading.enumerate()), set(active_children())

    def started() -> None:
        with local_pool(2) as pool:
            rows = pool(TOML, "impact", cases(64))
            assert all(next(rows) for _ in range(3))  # two cases, and some when there are workers
            assert set(active_children()) != children
            if ends:
                raise ends

    if ends:
        with pytest.raises(ends):
            started()
    else:
        started()
    assert set(threading.enumerate()) == threads
    assert set(active_children()) == children


@pytest.mark.usefixtures("warm_kernels")
def test_few_cases_start_no_process(monkeypatch):
    monkeypatch.setattr(crew, "_WORTH_S", 60.0)  # 1.5 s could be, where the machine is busy
    before = set(active_children())
    with local_pool(2) as pool:
        rows = [row for some in pool(TOML, "impact", cases(40)) for row in some]
        assert set(active_children()) == before
    assert [row["case"] for row in rows] == list(range(40))


@pytest.mark.usefixtures("warm_kernels")
def test_a_worker_that_cannot_be_started_is_told(monkeypatch):
    at_once(monkeypatch)
    threads, children = set(threading.enumerate()), set(active_children())
    start, started = SpawnProcess.start, []

    def fails(process: SpawnProcess) -> None:
        if started:
            raise OSError(errno.ENOMEM, "Cannot allocate memory")
        started.append(process)
        start(process)

    monkeypatch.setattr(SpawnProcess, "start", fails)
    with (
        pytest.raises(WorkersLost, match="workers cannot be started: Cannot allocate memory"),
        local_pool(3) as pool,
    ):
        list(pool(TOML, "impact", cases(64)))
    assert set(threading.enumerate()) == threads
    assert set(active_children()) == children


HALVED = """
import sys
from hertzloop.studies.cases import pool, workers
from tests.studies.cases.halved import half_an_answer
workers.run_chunk, pool._own_laws = half_an_answer, lambda *_: {"mine.py"}  # workers run all
with pool.local_pool(2) as results:
    list(results(sys.argv[1], "impact", [[(0, {})], [(1, {})]]))
"""


@pytest.mark.full
def test_a_worker_that_dies_within_an_answer_holds_nobody_up():
    """Python's pool waits for the rest of it, for as long as anybody could still write there."""
    said = python("-c", HALVED, TOML, cwd=ROOT, code=1).stderr
    assert "WorkersLost: a worker process died in a case of the law mine.py." in said


@pytest.mark.parametrize("by_case", default([False, True], [True]))
def test_a_law_from_elsewhere_is_not_run_here(by_case, tmp_path, monkeypatch):
    """It may crash its process; what the others have found is not lost with it."""
    law = str(write(tmp_path))
    toml, values = TOML, {"controller.law": law}
    if not by_case:
        toml, values = to_toml(load("aluminium-3mm", [f"controller.law={law}"]).scene), {}
    HERE.clear()
    for module in (crew, workers_module):
        monkeypatch.setattr(module, "run_cases", noted)
    with local_pool(2) as pool:
        (rows,) = pool(toml, "impact", chunked([(0, values), (1, {})]))
    assert not HERE
    assert [row["status"] for row in rows] == ["", ""]


def test_a_scene_is_read_once_but_not_the_law_of_a_file(tmp_path):
    assert scene_of(TOML) is scene_of(TOML)
    law = write(tmp_path)
    toml = to_toml(load("aluminium-3mm", [f"controller.law={law}"]).scene)
    scene_of(toml)
    law.write_text(law.read_text() + "\n# changed\n")
    with pytest.raises(SceneError, match="Copy the same file to both sides"):
        scene_of(toml)
