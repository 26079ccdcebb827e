"""Compile all that a scene runs before it runs; later processes load it from the cache."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from bus.own_folder import own_folder
from jit.cache import cache_folder

if TYPE_CHECKING:
    from hertzloop.scenes.scene import Scene

_OF_SCHEME = {"thesis2008": "thesis-aluminium"}  # a scheme that the default scene does not fit
_PAST_TOUCH_S = 1e-3  # long enough for the figures of an impact, where that is short
_MOST_STEPS = 20_000  # of that moment, some tenths of a second


def anything_compiled() -> bool:
    """Whether an earlier call has filled the cache with the kernels of some scene."""
    return any(cache_folder().glob(".compiled-*"))


def of_scheme(scheme: str) -> "Scene":
    """A scene that runs the kernels of a scheme."""
    from hertzloop.scenes.scene import DEFAULT, load

    return load(_OF_SCHEME.get(scheme, DEFAULT), [f"run.scheme={scheme}"])


def _default() -> list["Scene"]:
    from hertzloop.scenes.scene import DEFAULT, load

    return [load(DEFAULT, [f"run.plate_model={model}"]) for model in ("modal", "infinite")]


def _marker(scene: "Scene", paced: bool) -> Path:
    """A file that is there once all is compiled for a scene: it is named after the types that
    kernels are compiled for. Those of a controller are the same for every law and line."""
    from hertzloop import assembly as parts
    from jit.compiling import types_digest

    plant, sensor = parts.plant(scene), parts.sensor(scene)
    types = types_digest(plant.model, plant.state, sensor.model, sensor.state)
    return cache_folder() / f".compiled-{types}{'-paced' * paced}"


def is_compiled(scene: "Scene", paced: bool = False) -> bool:
    """Whether all kernels that the scene runs are in the cache."""
    return _marker(scene, paced).exists()


def ensure_compiled(announce: Callable[[], None], *scenes: "Scene", paced: bool = False) -> None:
    """Run each of the scenes for a moment without its law, unless that was done for its kernels
    before; calls `announce` first. Without `scenes` the default one, with each model of its plate;
    with `paced` the kernels of paced mode, too. Raises SceneError."""
    for scene in scenes or _default():
        for marker, run in ((_marker(scene, False), _run), (_marker(scene, True), _run_paced)):
            if marker.exists() or (run is _run_paced and not paced):
                continue
            announce()
            with own_folder() as folder:
                run(_moment_of(scene), Path(folder))
            marker.touch()


def _moment_of(scene: "Scene") -> "Scene":
    """A scene that runs the same kernels, until just after the first touch."""
    from hertzloop import assembly as parts
    from hertzloop.results.cases import lasting, on_plate
    from hertzloop.scenes.scene import parse, to_toml

    # How long a run lasts may decide about the model of its plate.
    scene = on_plate(scene.without_control(), parts.plate_model(scene))
    scene = parse(to_toml(scene))  # without what other laws have to be told
    steps = round((parts.first_touch_s(scene) + _PAST_TOUCH_S) / scene.step_s)
    return lasting(scene, max(1, min(steps, scene.steps, _MOST_STEPS)))


def _run(scene: "Scene", folder: Path) -> None:
    """A run through each port compiles every kernel that any of them calls."""
    from hertzloop.loop.compiled import simulate, uncontrolled_rows
    from hertzloop.loop.inprocess import record_in_process
    from hertzloop.results.figures import figures_of
    from hertzloop.results.model_cost import chosen_model

    record_in_process(scene, folder / "a.mcap", compiled=False)
    record_in_process(scene, folder / "b.mcap", compiled=True)
    chosen_model(scene)
    figures_of(scene, uncontrolled_rows(scene))
    figures_of(scene, simulate(scene).rows)


def _run_paced(scene: "Scene", folder: Path) -> None:
    from bus.inprocess import InProcessBus, InProcessPort
    from bus.streams import PLANT
    from hertzloop.loop.paced import PacedPlantNode

    PacedPlantNode(scene, InProcessPort(InProcessBus(), PLANT), pace=1.0)
