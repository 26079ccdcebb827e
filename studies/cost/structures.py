"""What a plate costs that is given by its modes: what its modes cost, not what its file does."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop.analysis.deflection import modes_of_scene
from hertzloop.setup import load
from plant.schemes.collocation import CollocationPlant
from plant.structures.mode_file import ModeTable, write_modes
from studies.cost.baseline import ROUNDS, Cost, in_turn, plant_case, two_pass_case

_SCENE, _SETTINGS = "aluminium-20mm", ["run.accuracy=1e-3", "run.lead_in_s=0"]
_FEW = 100


def _lowest(table: ModeTable, count: int) -> ModeTable:
    """The `count` lowest modes of a table."""
    names = ("omega_rad_s", "loss_factor", "per_modal_mass_1_kg", "shape_contact", "shape_actuator")
    return replace(table, **{name: getattr(table, name)[:count] for name in names})


def mode_file_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per step of `aluminium-20mm` in closed form, by a file of all its modes, and by one of the
    lowest 100; yardstick: a plain two-pass loop over 100 frequencies."""
    setup = load(_SCENE, _SETTINGS)
    table = modes_of_scene(setup)
    cases: dict[str, Callable[[], float]] = {
        f"two-pass loop, {_FEW} frequencies": two_pass_case(_FEW)
    }
    with TemporaryDirectory() as folder:
        scenes = {"closed form": setup}
        for words, modes in (("file of all modes", table), ("file", _lowest(table, _FEW))):
            file = Path(folder) / f"{len(modes.omega_rad_s)}.npz"
            file.write_bytes(write_modes(".npz", modes))
            scenes[words] = load(_SCENE, [*_SETTINGS, f"plate.modes={file}"])
        for words, one in scenes.items():
            for name, contact in (("flight", False), ("contact", True)):
                plant = CollocationPlant(one.plant)
                case = f"{words}, {name}, {len(plant.modes.omega)} frequencies"
                cases[case] = plant_case(plant, contact=contact)
        return in_turn(cases, rounds)
