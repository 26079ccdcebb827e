"""Compile all that a scene runs before it runs; later processes load it from the cache."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hertzloop.common.jit.folder import cache_folder, has_room, types_digest
from hertzloop.common.jit.progress import report_functions
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.setup import Setup, parse
from hertzloop.scene.toml import to_toml

Progress = Callable[[float, str], None]  # is told the finished share, and what is compiled

_PAST_TOUCH_S = 1e-3  # long enough for the metrics of an impact, where that is short
_MOST_STEPS = 20_000  # of that moment, some tenths of a second
_KERNELS = 77  # of hertzloop that are compiled for the default scene


def _silent(share: float, what: str) -> None:
    """No progress to tell anybody."""


def anything_compiled() -> bool:
    """Whether an earlier call has filled the cache with the kernels of some scene."""
    return any(cache_folder().glob(".compiled-*"))


def not_compiled(*scenes: Setup) -> dict[Path, Setup]:
    """Return a scene for each kind of scenes whose kernels are not in the cache, by the file that
    says so once they are. Raises SceneError."""
    marked = {_marker(setup): setup for setup in reversed(scenes)}
    return {marker: setup for marker, setup in marked.items() if not marker.exists()}


def ensure_compiled(*scenes: Setup, on_progress: Progress = _silent) -> None:
    """Run each of the scenes for a moment without its law, unless that was done for its kernels
    before.

    Args:
        scenes: the scenes.
        on_progress: is told how far it is.

    Raises:
        SceneError: a scene cannot be built.
    """
    missing = not_compiled(*scenes)
    done = 0

    def count(name: str) -> None:
        nonlocal done
        done += 1
        on_progress(min(done / (_KERNELS * len(missing)), 1.0), name)

    for marker, setup in missing.items():
        with report_functions(count):
            _run_all(_moment_of(setup))
        with suppress(OSError):  # the disk may not take it
            if has_room():
                marker.touch()


def _marker(setup: Setup) -> Path:
    """A file named by the types that kernels are compiled for. Those of a controller are the same
    for every law and signal path."""
    plant, sensor = build_plant(setup), build_sensor(setup)
    types = types_digest(plant.model, plant.state, sensor.model, sensor.state)
    return cache_folder() / f".compiled-{types}"


def _moment_of(setup: Setup) -> Setup:
    """A scene that runs the same kernels, until just after the first touch."""
    # How long a run lasts may decide about the model of its plate.
    setup = setup.without_control().with_plate_model(setup.plate_model)
    setup = parse(to_toml(setup.scene))  # without what other laws have to be told
    steps = round((setup.first_touch_s + _PAST_TOUCH_S) / setup.run.step_s)
    return setup.with_steps(max(1, min(steps, setup.run.steps, _MOST_STEPS)))


def _run_all(setup: Setup) -> None:
    """Run a scene between a plant and a controller, and in one loop, and compute its metrics."""
    from hertzloop.loop.in_process import record_in_process
    from hertzloop.loop.run_options import RunOptions
    from hertzloop.loop.simulate import simulate
    from hertzloop.results.metrics import metrics_of

    record_in_process(setup, Path(os.devnull), RunOptions(overwrite=True), compiled=False)
    metrics_of(setup, simulate(setup).truth)
    setup.infinite_plate.lasts_s()
