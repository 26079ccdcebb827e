"""Compile all kernels once; later processes load them from the cache."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from controller.door.registry import shipped
from jit.cache import cache_folder

if TYPE_CHECKING:
    from hertzloop.scenes.scene import Scene

OWN_LOSSES = "modal-own-losses"
RADIATING = "modal-radiating"
SPRING_TAIL = "modal-spring-tail"
_SCENES = {"thesis2008": "thesis-aluminium"}  # of a scheme that the default scene does not fit
_NEEDED = {
    "constant": ["controller.duration_us=1"],
    "profile": ["controller.profile_n=[1.0]"],
    "precomputed": ["controller.precomputed=F_mobility"],
}
_MODELS = {"modal": ("modal", "infinite")}  # run.plate_model, where there is a choice
_SHORT = "run.duration_s=0.0015"
_TWO_LOSSES = """# residual_flexibility_m_n = 1e-8
frequency_hz,loss_factor,modal_mass_kg,shape_contact
30000,0.01,1,1
90000,0.02,1,1
"""


def kernels_of(scene: "Scene") -> str:
    """Which kernels a scene runs: those of its scheme, or where every mode has a loss factor of its
    own, loses energy to air, or the modes left out are a spring, those for that."""
    from hertzloop import assembly as parts
    from hertzloop.struck import structure
    from plant.structures.modal_structure import ModalStructure

    if scene.plate.radiating_faces:
        return RADIATING
    what = structure(scene)
    if isinstance(what, ModalStructure) and np.ptp(what.table.loss_factor) > 0.0:
        return OWN_LOSSES
    spec = parts.plant_spec(scene)
    modal = scene.run.scheme == "modal" and not spec.infinite_plate
    return SPRING_TAIL if modal and not spec.damped_tail else scene.run.scheme


def _marker(kernels: str) -> Path:
    return cache_folder() / f".compiled-{kernels}"


def is_compiled(kernels: str = "modal") -> bool:
    """Whether an earlier call has filled the cache with these kernels; see `kernels_of`."""
    return _marker(kernels).exists()


def ensure_compiled(
    announce: Callable[[], None], kernels: str = "modal", paced: bool = False
) -> None:
    """Run every kernel for a moment if the cache is empty, those of paced mode if they are asked
    for; calls `announce` before."""
    wanted = [(kernels, _compile)] + [(f"{kernels}-paced", _compile_paced)] * paced
    missing = [(marker, compiled) for marker, compiled in wanted if not is_compiled(marker)]
    if missing:
        announce()
    for marker, compiled in missing:
        # A run through each port compiles every kernel that any of them calls.
        for model in _MODELS.get(kernels, ("modal",)):
            with TemporaryDirectory() as folder:
                compiled(_scene_with(kernels, model, Path(folder)), Path(folder))
        _marker(marker).touch()


def _scene_with(kernels: str, model: str, folder: Path) -> "Scene":
    """A scene of a moment that runs these kernels."""
    from hertzloop.scenes.scene import DEFAULT, load

    if kernels == OWN_LOSSES:
        modes = folder / "modes.csv"
        modes.write_text(_TWO_LOSSES, encoding="utf-8")
        settings = [f"plate.modes='{modes}'"]
    elif kernels == RADIATING:
        settings = ["plate.radiation=one_face"]
    elif kernels == SPRING_TAIL:
        settings = ["plate.loss_factor=0.01", "plate.tail=spring"]
    else:
        settings = ["plate.loss_factor=0.01", f"run.scheme={kernels}", f"run.plate_model={model}"]
    return load(_SCENES.get(kernels, DEFAULT), [_SHORT, *settings])


def _compile(scene: "Scene", folder: Path) -> None:
    from hertzloop import control
    from hertzloop.loop.compiled import simulate
    from hertzloop.loop.inprocess import record_in_process
    from hertzloop.results.figures import figures_of
    from hertzloop.results.model_cost import chosen_model
    from hertzloop.scenes.scene import DEFAULT, load

    record_in_process(scene, folder / "a.mcap", compiled=False)
    record_in_process(scene, folder / "b.mcap", compiled=True)
    chosen_model(scene)
    figures_of(scene, simulate(scene).rows)
    # Every shipped law, each a moment's work.
    for law in shipped():
        own = _NEEDED.get(law, [])
        control.law(load(DEFAULT, [_SHORT, *own, f"controller.law={law}"]), 1e10)


def _compile_paced(scene: "Scene", folder: Path) -> None:
    from bus.inprocess import InProcessBus, InProcessPort
    from bus.streams import PLANT
    from hertzloop.loop.paced import PacedPlantNode

    PacedPlantNode(scene, InProcessPort(InProcessBus(), PLANT), pace=1.0)
