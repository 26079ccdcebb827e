"""The worker processes of a sweep leave nothing behind, however it ends."""

import threading
from multiprocessing import active_children

import pytest

from hertzloop.scenes.scene import load, to_toml
from studies.sweeps.evaluate import chunked, local_pool


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("ends", [None, KeyboardInterrupt])
def test_nothing_of_a_pool_is_left(ends: type[BaseException] | None) -> None:
    toml = to_toml(load("aluminium-3mm", ["run.accuracy=0.1"]))
    chunks = chunked([(number, {"run.seed": number}) for number in range(64)])
    threads, children = set(threading.enumerate()), set(active_children())

    def started() -> None:
        with local_pool(2) as pool:
            assert next(iter(pool(toml, "impact", chunks)))
            if ends:
                raise ends

    if ends:
        with pytest.raises(ends):
            started()
    else:
        started()
    assert set(threading.enumerate()) == threads
    assert set(active_children()) == children
