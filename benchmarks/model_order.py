"""Does the automatic choice of modes meet what was asked? Scenes drawn at random.

The first impact without control, of the default scheme at 1 us, is compared with twice the modes
that any request chose and half the step. Each error is relative: that of the gap to its largest
value in contact, that of the rebound speed to the impact speed, that of the plate energy to the
plate energy of the comparison.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    ScenesOption,
    SeedOption,
    share,
    start,
)
from benchmarks.random_scenes import drawn
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.prepare import compile_first
from hertzloop.cli.terminal import out
from hertzloop.closed_loop.parts import series_under
from hertzloop.plant.contact.hertz import Contact, Sphere, hertz_stiffness, rigid_contact_time_s
from hertzloop.plant.estimates.model_order import frequency_limit_hz
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.plate_model import NEAREST
from hertzloop.studies.pages import pictures

REQUESTS = (1e-2, 1e-3, 1e-4)
_STEP_S = 1e-6
_MOST_MODES = 6000.0  # up to 1/(2 step): keeps a scene within seconds
_RATIO = 2.0**0.25  # between the limits tried for the cheapest one


@dataclass(frozen=True)
class Outcome:
    """One scene under one request: what was chosen, the true errors, and the cost in modes
    against the fewest that meet the request."""

    scene: int
    material: str
    radius_mm: float
    request: float
    limit_khz: float
    frequencies: int
    gap_error: float
    rebound_error: float
    energy_error: float
    times_cheapest: float
    capped: bool  # the step cannot carry the modes that the request needs

    @property
    def error(self) -> float:
        """Largest of the three."""
        return max(self.gap_error, self.rebound_error, self.energy_error)


def random_spec(random: np.random.Generator) -> PlantSpec:
    """A sphere on a plate: steel, aluminium, oak or Sylomer, 1 to 25 mm, any point."""
    while True:
        material = MATERIALS[str(random.choice(["aluminium", "steel", "oak", "sylomer_m"]))]
        radius = 10.0 ** random.uniform(-3.0, -1.6)
        size = (float(random.uniform(0.15, 0.8)), float(random.uniform(0.15, 0.8)))
        plate = Plate(material, size, float(10.0 ** random.uniform(-3.0, -1.9)))
        steel = MATERIALS["steel"]
        sphere = Sphere(steel, radius, float(10.0 ** random.uniform(-2.5, -0.3)))
        point = tuple(float(s * random.uniform(0.1, 0.9)) for s in size)
        density = math.sqrt(plate.mass_per_area_kg_m2 / plate.bending_stiffness_n_m)
        modes = density / (4.0 * math.pi) * size[0] * size[1] * math.pi / _STEP_S
        if modes <= _MOST_MODES:
            contact = Contact(hertz_stiffness(radius, steel, material))
            at = (point[0], point[1])
            return PlantSpec(
                sphere,
                plate,
                contact,
                at,
                at,
                _STEP_S,
                0.5 / _STEP_S,
                0.0,
                residual_flexibility=True,
            )


def _first_impact(spec: PlantSpec, duration_s: float) -> tuple[np.ndarray, Impact | None, int]:
    """Gap after every us, the first impact, and the number of oscillators."""
    plant = ModalPlant(spec)
    every = round(_STEP_S / spec.step_s)
    steps = every * round(duration_s / _STEP_S)
    rows = series_under(plant, np.zeros(steps))
    found = impacts_in(spec, rows)
    return rows[0, ::every], found[0] if found else None, len(plant.modes.omega)


def _limited(spec: PlantSpec, limit_hz: float) -> PlantSpec:
    """With modes up to a limit, and what a run takes for those beyond."""
    away = spec.simply_supported.wavelengths_to_edge(spec.contact_point_m, limit_hz)
    return replace(spec, frequency_limit_hz=limit_hz, damped_residual=away >= NEAREST)


def _errors(
    gap: np.ndarray, impact: Impact, ref: np.ndarray, best: Impact
) -> tuple[float, float, float]:
    end = math.ceil((best.start_s + best.duration_s) / _STEP_S) + 1
    change = abs(impact.rebound_speed_m_s - best.rebound_speed_m_s) / best.impact_speed_m_s
    energy = abs(impact.plate_energy_j - best.plate_energy_j) / abs(best.plate_energy_j)
    return float(np.abs(gap - ref)[:end].max() / -ref[:end].min()), change, energy


def outcomes(number: int, random: np.random.Generator) -> list[Outcome]:
    """All requests of the next random scene; empty if its contact lasts beyond 4 ms."""
    spec = random_spec(random)
    sphere = spec.sphere
    rigid = rigid_contact_time_s(sphere.mass_kg, spec.contact.stiffness, sphere.impact_speed_m_s)
    duration = min(max(6.0 * rigid, 2e-4), 4e-3)
    finest = replace(_limited(spec, 1.0 / _STEP_S), step_s=_STEP_S / 2)
    ref, best, _ = _first_impact(finest, duration)
    if best is None or best.start_s + best.duration_s > duration - 3e-6:
        return []

    @cache
    def at(limit_hz: float) -> tuple[tuple[float, float, float], int]:
        try:
            gap, impact, count = _first_impact(_limited(spec, limit_hz), duration)
        except ValueError:  # no mode that low
            return (math.inf, math.inf, math.inf), 0
        if impact is None:
            return (math.inf, math.inf, math.inf), count
        return _errors(gap, impact, ref, best), count

    found = []
    for request in REQUESTS:
        limit = frequency_limit_hz(sphere, spec.plate, spec.contact, _STEP_S, request, spring=True)
        errors, count = at(limit)
        cheapest = count
        lower = limit / _RATIO
        # Down to where the request is missed; errors fall steadily enough with the limit.
        while max(errors) <= request and (tried := at(lower))[1] > 0 and max(tried[0]) <= request:
            cheapest, lower = tried[1], lower / _RATIO
        found.append(
            Outcome(
                number,
                material_name(spec.simply_supported),
                1e3 * sphere.radius_m,
                request,
                limit / 1e3,
                count,
                *errors,
                times_cheapest=count / cheapest,
                capped=limit >= 0.5 / _STEP_S,
            )
        )
    return found


def material_name(plate: Plate) -> str:
    """Name of the shipped material that a random plate is of."""
    return next(name for name, material in MATERIALS.items() if material is plate.material)


def sphere_and_plate_keys(spec: PlantSpec) -> dict[str, Any]:
    """Keys of a scene with the sphere and the plate of a description."""
    sphere, plate = spec.sphere, spec.simply_supported
    return {
        "sphere.radius_m": sphere.radius_m,
        "sphere.drop_height_m": sphere.drop_height_m,
        "plate.material": material_name(plate),
        "plate.size_m": list(plate.size_m),
        "plate.thickness_m": plate.thickness_m,
        "plate.contact_point_m": list(spec.contact_point_m),
    }


def _draw(path: Path, found: list[Outcome]) -> None:
    metric, axes = pictures.sheet(1, 2, height=3.6)
    for i, request in enumerate(REQUESTS):
        mine = [o for o in found if o.request == request]
        style = {**pictures.look(i, True), "linestyle": "none", "label": f"asked {request:g}"}
        axes[0, 0].semilogy([o.scene for o in mine], [o.error for o in mine], **style)
        axes[0, 0].axhline(request, color=pictures.COLOURS[i], linewidth=0.8)
        axes[0, 1].plot([o.scene for o in mine], [o.times_cheapest for o in mine], **style)
    axes[0, 0].set(title="Error of a random scene", xlabel="scene", ylabel="largest of three")
    axes[0, 1].set(title="Modes against the fewest that do", xlabel="scene", ylim=(0.9, None))
    for axis in axes[0]:
        axis.legend()
    pictures.save(metric, path)


def summary(request: float, found: list[Outcome]) -> tuple[float, ...]:
    """The request, scenes, those beyond the step, the share of the others that meets it (%), worst
    error over request, and median and largest cost against the cheapest."""
    mine = [o for o in found if o.request == request]
    free = [o for o in mine if not o.capped]
    met = [o for o in free if o.error <= request]
    costs = sorted(o.times_cheapest for o in met) or [math.nan]
    worst = max((o.error / request for o in free), default=math.nan)
    percent = 100.0 * len(met) / max(len(free), 1)
    beyond = len(mine) - len(free)
    return request, len(mine), beyond, percent, worst, costs[len(costs) // 2], costs[-1]


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 40,
    seed: SeedOption = 1,
    quick: QuickOption = False,
) -> None:
    """Check the automatic choice of modes on random scenes: does it meet the requested accuracy?

    Compares its cost with that of the cheapest sufficient model. Then checks whole scenes with
    losses in the contact, without and with a law.

    Example: python -m benchmarks.model_order --quick
    """
    from benchmarks import model_order_closed_loop as closed_loop

    scenes = 4 if quick else scenes
    with results_in(folder, "model_order", "modal") as results:
        compile_first(load(DEFAULT, ["plate.tail=spring"]))
        found = drawn(scenes, seed, outcomes)
        whole = drawn(scenes, seed, closed_loop.outcomes)
        results.write("model_order", found)
        results.write("model_order_closed_loop", whole)
        _draw(results.path("model_order.png"), found)
        results.table(
            "Automatic choice of modes",
            {
                "asked": "{[0]:g}",
                "scenes": "{[1]}",
                "beyond the step": "{[2]}",
                "met": "{[3]:.0f} %",
                "worst error/asked": "{[4]:.2f}",
                "cost/cheapest, median": "{[5]:.2f}",
                "largest": "{[6]:.2f}",
            },
            [summary(request, found) for request in REQUESTS],
            text=0,
        )
        for outcome in found:
            if outcome.error > outcome.request and not outcome.capped:
                out.say(f"missed: {outcome}")
        closed_loop.report(results, whole)
        free = [o for o in found if not o.capped]
        others = [o for o in whole if not o.said]
        met = share(sum(o.error <= o.request for o in free), len(free))
        closed = share(sum(o.error <= o.request for o in others), len(others))
        results.conclude(
            f"The automatic choice of modes meets the requested accuracy in {met} of the impacts "
            f"without losses, and in {closed} of those in whole scenes whose run expects to meet "
            "it."
        )


if __name__ == "__main__":
    start("benchmarks.model_order")
