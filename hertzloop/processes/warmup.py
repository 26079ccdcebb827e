"""Compile all that a scene runs before it runs; later processes load it from the cache."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from hertzloop.bus.sockets import own_folder
from hertzloop.bus.streams import PLANT
from hertzloop.jit.cache import all_kept, cache_folder, types_digest
from hertzloop.scenes.writing import to_toml
from hertzloop.setup import parts

if TYPE_CHECKING:
    from hertzloop.setup import Setup

_PAST_TOUCH_S = 1e-3  # long enough for the figures of an impact, where that is short
_MOST_STEPS = 20_000  # of that moment, some tenths of a second


def anything_compiled() -> bool:
    """Whether an earlier call has filled the cache with the kernels of some scene."""
    return any(cache_folder().glob(".compiled-*"))


def _default() -> list["Setup"]:
    from hertzloop.setup import DEFAULT, load

    return [load(DEFAULT, [f"run.plate_model={model}"]) for model in ("modal", "infinite")]


def _marker(setup: "Setup", paced: bool) -> Path:
    """A file that is there once all is compiled for a scene: it is named after the types that
    kernels are compiled for. Those of a controller are the same for every law and line."""
    plant, sensor = parts.start_plant(setup), parts.start_sensor(setup)
    types = types_digest(plant.model, plant.state, sensor.model, sensor.state)
    return cache_folder() / f".compiled-{types}{'-paced' * paced}"


def ensure_compiled(announce: Callable[[], None], *scenes: "Setup", paced: bool = False) -> None:
    """Run each of the scenes for a moment without its law, unless that was done for its kernels
    before; calls `announce` first. Without `scenes` the default one, with each model of its plate;
    with `paced` the kernels of paced mode, too. Raises SceneError."""
    # To name the marker of a scene takes its modes: a twentieth of a short sweep.
    usual = cache_folder() / f".compiled-usual{'-paced' * paced}"
    if not scenes and usual.exists():
        return
    for setup in scenes or _default():
        for marker, run in ((_marker(setup, False), _run), (_marker(setup, True), _run_paced)):
            if marker.exists() or (run is _run_paced and not paced):
                continue
            announce()
            with own_folder() as folder:
                run(_moment_of(setup), Path(folder))
            _mark(marker)
    if not scenes:
        _mark(usual)


def _mark(marker: Path) -> None:
    """Note that all is in the cache, if the disk has taken it."""
    with suppress(OSError):
        if all_kept():
            marker.touch()


def _moment_of(setup: "Setup") -> "Setup":
    """A scene that runs the same kernels, until just after the first touch."""
    from hertzloop.setup import parse

    # How long a run lasts may decide about the model of its plate.
    setup = setup.without_control().on_plate(setup.plate_model)
    setup = parse(to_toml(setup.scene))  # without what other laws have to be told
    steps = round((setup.first_touch_s + _PAST_TOUCH_S) / setup.step_s)
    return setup.lasting(max(1, min(steps, setup.steps, _MOST_STEPS)))


def _run(setup: "Setup", folder: Path) -> None:
    """A run through each port compiles every kernel that any of them calls."""
    from hertzloop.analysis.figures import figures_of
    from hertzloop.analysis.model import chosen_model
    from hertzloop.loop.compiled import record_in_process, simulate

    record_in_process(setup, folder / "a.mcap", compiled=False)
    record_in_process(setup, folder / "b.mcap", compiled=True)
    chosen_model(setup)
    figures_of(setup, parts.free_series(setup))
    figures_of(setup, simulate(setup).rows)


def _run_paced(setup: "Setup", folder: Path) -> None:
    from hertzloop.bus.port import InProcessBus, InProcessPort
    from hertzloop.loop.paced import PacedPlantNode

    PacedPlantNode(setup, InProcessPort(InProcessBus(), PLANT), pace=1.0)
