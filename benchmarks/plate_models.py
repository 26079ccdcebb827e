"""What the thickness of a plate does to first impacts, and what steps of a solid plate cost."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.timing import in_turn, timed
from hertzloop.loop.simulate import simulate
from hertzloop.plant.estimates.plate_theory import thickness_number
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.state_kernels import F_C
from hertzloop.plant.time_series import series_under
from hertzloop.scene.setup import Setup, load

_ROUNDS, _STEPS = 201, 400  # of the timing; the plants take turns


def run(setup: Setup) -> tuple[Impact, int]:
    """The first impact of a scene in its closed loop, and the number of frequencies."""
    plant = CollocationPlant(setup.plant)
    done = simulate(setup, own_plant=plant)
    return impacts_in(setup.plant, done.truth)[0], len(plant.modes.omega)


def changes(run: Impact, best: Impact) -> tuple[float, float, float, float]:
    """Of plate energy, rebound over impact speed, peak force and contact time, relative."""
    return (
        run.plate_energy_j / best.plate_energy_j - 1.0,
        (run.rebound_speed_m_s - best.rebound_speed_m_s) / best.impact_speed_m_s,
        run.peak_force_n / best.peak_force_n - 1.0,
        run.duration_s / best.duration_s - 1.0,
    )


def _in_contact(plant: Plant) -> Callable[[], float]:
    """A measurement: us of a step, from the touch on."""
    while plant.state.body[F_C] == 0.0:
        series_under(plant, np.zeros(1))
    started = [array.copy() for array in plant.state]

    def measure() -> float:
        for array, kept in zip(plant.state, started, strict=True):
            array[:] = kept
        return timed(lambda: series_under(plant, np.zeros(_STEPS)), _STEPS)

    return measure


def first_contact(name: str, settings: list[str]) -> Setup:
    """A scene cut to what its first contact needs, the plate by its modes."""
    return load(name, ["run.lead_in_s=2.5e-6", "run.plate_model=modal", *settings])


_OFF = "controller.law=off"
# Name, changes of the scene, length of the run (s).
_THEORY_CASES: dict[str, tuple[str, list[str], float]] = {
    "h 1.5, R 3 mm": ("aluminium-3mm", ["plate.thickness_m=0.0015"], 80e-6),
    "h 3, R 3 mm": ("aluminium-3mm", [], 45e-6),
    "h 10, R 5 mm": ("aluminium-3mm", ["plate.thickness_m=0.01", "sphere.radius_m=0.005"], 70e-6),
}


@dataclass(frozen=True)
class Effect:
    """What thickness does to a first impact without control, relative to Kirchhoff's plate: plate
    energy, rebound over impact speed, peak force, contact time; frequencies at the scene's
    accuracy, and the ratio of a step's time."""

    case: str
    k_h: float
    plate_energy: float
    rebound: float
    peak_force: float
    contact_time: float
    frequencies: int
    frequencies_3d: int
    step_us: float
    times_as_long: float


def _scenes(name: str) -> tuple[Setup, Setup]:
    source, settings, lasts_s = _THEORY_CASES[name]
    cut = [*settings, _OFF, f"run.duration_s={lasts_s}"]
    thin, solid = (
        first_contact(source, [*cut, f"plate.theory={theory}"]) for theory in ("kirchhoff", "3d")
    )
    return thin, solid


def effects(names: tuple[str, ...] | None = None) -> list[Effect]:
    """All cases, or those named; both theories with the modes that their accuracy asks for."""
    found = []
    for name in tracked("plate theory", names or tuple(_THEORY_CASES)):
        thin_scene, solid_scene = _scenes(name)
        (thin, thin_modes), (solid, solid_modes) = run(thin_scene), run(solid_scene)
        spec = thin_scene.plant
        plate = thin_scene.mechanics.local_plate
        plants = {"thin": CollocationPlant(spec), "solid": CollocationPlant(solid_scene.plant)}
        costs = in_turn({name: _in_contact(one) for name, one in plants.items()}, _ROUNDS)
        found.append(
            Effect(
                name,
                thickness_number(plate, solid.duration_s),
                *changes(solid, thin),
                thin_modes,
                solid_modes,
                costs[0].least_us,
                costs[1].least_us / costs[0].least_us,
            )
        )
    return found


_QUICK = ("h 3, R 3 mm",)


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Compare the three-dimensional plate with Kirchhoff's: first impacts, and time a step.

    Example: python -m benchmarks.plate_models --quick
    """
    with results_in(folder, "plate_models", "modal") as results:
        found = effects(_QUICK if quick else None)
        results.write("plate_theory", found)
        results.table(
            "Three dimensions against Kirchhoff: changes, modes, us a step",
            {
                "impact": "{.case}",
                "kh": "{.k_h:.2f}",
                "energy": "{.plate_energy:+.1e}",
                "rebound": "{.rebound:+.1e}",
                "peak": "{.peak_force:+.1e}",
                "time": "{.contact_time:+.1e}",
                "modes": "{.frequencies}",
                "3-D": "{.frequencies_3d}",
                "us": "{.step_us:.3g}",
                "times": "{.times_as_long:.2f}",
            },
            found,
        )
        least, most = (pick(e.times_as_long for e in found) for pick in (min, max))
        results.conclude(
            f"In three dimensions the plate energy changes by up to "
            f"{max(abs(e.plate_energy) for e in found):.1e}, and a step takes {least:.2f} to "
            f"{most:.2f} times as long."
        )


if __name__ == "__main__":
    start("benchmarks.plate_models")
