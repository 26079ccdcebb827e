"""Does an infinite plate meet what was asked for as long as it is said to? Scenes drawn at random.

The first impact, with and without control, damping and disturbed lines, until the last moment at
which the infinite plate is said to do: error of the gap (relative to its largest value in
contact), of the rebound speed (to the impact speed) and of the plate energy (to itself, or to what
the actuator gave or took if that is more), against all modes to twice pi/dt at half the step
under the same actuator forces.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, ScenesOption, SeedOption, start
from benchmarks.random_scenes import drawn
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.closed_loop.parts import series_under
from hertzloop.controller.loading.registry import find
from hertzloop.loop.simulate import simulate
from hertzloop.plant import state_kernels
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.schemes.factory import built
from hertzloop.plant.state_kernels import FLIGHT_V, FLIGHT_X, XI_S
from hertzloop.plant.time_series import F_A, XI, XI_P
from hertzloop.scene.build import build_plant
from hertzloop.scene.setup import Setup

REQUESTS = (1e-2, 1e-3, 1e-4)
_MOST_MODES = 10_000.0  # up to 1/step: keeps a scene within seconds
_START = [FLIGHT_X, FLIGHT_V, state_kernels.XI, XI_S]


@dataclass(frozen=True)
class Outcome:
    """One scene under one request; `lasts_us`: from the first touch on, 0 (and no errors, nan)
    where the infinite plate is not offered. No rebound and no energy (nan) where control makes
    the contact last beyond that."""

    scene: int
    control: str
    request: float
    contact_us: float
    lasts_us: float
    gap_error: float
    rebound_error: float
    energy_error: float


_KEYS_OF_LAWS = ("kappa", "v_thr_m_s", "force_n", "duration_us")
_DAMPERS = {"contact.viscous_n_s_m": "viscous", "contact.restitution": "hunt_crossley"}


def random_scene(random: np.random.Generator) -> Setup:
    """A small sphere on a plate of any of three materials, at any point, most under control."""
    material = str(random.choice(["aluminium", "steel", "oak"]))
    size = [float(random.uniform(0.15, 0.8)) for _ in range(2)]
    values: dict[str, Any] = {
        "sphere.radius_m": float(10.0 ** random.uniform(-3.0, -2.0)),
        "sphere.drop_height_m": float(10.0 ** random.uniform(-2.5, -0.3)),
        "plate.material": material,
        "plate.size_m": size,
        "plate.thickness_m": float(10.0 ** random.uniform(-2.6, -1.7)),
        "plate.contact_point_m": [s * float(random.uniform(0.15, 0.85)) for s in size],
        "contact.damping": str(random.choice(["none", "viscous", "hunt_crossley"])),
        "contact.viscous_n_s_m": 1.0,
        "contact.restitution": 0.8,
        "controller.law": str(random.choice(["off", "slope_threshold", "predicted", "constant"])),
        "controller.kappa": float(random.uniform(-1.0, 1.0)),
        "controller.v_thr_m_s": float(random.uniform(-0.5, 0.0)),
        "controller.latency_us": int(random.integers(0, 20)),
        "controller.force_n": float(random.uniform(-5.0, 5.0)),
        "controller.duration_us": 15,
        "controller.drop_out_probability": float(random.choice([0.0, 0.1])),
        "run.lead_in_s": 2e-6,
        "run.duration_s": 1.0,
    }
    return load("aluminium-3mm").vary(_with_effect(values))


def _with_effect(values: dict[str, Any]) -> dict[str, Any]:
    """The values without the keys that the drawn law or damper does not have; a scene refuses
    them."""
    of_law = find(values["controller.law"]).keys.model_fields
    without = {f"controller.{key}" for key in _KEYS_OF_LAWS if key not in of_law}
    without |= {key for key, damper in _DAMPERS.items() if values["contact.damping"] != damper}
    return {key: value for key, value in values.items() if key not in without}


def outcome(number: int, setup: Setup, request: float) -> Outcome:
    """Follow a scene on the infinite plate as long as it is offered, then on the modes."""
    setup = setup.vary({"run.accuracy": request})
    lasts_s = setup.infinite_plate.lasts_s()
    about = (
        number,
        setup.scene.controller.law
        + (" with drop-outs" if setup.signal_path.drop_out_probability else ""),
        request,
    )
    steps = int((setup.first_touch_s + lasts_s) / setup.run.step_s)
    if lasts_s == 0.0:
        return Outcome(*about, math.nan, 0.0, math.nan, math.nan, math.nan)
    setup = setup.with_steps(steps).with_plate_model("infinite")
    rows = simulate(setup).truth
    spec = setup.plant
    fine = replace(
        spec,
        step_s=spec.step_s / 2,
        frequency_limit_hz=1.0 / spec.step_s,
        infinite_plate=False,
        residual_flexibility=True,
    )
    plant = built(fine, "modal").at_start()
    plant.state.body[_START] = build_plant(setup, spec).state.body[_START]
    # Up to the last row of the run: the work of its last step shows in no row.
    finer = series_under(plant, np.repeat(rows[F_A], 2)[:-1])
    mine = impacts_in(spec, rows)[0]
    best = impacts_in(fine, finer)[0]
    injected = float(np.sum(rows[F_A, :-1] * np.diff(rows[XI_P])))
    exchanged = max(abs(best.plate_energy_j), abs(injected))
    gap, true = rows[XI], finer[XI, ::2]
    change = abs(mine.rebound_speed_m_s - best.rebound_speed_m_s)
    over = min(gap[-3:].min(), true[-3:].min()) > 0.0  # by more than the row that a speed needs
    return Outcome(
        *about,
        1e6 * best.duration_s,
        1e6 * lasts_s,
        float(abs(gap - true).max() / -true.min()),
        change / best.impact_speed_m_s if over else math.nan,
        abs(mine.plate_energy_j - best.plate_energy_j) / exchanged if over else math.nan,
    )


def run(scenes: int, seed: int) -> list[Outcome]:
    """All requests of so many random scenes."""

    def next_ones(number: int, random: np.random.Generator) -> list[Outcome]:
        setup = random_scene(random)
        if setup.plant.plate.modes_below(1.0 / setup.run.step_s) > _MOST_MODES:
            return []
        return [outcome(number, setup, request) for request in REQUESTS]

    return drawn(scenes, seed, next_ones)


def worst(found: list[Outcome], *metrics: str) -> float:
    """Largest error of some metrics over the requested accuracy; NaN where none is known."""
    ratios = [getattr(o, f"{metric}_error") / o.request for o in found for metric in metrics]
    return max((ratio for ratio in ratios if not math.isnan(ratio)), default=math.nan)


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 80,
    seed: SeedOption = 1,
    quick: QuickOption = False,
) -> None:
    """Check on random scenes whether an infinite plate meets its accuracy while it is offered.

    Example: python -m benchmarks.infinite_plate --quick
    """
    with results_in(folder, "infinite_plate", "modal") as results:
        found = run(4 if quick else scenes, seed)
        results.write("infinite_plate", found)
        rows = []
        for request in REQUESTS:
            mine = [o for o in found if o.request == request]
            offered = [o for o in mine if o.lasts_us]
            free = [o for o in offered if o.control.startswith("off")]
            ratios = [worst(offered, metric) for metric in ("gap", "rebound", "energy")]
            rows.append((request, len(mine), len(offered), *ratios, worst(free, "energy")))
        results.table(
            "Infinite plate, errors over what was asked",
            {
                "asked": "{[0]:g}",
                "scenes": "{[1]}",
                "offered": "{[2]}",
                "gap": "{[3]:.2f}",
                "rebound": "{[4]:.2f}",
                "energy": "{[5]:.2f}",
                "energy, no control": "{[6]:.2f}",
            },
            rows,
            text=0,
        )
        offered = [o for o in found if o.lasts_us]
        results.conclude(
            f"The infinite plate is offered in {len(offered)} of {len(found)} requests, and its "
            f"largest error is {worst(offered, 'gap', 'rebound', 'energy'):.2f} times the "
            "requested accuracy."
        )


if __name__ == "__main__":
    start("benchmarks.infinite_plate")
