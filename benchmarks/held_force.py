"""Does the expected error of a run hold under a law whose force has steps? Scenes at random.

The first impact of plates in three dimensions and of thin ones, under the threshold law or a force
that is switched, is compared with the same equations at half the step, the law sampled as before:
with twice the modes, as far as the step carries them, and with all modes. In a solid these end
where waves are as short as the contact is wide, in a thin plate at 1.5 over the step. (At whole
multiples of the sampling frequency a held force has a line; it would test the reference.) Some
scenes have half the step, a sample every other step or a bandwidth of the actuator.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.model_order import drawn
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    ScenesOption,
    SeedOption,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    share,
    start,
    write_records,
    written,
)
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import rigid_contact_time_s, rigid_peak_force_n
from hertzloop.results.law_accuracy import simulated_law_accuracy
from hertzloop.results.verification import against
from hertzloop.scene import model_error
from hertzloop.scene.plate_model import widest_limit_hz
from hertzloop.scene.setup import Setup, load
from hertzloop.studies import pictures

_LEAD_S = 1e-5
_SHORT = {"3d": "3d", "kirchhoff": "thin", "slope_threshold": "held", "constant": "switched"}
_KINDS = tuple(
    (theory, law) for theory in ("3d", "kirchhoff") for law in ("slope_threshold", "constant")
)
_LINES = 1.5  # times the sampling frequency: modes of the reference
HEADINGS = ("plate", "law", "k h", "expected", "found", "twice: expected", "found", "kept")


@dataclass(frozen=True)
class Outcome:
    """A scene: the error that it asks for, that its run expects and that is found against all
    modes; the same against twice the modes; whether the run says that the modes change what the law
    decides. Errors are the largest of gap, rebound speed and energy."""

    theory: str
    law: str
    kh: float
    asked: float
    expected: float
    found: float
    twice_expected: float
    twice_found: float
    told: bool
    keys: str

    @property
    def kept(self) -> bool:
        """Whether both errors are what was expected, or the run says that they are not."""
        by_twice = self.twice_found <= max(self.asked, self.twice_expected)
        return self.told or (by_twice and self.found <= max(self.asked, self.expected))


def random_scene(random: np.random.Generator, theory: str, law: str) -> dict[str, Any]:
    """Keys of a steel ball of 2 to 5 mm, on 3 to 8 mm of aluminium, somewhere."""
    size = random.uniform(0.15, 0.3, 2)
    keys: dict[str, Any] = {
        "plate.theory": theory, "sphere.radius_m": random.uniform(2e-3, 5e-3),
        "sphere.drop_height_m": random.uniform(0.02, 0.12),
        "plate.thickness_m": random.uniform(3e-3, 8e-3),
        "plate.size_m": list(size), "plate.contact_point_m": list(size * random.uniform(0.2, 0.8)),
        "controller.latency_us": float(random.integers(0, 6)), "controller.law": law,
    }  # fmt: skip
    base = load("aluminium-3mm").vary(keys | {"controller.law": "off"}).plant
    speed = base.sphere.impact_speed_m_s
    if law == "constant":
        parts = base.sphere.mass_kg, base.contact.stiffness, speed
        keys["controller.force_n"] = random.uniform(0.1, 0.8) * rigid_peak_force_n(*parts)
        keys["controller.duration_us"] = float(round(5e5 * rigid_contact_time_s(*parts)))
    else:
        keys["controller.kappa"] = random.uniform(0.5, 0.9)
        keys["controller.v_thr_m_s"] = -speed * random.uniform(0.2, 0.8)
    more = [
        {}, {}, {"run.step_ns": 500}, {"sensors.every_steps": 2},
        {"actuator.bandwidth_hz": 10.0 ** random.uniform(4.9, 5.8)},
    ]  # fmt: skip
    keys |= more[random.integers(len(more))]
    return {key: typed(value) for key, value in keys.items()}


def typed(value: Any) -> Any:
    """A value of a key with the digits that a person types."""
    if isinstance(value, list):
        return [typed(x) for x in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def outcome(theory: str, law: str, accuracy: float, random: np.random.Generator) -> Outcome | None:
    """The next random scene; None if its first impact does not end in time."""
    keys = random_scene(random, theory, law)
    more = {"run.lead_in_s": _LEAD_S, "run.plate_model": "modal", "run.accuracy": accuracy}
    setup = load("aluminium-3mm").vary(keys | more)
    spec = setup.plant
    lasts_s = rigid_contact_time_s(
        spec.sphere.mass_kg, spec.contact.stiffness, spec.sphere.impact_speed_m_s
    )
    setup = setup.with_steps(round((_LEAD_S + 5.0 * lasts_s + 4e-5) / setup.step_s))
    all_hz = _LINES / setup.step_s
    if spec.plate.solid:
        all_hz = widest_limit_hz(spec.plate, spec.sphere, spec.contact)
    twice_hz = max(spec.frequency_limit_hz, min(2.0 * spec.frequency_limit_hz, 0.5 / setup.step_s))
    found = [_error(setup, limit_hz) for limit_hz in (all_hz, twice_hz)]
    if None in found:
        return None
    by_modes = simulated_law_accuracy(setup, setup.duration_s)
    material, h = spec.plate.material, keys["plate.thickness_m"]
    thin = h * math.sqrt(material.plane_strain_modulus_pa / (12.0 * material.density_kg_m3))
    return Outcome(
        theory=theory, law=law, kh=h * math.sqrt(2.0 * math.pi / (lasts_s * thin)),
        asked=accuracy, expected=model_error.expected_error(setup), found=found[0] or 0.0,
        twice_expected=model_error.expected_error(setup, twice_hz), twice_found=found[1] or 0.0,
        told=by_modes is not None and not by_modes.kept,
        keys=" ".join(f"--set {key}={value}".replace(", ", ",") for key, value in keys.items()),
    )  # fmt: skip


def _error(setup: Setup, limit_hz: float) -> float | None:
    fine = replace(setup.plant, step_s=setup.step_s / 2, frequency_limit_hz=limit_hz)
    found = against(setup, simulate(setup).truth, fine)
    return found.largest if found else None


def _draw(path: Path, found: list[Outcome]) -> None:
    metric, [[axes]] = pictures.sheet(1, 1, 6.0, 4.5)
    pairs = [(o.expected, o.found) for o in found]
    ends = [min(map(min, pairs)), max(map(max, pairs))]
    for i, kind in enumerate(_KINDS):
        mine = [o for o in found if (o.theory, o.law) == kind]
        style = {**pictures.look(i, True), "linestyle": "none"}
        label = ", ".join(_SHORT[name] for name in kind)
        axes.loglog([o.expected for o in mine], [o.found for o in mine], label=label, **style)
    axes.loglog(ends, ends, color="grey", linewidth=0.8)
    axes.set(title="Error of the first impact", xlabel="expected", ylabel="found")
    axes.legend()
    pictures.save(metric, path)


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 40,
    seed: SeedOption = 1,
    accuracy: float = 1e-3,
    quick: QuickOption = False,
) -> None:
    """Compare the expected error of runs under a law with what a finer model finds.

    Example: python -m benchmarks.held_force --quick
    """
    scenes = 4 if quick else scenes
    found: list[Outcome] = []

    def next_ones(number: int, random: np.random.Generator) -> list[Outcome]:
        one = outcome(*_KINDS[number % len(_KINDS)], accuracy, random)
        return [one] if one else []

    with results_in(folder, "held_force", "modal") as made:
        compile_first(load("aluminium-3mm", ["plate.theory=3d"]))
        found = drawn(scenes, seed, next_ones)
        write_records(made / "held_force.csv", found)
        _draw(made / "held_force.png", found)
    rows = [
        (_SHORT[o.theory], _SHORT[o.law], f"{o.kh:.2f}", f"{o.expected:.1e}", f"{o.found:.1e}",
         f"{o.twice_expected:.1e}", f"{o.twice_found:.1e}",
         "said" if o.told else "yes" if o.kept else "no")
        for o in sorted(found, key=lambda o: (o.theory, o.law))
    ]  # fmt: skip
    title = f"Errors under a law, requested {accuracy:g}"
    out.print(number_table(title, HEADINGS, rows, 2))
    for o in found:
        if not o.kept:
            out.print(f"missed: {o.keys}", soft_wrap=True)
    written(made, "held_force.csv", "held_force.png")
    for kind in _KINDS:
        ratios = [o.expected / o.found for o in found if (o.theory, o.law) == kind and not o.told]
        if ratios:
            low, mid, high = np.quantile(ratios, [0.0, 0.5, 1.0])
            name = f"{_SHORT[kind[0]]}, {_SHORT[kind[1]]}"
            out.print(f"{name}: expected/found {low:.2f}, median {mid:.1f}, largest {high:.1f}")
    kept = share(sum(o.kept for o in found), len(found))
    conclude(f"The error of the first impact is as expected, or announced as larger, in {kept}.")


if __name__ == "__main__":
    start("benchmarks.held_force")
