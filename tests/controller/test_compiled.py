"""What is compiled for a law that this machine has never seen."""

import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest
from numba import config
from numba.core import event

from hertzloop.common.jit import folder
from hertzloop.controller.loading.compiled import FUNCTIONS
from hertzloop.controller.loading.registry import SHIPPED, find
from hertzloop.law import LawContext

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


class Heard(event.Listener):
    """Names of what Numba compiles."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: Any) -> None:
        """Before a function is compiled."""
        self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        """After it."""


@pytest.fixture
def heard():
    listener = Heard()
    event.register("numba:compile", listener)
    yield listener
    event.unregister("numba:compile", listener)


def unseen(path: Path, text: str) -> Any:
    path.write_text(f"{text}\n# {time.time_ns()}\n", encoding="utf-8")
    return find(str(path))


def test_of_a_new_law_the_functions_that_are_asked_for_are_compiled(tmp_path, heard):
    """With their helpers, which a process compiles once."""
    law = unseen(tmp_path / "new.py", (SHIPPED / "slope_threshold.py").read_text())
    keys, about = law.keys(), LawContext(sphere_mass_kg=1e-4, impact_speed_m_s=1.0)
    bound = law.bind(keys, about, ahead=False)
    assert [name for name in heard.names if name in FUNCTIONS] == ["command"]
    assert bound.model.command
    assert not bound.model.known_ahead
    heard.names.clear()
    bound = law.bind(keys, about)
    assert [name for name in heard.names if name in FUNCTIONS] == [
        "known_ahead",
        "command_ahead",
        "trigger_level",
    ]
    assert all(bound.model[:4])
    assert not bound.trouble


def test_a_law_in_the_disk_is_not_compiled_again(tmp_path, heard):
    law = unseen(tmp_path / "new.py", (SHIPPED / "force_feedback.py").read_text())
    law.bind(law.keys(), LawContext())
    assert heard.names
    heard.names.clear()
    (tmp_path / "other").mkdir()
    again = find(str(shutil.copy(tmp_path / "new.py", tmp_path / "other")))
    from hertzloop.controller.loading import compiled

    compiled._ENTRIES.clear()
    again.bind(again.keys(), LawContext())
    assert not heard.names


def test_a_disk_that_takes_nothing_ends_nothing(tmp_path, heard, monkeypatch, capsys):
    """A sentence, once."""
    free = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: free)
    folder.has_room.cache_clear()
    law = unseen(tmp_path / "new.py", (SHIPPED / "force_feedback.py").read_text())
    bound = law.bind(law.keys(), LawContext())
    folder.has_room.cache_clear()
    assert bound.model.command
    assert not bound.trouble
    said = capsys.readouterr().err
    assert said.startswith("hertzloop: compiled kernels cannot be kept in ")
    assert said.endswith("1 MB are free. Every process compiles them again. Make room there.\n")
    assert said.count("hertzloop:") == 1


def test_what_numba_refuses_is_told_by_its_line(tmp_path):
    law = unseen(tmp_path / "new.py", "def command(p, s, samples, i):\n    return {}.get(open)\n")
    said = law.bind(law.keys(), LawContext()).trouble
    assert said.startswith("Untyped global name 'open'")
    assert said.endswith("(line 2)")
    assert "\x1b" not in said


def test_threads_may_meet_a_law_at_once(tmp_path, heard):
    law = unseen(tmp_path / "new.py", (SHIPPED / "force_feedback.py").read_text())
    together = Barrier(8)

    def bound(gain: float) -> Any:
        together.wait(60)
        return law.bind(law.keys(), LawContext(stiffness=gain), ahead=False)

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(bound, range(8)))
    assert not any(one.trouble for one in found)
    assert len({one.model.command for one in found}) == 1
    assert heard.names.count("command") == 1
