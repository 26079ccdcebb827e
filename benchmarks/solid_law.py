"""Does a run keep the accuracy that it states, on a solid plate under a law? Scenes at random.

The first impact of a steel ball on an aluminium plate in three dimensions (`plate.theory = "3d"`)
under a law, with the modes and the step that `run` chooses, is compared with twice the modes and
half the step, the law sampled as before. The last column has all modes up to the frequency where
the contact is as wide as the waves.
"""

import math
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
from hertzloop.cli.prepare import compile_first
from hertzloop.cli.terminal import out
from hertzloop.results.law_accuracy import simulated_law_accuracy, stated_error
from hertzloop.scene import model_error
from hertzloop.scene.plate_model import widest_limit_hz
from hertzloop.scene.setup import load

LAWS = ("force_feedback", "slope_threshold", "velocity_feedback", "fade_out", "predicted")
_WATCH = ("slope_threshold", "fade_out", "predicted")  # a threshold of the slope


_REQUESTED = 1e-3  # error


@dataclass(frozen=True)
class Outcome:
    """A scene: the requested error and the error that a run states; the largest error of
    penetration, rebound speed and plate energy against twice the modes and half the step, and
    against all modes (nan where the impact does not end)."""

    law: str
    kappa: float
    asked: float
    stated: float
    found: float
    all_modes: float
    more: str
    keys: str

    @property
    def kept(self) -> bool:
        """Whether the error is at most the one stated; with an error of 1 nothing is known."""
        return min(1.0, self.found) <= max(self.asked, self.stated)


def random_keys(random: np.random.Generator, law: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Keys of a scene under a law, and what is unusual of its chain from sensor to actuator."""
    size = random.uniform(0.15, 0.35, 2)
    drop_m = random.uniform(0.02, 0.12)
    keys: dict[str, Any] = {
        "plate.theory": "3d",
        "sphere.radius_m": random.uniform(2e-3, 6e-3),
        "sphere.drop_height_m": drop_m,
        "plate.thickness_m": random.uniform(3e-3, 12e-3),
        "plate.size_m": list(size),
        "plate.contact_point_m": list(size * random.uniform(0.2, 0.8)),
        "controller.law": law,
        "controller.latency_us": float(random.integers(0, 6)),
        "controller.kappa": random.uniform(0.2, 0.9),
    }
    if law == "velocity_feedback":
        keys["controller.kappa"] = random.uniform(0.05, 0.4)
    if law in _WATCH:
        keys["controller.v_thr_m_s"] = -math.sqrt(19.62 * drop_m) * random.uniform(0.2, 0.8)
    more: list[dict[str, Any]] = [
        {},
        {"run.step_ns": 500},
        {"sensors.every_steps": 2},
        {"actuator.bandwidth_hz": 10.0 ** random.uniform(4.3, 5.8)},
    ]
    chosen = {key: typed(value) for key, value in more[random.integers(len(more))].items()}
    return {key: typed(value) for key, value in keys.items()}, chosen


def outcome(keys: dict[str, Any], more: dict[str, Any], accuracy: float) -> Outcome | None:
    """A scene by its keys; None if its first impact does not end in time."""
    setup = first_impact_of(keys | more, accuracy)
    spec = setup.plant
    wide = errors_of(setup, widest_limit_hz(spec.plate, spec.sphere, spec.contact))
    both = errors_of(setup, min(2.0 * spec.frequency_limit_hz, spec.plate.highest_hz))
    if both is None:
        return None
    stated = stated_error(
        model_error.expected_error(setup), simulated_law_accuracy(setup, setup.duration_s)
    )
    assert stated is not None
    return Outcome(
        setup.law_reference,
        keys["controller.kappa"],
        accuracy,
        stated,
        both.largest,
        all_modes=min(1.0, wide.largest) if wide else math.nan,
        more=", ".join(f"{key.split('.')[1]} {value:g}" for key, value in more.items()),
        keys=as_options(keys | more),
    )


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 10,
    seed: SeedOption = 1,
    quick: QuickOption = False,
) -> None:
    """Compare the stated error of runs on solid plates under a law with finer models.

    Example: python -m benchmarks.solid_law --quick
    """

    def next_ones(number: int, random: np.random.Generator) -> list[Outcome]:
        one = outcome(*random_keys(random, LAWS[number % len(LAWS)]), _REQUESTED)
        return [one] if one else []

    with results_in(folder, "solid_law", "modal") as results:
        compile_first(load("aluminium-3mm", ["plate.theory=3d"]))
        found = drawn(4 if quick else scenes, seed, next_ones)
        results.write("solid_law", found)
        results.table(
            f"Errors on solid plates under a law, requested {_REQUESTED:g}",
            {
                "law": "{.law}",
                "kappa": "{.kappa:.2f}",
                "more": "{.more}",
                "stated": "{.stated:.1e}",
                "found": "{.found:.1e}",
                "kept": lambda o: "yes" if o.kept else "no",
                "all modes": "{.all_modes:.1e}",
            },
            found,
            text=3,
        )
        for o in found:
            if not o.kept:
                out.say(f"missed: {o.keys}")
        within = share(sum(o.found <= _REQUESTED for o in found), len(found))
        all_modes = share(sum(o.all_modes <= max(o.asked, o.stated) for o in found), len(found))
        out.print(f"The requested error is met in {within}.")
        out.print(f"With all modes the error is at most the stated one in {all_modes}.")
        kept = share(sum(o.kept for o in found), len(found))
        results.conclude(f"The error of the first impact is at most the stated one in {kept}.")


if __name__ == "__main__":
    start("benchmarks.solid_law")
