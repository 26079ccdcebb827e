"""What Kirchhoff's theory leaves out: impacts on thin plates and on the same plates as solids."""

import math
from dataclasses import dataclass

from hertzloop.setup import Setup
from plant.estimates.plate_theory import thickness_number, zener_inelasticity
from plant.schemes.collocation import CollocationPlant
from studies.plate_models import runs

_OFF = "controller.law=off"
# Name, changes of the scene, length of the run (s).
_CASES: dict[str, tuple[str, list[str], float]] = {
    "h 1.5, R 3 mm": ("aluminium-3mm", ["plate.thickness_m=0.0015"], 80e-6),
    "h 3, R 3 mm": ("aluminium-3mm", [], 45e-6),
    "h 6, R 4 mm, off centre": (
        "aluminium-3mm",
        [
            "plate.thickness_m=0.006",
            "sphere.radius_m=0.004",
            "plate.size_m=[0.6, 0.4]",
            "plate.contact_point_m=[0.22, 0.17]",
            "sphere.drop_height_m=0.119",
        ],
        50e-6,
    ),
    "h 10, R 5 mm": ("aluminium-3mm", ["plate.thickness_m=0.01", "sphere.radius_m=0.005"], 70e-6),
    "h 3, R 20 mm": ("aluminium-20mm", [], 2.5e-3),
}


@dataclass(frozen=True)
class Effect:
    """What thickness does to a first impact without control, relative to Kirchhoff's plate: plate
    energy, rebound over impact speed, peak force, contact time; what was expected before as its
    largest; both criteria; frequencies at the scene's accuracy, and the ratio of a step's time."""

    case: str
    k_h: float
    inelasticity: float
    plate_energy: float
    rebound: float
    peak_force: float
    contact_time: float
    expected: float
    frequencies: int
    frequencies_3d: int
    step_us: float
    times_as_long: float
    residual: float


def _scenes(name: str) -> tuple[Setup, Setup]:
    source, settings, lasts_s = _CASES[name]
    cut = [*settings, _OFF, f"run.duration_s={lasts_s}"]
    thin, solid = (
        runs.first_contact(source, [*cut, f"plate.theory={theory}"])
        for theory in ("kirchhoff", "3d")
    )
    return thin, solid


def effects(names: tuple[str, ...] | None = None, *, timed: bool = True) -> list[Effect]:
    """All cases, or those named; both theories with the modes that their accuracy asks for."""
    found = []
    for name in names or tuple(_CASES):
        thin_scene, solid_scene = _scenes(name)
        thin, solid = runs.run(thin_scene), runs.run(solid_scene)
        spec = thin_scene.plant
        plate = thin_scene.bodies.local_plate
        step_us, ratio = math.nan, math.nan
        if timed:
            step_us, ratio = runs.cost_ratios(
                CollocationPlant(spec), CollocationPlant(solid_scene.plant)
            )
        found.append(
            Effect(
                name,
                thickness_number(plate, solid.impact.duration_s),
                zener_inelasticity(spec.sphere, plate, spec.contact),
                *runs.changes(solid.impact, thin.impact),
                thin_scene.thin_plate_error.largest,
                thin.frequencies,
                solid.frequencies,
                step_us,
                ratio,
                max(thin.residual, solid.residual),
            )
        )
    return found
