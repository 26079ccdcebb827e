"""Does the expected error of a run hold under a law whose force has steps? Scenes at random.

The first impact of thin plates, under the threshold law or a force that is switched, is compared
with the same equations at half the step and with modes up to 1.5 over the step, the law sampled as
before. (At whole multiples of the sampling frequency a held force has a
line; it would test the reference.) Some scenes have half the step, a sample every other step or a
bandwidth of the actuator.
"""

from dataclasses import dataclass
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
from benchmarks.random_scenes import as_options, drawn, errors_of, first_impact_of, typed
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.prepare import compile_first
from hertzloop.cli.terminal import out
from hertzloop.plant.contact.hertz import rigid_contact_time_s, rigid_peak_force_n

_SHORT = {"slope_threshold": "held", "constant": "switched"}
_LAWS = tuple(_SHORT)
_LINES = 1.5  # times the sampling frequency: modes of the reference


_REQUESTED = 1e-3  # error


@dataclass(frozen=True)
class Outcome:
    """A scene: the error that it asks for, that its run expects and that is found, the largest of
    gap, rebound speed and energy."""

    law: str
    asked: float
    expected: float
    found: float
    keys: str

    @property
    def kept(self) -> bool:
        """Whether the error is what was expected."""
        return self.found <= max(self.asked, self.expected)


def random_scene(random: np.random.Generator, law: str) -> dict[str, Any]:
    """Keys of a steel ball of 2 to 5 mm, on 3 to 8 mm of aluminium, somewhere."""
    size = random.uniform(0.15, 0.3, 2)
    keys: dict[str, Any] = {
        "sphere.radius_m": random.uniform(2e-3, 5e-3),
        "sphere.drop_height_m": random.uniform(0.02, 0.12),
        "plate.thickness_m": random.uniform(3e-3, 8e-3),
        "plate.size_m": list(size),
        "plate.contact_point_m": list(size * random.uniform(0.2, 0.8)),
        "controller.latency_us": float(random.integers(0, 6)),
        "controller.law": law,
    }
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
        {},
        {},
        {"run.step_ns": 500},
        {"sensors.every_steps": 2},
        {"actuator.bandwidth_hz": 10.0 ** random.uniform(4.9, 5.8)},
    ]
    keys |= more[random.integers(len(more))]
    return {key: typed(value) for key, value in keys.items()}


def outcome(law: str, accuracy: float, random: np.random.Generator) -> Outcome | None:
    """The next random scene; None if its first impact does not end in time."""
    keys = random_scene(random, law)
    setup = first_impact_of(keys, accuracy)
    found = errors_of(setup, _LINES / setup.run.step_s)
    if found is None:
        return None
    return Outcome(
        law=law,
        asked=accuracy,
        expected=setup.expected_error,
        found=found.largest,
        keys=as_options(keys),
    )


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 40,
    seed: SeedOption = 1,
    quick: QuickOption = False,
) -> None:
    """Compare the expected error of runs under a law with what a finer model finds.

    Example: python -m benchmarks.held_force --quick
    """

    def next_ones(number: int, random: np.random.Generator) -> list[Outcome]:
        one = outcome(_LAWS[number % len(_LAWS)], _REQUESTED, random)
        return [one] if one else []

    with results_in(folder, "held_force", "modal") as results:
        compile_first(load("aluminium-3mm"))
        found = drawn(4 if quick else scenes, seed, next_ones)
        results.write("held_force", found)
        results.table(
            f"Errors under a law, requested {_REQUESTED:g}",
            {
                "law": lambda o: _SHORT[o.law],
                "expected": "{.expected:.1e}",
                "found": "{.found:.1e}",
                "kept": lambda o: "yes" if o.kept else "no",
            },
            sorted(found, key=lambda o: o.law),
            text=2,
        )
        for o in found:
            if not o.kept:
                out.say(f"missed: {o.keys}")
        kept = share(sum(o.kept for o in found), len(found))
        results.conclude(f"The error of the first impact is as expected in {kept}.")


if __name__ == "__main__":
    start("benchmarks.held_force")
