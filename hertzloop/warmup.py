"""Compile all that a scene runs before it runs; later processes load it from the cache."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hertzloop.bus.sockets import own_folder
from hertzloop.common.jit.folder import cache_folder, has_room, types_digest
from hertzloop.common.jit.progress import report_functions
from hertzloop.processes.signals import end_with_parent
from hertzloop.scene.build import build_plant, build_sensor, free_series
from hertzloop.scene.controller import bound_law
from hertzloop.scene.toml import to_toml

if TYPE_CHECKING:
    from hertzloop.scene.setup import Setup

Progress = Callable[[float, str], None]  # is told the finished share, and what is compiled


class Work(StrEnum):
    """What kernels are compiled for."""

    EXCHANGE = "exchange"  # a plant and a controller that exchange messages
    LOOP = "loop"  # both in one compiled loop, as in the cases of a sweep
    RESULTS = "results"  # the metrics of a run, and of the same without control


RUN = (Work.EXCHANGE, Work.LOOP, Work.RESULTS)  # its verdict repeats the impact in the loop
CASES = (Work.LOOP,)

_PAST_TOUCH_S = 1e-3  # long enough for the metrics of an impact, where that is short
_MOST_STEPS = 20_000  # of that moment, some tenths of a second
_PLANT_KERNELS = 110  # compiled for the plant of the default scene, parts of others included
_PLANT_SHARE = 0.95  # of the time that passes
# Of the made-up contact: the steps before it, of it and of all, and the force.
_BEFORE, _CONTACT, _ROWS, _FORCE_N = 50, 30, 2000, 100.0


def _silent(share: float, what: str) -> None:
    """No progress to tell anybody."""


def anything_compiled() -> bool:
    """Whether an earlier call has filled the cache with the kernels of some scene."""
    return any(cache_folder().glob(".compiled-*"))


def not_compiled(*scenes: "Setup", works: Collection[Work] = RUN) -> set[Work]:
    """Return for what `ensure_compiled` has something left to do. Raises SceneError."""
    return {work for _, markers in _missing(scenes, works) for work in markers}


def ensure_compiled(
    *scenes: "Setup", works: Collection[Work] = RUN, on_progress: Progress = _silent
) -> None:
    """Run each of the scenes for a moment without its law, unless that was done for its kernels
    before.

    Args:
        scenes: the scenes; without any the default one, with each model of its plate.
        works: what they are to be compiled for.
        on_progress: is told how far it is.

    Raises:
        SceneError: a scene cannot be built.
    """
    missing = _missing(scenes, works)
    for number, (setup, markers) in enumerate(missing):

        def tell(share: float, what: str, number: int = number) -> None:
            on_progress((number + share) / len(missing), what)

        moment = _moment_of(setup)
        _compile_at_once(setup, moment, list(markers), tell)
        with own_folder() as folder:
            for work, run in _RUN.items():
                if work in markers:
                    run(moment, Path(folder))
        for marker in markers.values():
            _mark(marker)
    if not scenes and not _usual(works).exists():
        _mark(_usual(works))


def _missing(
    scenes: Sequence["Setup"], works: Collection[Work]
) -> list[tuple["Setup", Mapping[Work, Path]]]:
    """Scenes with what is not compiled for them, and its markers; one scene for each kind."""
    # To name the marker of a scene takes its modes: a twentieth of a short sweep.
    if not scenes and _usual(works).exists():
        return []
    found: dict[str, tuple[Setup, dict[Work, Path]]] = {}
    for setup in scenes or _default():
        types = _types_of(setup)
        markers = {work: cache_folder() / f".compiled-{types}-{work}" for work in works}
        missing = {work: marker for work, marker in markers.items() if not marker.exists()}
        if missing:
            found.setdefault(types, (setup, missing))
    return list(found.values())


def _default() -> list["Setup"]:
    from hertzloop.scene.loading import DEFAULT
    from hertzloop.scene.setup import load

    return [load(DEFAULT, [f"run.plate_model={model}"]) for model in ("modal", "infinite")]


def _usual(works: Collection[Work]) -> Path:
    """A file that is there once all is compiled for the default scene."""
    return cache_folder() / f".compiled-usual-{'-'.join(works)}"


def _types_of(setup: "Setup") -> str:
    """A name of the types that kernels are compiled for. Those of a controller are the same for
    every law and signal path."""
    plant, sensor = build_plant(setup), build_sensor(setup)
    return types_digest(plant.model, plant.state, sensor.model, sensor.state)


def _mark(marker: Path) -> None:
    """Note that all is in the cache, if the disk takes it."""
    with suppress(OSError):
        if has_room():
            marker.touch()


def _moment_of(setup: "Setup") -> "Setup":
    """A scene that runs the same kernels, until just after the first touch."""
    from hertzloop.scene.setup import parse

    # How long a run lasts may decide about the model of its plate.
    setup = setup.without_control().with_plate_model(setup.plate_model)
    setup = parse(to_toml(setup.scene))  # without what other laws have to be told
    steps = round((setup.first_touch_s + _PAST_TOUCH_S) / setup.run.step_s)
    return setup.with_steps(max(1, min(steps, setup.run.steps, _MOST_STEPS)))


def _compile_at_once(
    setup: "Setup", moment: "Setup", works: Sequence[Work], tell: Progress
) -> None:
    """Compile the kernels of the plant here, and all others meanwhile in a process of its own, if
    there is a second core."""
    tell(0.0, "the plant")
    done, what = 0, "the plant"

    def count(name: str) -> None:
        nonlocal done, what
        done += 1
        what = f"the plant: {name}" if name else what
        tell(_PLANT_SHARE * min(done / _PLANT_KERNELS, 1.0), what)

    beside = _start_beside(setup, works) if len(os.sched_getaffinity(0)) > 1 else None
    try:
        with report_functions(count):
            _compile_loop(moment)
        tell(_PLANT_SHARE, "metrics and controller")
    except BaseException:
        if beside:
            beside.kill()
        raise
    finally:
        if beside:
            beside.wait()


def _compile_loop(setup: "Setup") -> None:
    """Compile the loop, which is one for all works."""
    free_series(setup)
    setup.infinite_plate.lasts_s()


def _start_beside(setup: "Setup", works: Sequence[Work]) -> subprocess.Popen[str]:
    """A process that runs `_compile_beside`. What it fails to compile, `_RUN` compiles."""
    program = f"from {__name__} import _compile_beside as c; c({os.getpid()})"
    process = subprocess.Popen(
        # -P: a folder of the user's that is called like one of ours must not be imported
        [sys.executable, "-P", "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin
    with suppress(BrokenPipeError), process.stdin as told:  # it may have failed
        json.dump([to_toml(setup.scene), works], told)
    return process


def _compile_beside(parent: int) -> None:
    """Compile what is no part of the plant, for the scene and the works that are read.

    Ends with the process `parent`, which may exit at once on a signal.
    """
    end_with_parent()
    if os.getppid() != parent:  # it has ended while this process imported
        return
    from hertzloop.loop import answering
    from hertzloop.results.metrics import metrics_of
    from hertzloop.scene.setup import parse

    scene, works = json.load(sys.stdin)
    setup = parse(scene)
    moment = _moment_of(setup)
    if Work.EXCHANGE in works:
        answering.load()
    if Work.RESULTS in works or Work.LOOP in works:
        metrics_of(moment, _made_up_contact(moment))
    if setup.scene.controller.law_is_shipped:  # one of the user's is not imported once more
        bound_law(setup)


def _made_up_contact(setup: "Setup") -> np.ndarray:
    """Truth, shape (10, steps), of a contact that no plant has made."""
    from hertzloop.plant import time_series as ts

    truth = np.zeros((ts.COLUMNS, _ROWS))
    during = slice(_BEFORE, _BEFORE + _CONTACT)
    push = np.sin(np.pi * (np.arange(_CONTACT) + 0.5) / _CONTACT)
    speed_m_s = setup.mechanics.sphere.impact_speed_m_s
    steps_away = np.arange(_ROWS) - _BEFORE
    steps_away = np.where(steps_away < 0, -steps_away, np.maximum(steps_away - _CONTACT, 0))
    truth[ts.XI] = truth[ts.XI_S] = speed_m_s * setup.run.step_s * steps_away
    truth[ts.XI, during] = truth[ts.XI_S, during] = -1e-6 * push
    truth[ts.F_C, during] = _FORCE_N * push
    truth[ts.F_C1, during] = 1.0
    truth[ts.V_P, during] = -1e-3 * push
    truth[ts.XI_P, during] = -1e-8 * push
    return truth


def _run_exchange(setup: "Setup", folder: Path) -> None:
    from hertzloop.loop.in_process import record_in_process

    record_in_process(setup, folder / "exchange.mcap", compiled=False)


def _run_loop(setup: "Setup", folder: Path) -> None:
    from hertzloop.loop.in_process import record_in_process
    from hertzloop.loop.simulate import simulate
    from hertzloop.results.metrics import metrics_of

    record_in_process(setup, folder / "loop.mcap", compiled=True)
    metrics_of(setup, simulate(setup).truth)


def _run_results(setup: "Setup", folder: Path) -> None:
    from hertzloop.results.metrics import metrics_of

    metrics_of(setup, free_series(setup))


# What compiles every kernel of a work.
_RUN: dict[Work, Callable[["Setup", Path], None]] = {
    Work.EXCHANGE: _run_exchange,
    Work.LOOP: _run_loop,
    Work.RESULTS: _run_results,
}
