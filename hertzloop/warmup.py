"""Compile all that a scene runs before it runs; later processes load it from the cache."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hertzloop.bus.port import InProcessBus, InProcessPort
from hertzloop.bus.sockets import own_folder
from hertzloop.bus.streams import CONTROLLER, PLANT
from hertzloop.common.jit.folder import cache_folder
from hertzloop.common.jit.progress import report_functions
from hertzloop.common.jit.storage import all_written, types_digest
from hertzloop.processes.signals import end_with_parent
from hertzloop.scene.build import build_plant, build_sensor, free_series
from hertzloop.scene.controller import build_controller
from hertzloop.scene.toml import to_toml

if TYPE_CHECKING:
    from hertzloop.scene.setup import Setup

Progress = Callable[[float, str], None]  # is told the finished share, and what is compiled

_PAST_TOUCH_S = 1e-3  # long enough for the metrics of an impact, where that is short
_MOST_STEPS = 20_000  # of that moment, some tenths of a second
_PLANT_KERNELS = 130  # compiled for the plant of the default scene, parts of others included
_PLANT_SHARE = 0.95  # of the time that passes
# Of the made-up contact: the steps before it, of it and of all, and the force.
_BEFORE, _CONTACT, _ROWS, _FORCE_N = 50, 30, 2000, 100.0


def _silent(share: float, what: str) -> None:
    """No progress to tell anybody."""


def anything_compiled() -> bool:
    """Whether an earlier call has filled the cache with the kernels of some scene."""
    return any(cache_folder().glob(".compiled-*"))


def all_compiled(*scenes: "Setup", paced: bool = False) -> bool:
    """Whether `ensure_compiled` has nothing left to do. Raises SceneError."""
    return not _missing(scenes, paced)


def ensure_compiled(*scenes: "Setup", paced: bool = False, on_progress: Progress = _silent) -> None:
    """Run each of the scenes for a moment without its law, unless that was done for its kernels
    before. Without `scenes` the default one, with each model of its plate; with `paced` the kernels
    of paced mode, too. Raises SceneError."""
    missing = _missing(scenes, paced)
    for number, (marker, setup, run) in enumerate(missing):

        def tell(share: float, what: str, number: int = number) -> None:
            on_progress((number + share) / len(missing), what)

        moment = _moment_of(setup)
        if run is _run:
            _compile_at_once(moment, tell)
        with own_folder() as folder:
            run(moment, Path(folder))
        _mark(marker)
    if not scenes and not _usual(paced).exists():
        _mark(_usual(paced))


def _missing(
    scenes: Sequence["Setup"], paced: bool
) -> list[tuple[Path, "Setup", Callable[["Setup", Path], None]]]:
    """What is not compiled: the marker, a scene that has it, and what runs all of it."""
    found: dict[Path, tuple[Path, Setup, Callable[[Setup, Path], None]]] = {}
    # To name the marker of a scene takes its modes: a twentieth of a short sweep.
    if not scenes and _usual(paced).exists():
        return []
    for setup in scenes or _default():
        for of_paced, run in [(False, _run), (True, _run_paced)][: 1 + paced]:
            marker = _marker(setup, of_paced)
            if not marker.exists():
                found.setdefault(marker, (marker, setup, run))
    return list(found.values())


def _default() -> list["Setup"]:
    from hertzloop.scene.loading import DEFAULT
    from hertzloop.scene.setup import load

    return [load(DEFAULT, [f"run.plate_model={model}"]) for model in ("modal", "infinite")]


def _usual(paced: bool) -> Path:
    """A file that is there once all is compiled for the default scene."""
    return cache_folder() / f".compiled-usual{'-paced' * paced}"


def _marker(setup: "Setup", paced: bool) -> Path:
    """A file that is there once all is compiled for a scene: it is named after the types that
    kernels are compiled for. Those of a controller are the same for every law and line."""
    plant, sensor = build_plant(setup), build_sensor(setup)
    types = types_digest(plant.model, plant.state, sensor.model, sensor.state)
    return cache_folder() / f".compiled-{types}{'-paced' * paced}"


def _mark(marker: Path) -> None:
    """Note that all is in the cache, if the disk has taken it."""
    with suppress(OSError):
        if all_written():
            marker.touch()


def _moment_of(setup: "Setup") -> "Setup":
    """A scene that runs the same kernels, until just after the first touch."""
    from hertzloop.scene.setup import parse

    # How long a run lasts may decide about the model of its plate.
    setup = setup.without_control().with_plate_model(setup.plate_model)
    setup = parse(to_toml(setup.scene))  # without what other laws have to be told
    steps = round((setup.first_touch_s + _PAST_TOUCH_S) / setup.step_s)
    return setup.with_steps(max(1, min(steps, setup.steps, _MOST_STEPS)))


def _compile_at_once(setup: "Setup", tell: Progress) -> None:
    """Compile the kernels of the plant here, and those of metrics and controller meanwhile in a
    process of its own, if there is a second core."""
    tell(0.0, "the plant")
    done, what = 0, "the plant"

    def count(name: str) -> None:
        nonlocal done, what
        done += 1
        what = f"the plant: {name}" if name else what
        tell(_PLANT_SHARE * min(done / _PLANT_KERNELS, 1.0), what)

    beside = _start_beside(setup) if len(os.sched_getaffinity(0)) > 1 else None
    try:
        with report_functions(count):
            _compile_plant(setup)
        tell(_PLANT_SHARE, "metrics and controller")
    except BaseException:
        if beside:
            beside.kill()
        raise
    finally:
        if beside:
            beside.wait()


def _compile_plant(setup: "Setup") -> None:
    from hertzloop.loop.plant_node import PlantNode
    from hertzloop.loop.simulate import simulate
    from hertzloop.scene import model_error

    PlantNode(setup, InProcessPort(InProcessBus(), PLANT))
    next(free_series(setup))
    simulate(setup)
    model_error.infinite_plate_lasts_s(setup)


def _start_beside(setup: "Setup") -> subprocess.Popen[str]:
    """A process that runs `_compile_beside`. What it fails to compile, `_run` compiles."""
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
    with suppress(BrokenPipeError), process.stdin as scene:  # it may have failed
        scene.write(to_toml(setup.scene))
    return process


def _compile_beside(parent: int) -> None:
    """Compile the kernels of metrics and controller for the scene that is read.

    Ends with the process `parent`, which may exit at once on a signal.
    """
    end_with_parent()
    if os.getppid() != parent:  # it has ended while this process imported
        return
    from hertzloop.loop.controller_node import ControllerNode
    from hertzloop.results.metrics import metrics_of
    from hertzloop.scene.setup import parse

    setup = parse(sys.stdin.read())
    ControllerNode(InProcessPort(InProcessBus(), CONTROLLER))
    build_controller(setup, ahead=False).process(np.ones(2))
    metrics_of(setup, _made_up_contact(setup))


def _made_up_contact(setup: "Setup") -> np.ndarray:
    """Truth, shape (10, steps), of a contact that no plant has made."""
    from hertzloop.plant import time_series as ts

    truth = np.zeros((ts.COLUMNS, _ROWS))
    during = slice(_BEFORE, _BEFORE + _CONTACT)
    push = np.sin(np.pi * (np.arange(_CONTACT) + 0.5) / _CONTACT)
    speed_m_s = setup.sphere.impact_speed_m_s
    steps_away = np.arange(_ROWS) - _BEFORE
    steps_away = np.where(steps_away < 0, -steps_away, np.maximum(steps_away - _CONTACT, 0))
    truth[ts.XI] = truth[ts.XI_S] = speed_m_s * setup.step_s * steps_away
    truth[ts.XI, during] = truth[ts.XI_S, during] = -1e-6 * push
    truth[ts.F_C, during] = _FORCE_N * push
    truth[ts.F_C1, during] = 1.0
    truth[ts.V_P, during] = -1e-3 * push
    truth[ts.XI_P, during] = -1e-8 * push
    return truth


def _run(setup: "Setup", folder: Path) -> None:
    """A run through each port compiles every kernel that any of them calls."""
    from hertzloop.loop.in_process import record_in_process
    from hertzloop.loop.simulate import simulate
    from hertzloop.results.metrics import metrics_of
    from hertzloop.results.model import chosen_model

    record_in_process(setup, folder / "a.mcap", compiled=False)
    record_in_process(setup, folder / "b.mcap", compiled=True)
    chosen_model(setup)
    metrics_of(setup, free_series(setup))
    metrics_of(setup, simulate(setup).truth)


def _run_paced(setup: "Setup", folder: Path) -> None:
    from hertzloop.loop.paced import PacedPlantNode

    PacedPlantNode(setup, InProcessPort(InProcessBus(), PLANT), pace=1.0)
