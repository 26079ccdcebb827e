"""The same bits however many threads linear algebra had before hertzloop came."""

import os
from concurrent.futures import ThreadPoolExecutor, wait
from threading import Event

import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from hertzloop.plant import one_thread
from hertzloop.plant.one_thread import on_one_thread
from hertzloop.results.cases import metrics_of_case
from tests.hertzloop.commands import python
from tests.hertzloop.scenes import aluminium_3mm

SETTINGS = ["run.duration_s=0.002", "run.accuracy=0.05", "plate.edges=cffs"]
SCRIPT = f"""
import numpy  # before hertzloop can ask for one thread
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import load
from threadpoolctl import threadpool_info
print(max(found["num_threads"] for found in threadpool_info()))
print(metrics_of_case(load("aluminium-3mm", {SETTINGS})).digest)
print(max(found["num_threads"] for found in threadpool_info()))
"""


@pytest.mark.full
@pytest.mark.usefixtures("warm_kernels", "shipped_scenes")
def test_a_plate_is_the_same_where_numpy_came_first():
    if (os.cpu_count() or 1) < 2:
        pytest.skip("one core: NumPy has one thread anyway")
    unasked = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    done = python("-c", SCRIPT, env=unasked | {"OMP_NUM_THREADS": "2"})
    before, digest, after = done.stdout.split()
    assert digest == metrics_of_case(aluminium_3mm(*SETTINGS)).digest
    assert before == after == "2"  # what the caller has is left alone


def test_calls_in_two_threads_do_not_undo_each_other():
    # Another test of this process may have brought a library that was not there at the first call.
    one_thread._libraries.cache_clear()
    first_in, second_in = Event(), Event()

    def threads() -> set[int]:
        libraries = ThreadpoolController().select(user_api="blas").info()
        return {library["num_threads"] for library in libraries}

    @on_one_thread
    def first() -> set[int]:
        first_in.set()
        second_in.wait(0.5)  # which it may not be before this one has left
        return threads()

    @on_one_thread
    def second() -> set[int]:
        second_in.set()
        wait([leaving], timeout=60)
        return threads()

    # Limits of the caller's own are there, and are there again afterwards.
    with ThreadPoolExecutor(2) as pool, threadpool_limits(2, user_api="blas"):
        leaving = pool.submit(first)
        assert first_in.wait(60)
        assert pool.submit(second).result(60) == leaving.result(60) == {1}
        assert threads() == {2}
