"""Intervals of `hertzloop fit` where the model is of another class than the rig, and where few
samples come before the impact.

The rigs are synthetic: steel balls on aluminium plates, drawn at random, with the contact force and
the velocity of the plate by one clock.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
import typer

from benchmarks.program import OutDirOption, QuickOption, share, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from benchmarks.synthetic_fits import (
    ExactOption,
    OnlyOption,
    Summary,
    by_one_clock,
    check_names,
    drawn_gain_and_clock,
    known_gain_and_clock,
    moved,
    report,
    summary,
)
from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.common.protocols import Point
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key, start_value
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, ObservedSignal, observe
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.plant.structures.modes import Modes
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.setup import Setup

RADIUS, THICKNESS = "sphere.radius_m", "plate.thickness_m"
STIFFNESS, HEIGHT = "contact.stiffness_factor", "sphere.drop_height_m"
_LOW_PASS_HZ, _RATE_HZ, _QUIET_S = 60e3, 1e6, 250e-6
_LASTS_S = {"contact_force": 90e-6, "v_p": 300e-6}
_NOISE, _START = 2e-4, 1.03
_EXTRA, _BAND_HZ = 1.03, 15e3  # frequency over that of a mode, the first above this frequency
_FEW_NOISE, _FEW_GAIN = 1e-3, 0.03

# Changes that make the rig another class than the model.
CLASSES: dict[str, tuple[str, ...]] = {
    "right class": (),
    "yield": ("contact.plasticity=thornton",),
    "other edges": ("plate.edges=cfcf",),
    "extra mode": (),
}
FEW = (16, 32, 64)  # samples before the impact


class WithExtraMode(Plate):
    """A plate with one more mode, 3 % above one of its own."""

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """The modes up to a frequency, with the additional one."""
        found = super().modes(omega_max, contact_m, actuator_m)
        moves = np.abs(found.at_contact) > 0.5
        of = int(np.argmax(moves & (found.omega > 2.0 * math.pi * _BAND_HZ)))
        at = int(np.searchsorted(found.omega, _EXTRA * found.omega[of]))
        return replace(
            found,
            omega=np.insert(found.omega, at, _EXTRA * found.omega[of]),
            at_contact=np.insert(found.at_contact, at, found.at_contact[of]),
            at_actuator=np.insert(found.at_actuator, at, found.at_actuator[of]),
        )


def _drawn(seed: int) -> tuple[np.random.Generator, list[str]]:
    """A random rig: the generator for what else is drawn, and the changes of aluminium-3mm."""
    generator = np.random.default_rng(50_000 + seed)
    radius, thickness = generator.uniform(2e-3, 4e-3), generator.uniform(2e-3, 4e-3)
    sides = generator.uniform(0.15, 0.4, 2)
    height = generator.uniform(0.02, 0.06)
    where = [0.5 * sides[0], 0.45 * sides[1]]
    return generator, [
        "controller.law=off",
        f"{RADIUS}={radius}",
        f"{THICKNESS}={thickness}",
        f"{HEIGHT}={height}",
        f"plate.size_m=[{sides[0]}, {sides[1]}]",
        f"plate.contact_point_m=[{where[0]}, {where[1]}]",
    ]


def _truth(setup: Setup, quantity: str, kind: str) -> ObservedSignal:
    chain = MeasuringChain(low_pass_hz=_LOW_PASS_HZ) if quantity == "v_p" else MeasuringChain()
    lasts_s = _LASTS_S[quantity]
    if kind != "extra mode":
        accuracy = 1e-4 if kind in ("3-D", "other edges") else 1e-5
        return truth(setup, quantity, lasts_s, chain, accuracy)
    simulator = ImpactSimulator(setup, lasts_s, 1e-5, step_ns=125)
    plate = setup.mechanics.structure.local_plate
    assert plate is not None
    extra = WithExtraMode(plate.material, plate.size_m, plate.thickness_m, plate.loss_factor)
    spec = replace(simulator.spec, plate=extra)
    return observe(simulator.run_spec(spec, lasts_s), quantity, chain, False)


def run(kind: str, seed: int, exact: bool = False) -> tuple[FitResult, dict[str, float]]:
    """Fit both records of one rig. Returns the result and the true values.

    Args:
        kind: a key of `CLASSES`.
        seed: of the rig and of its noise.
        exact: whether the model is taken as exact.
    """
    generator, changes = _drawn(seed)
    own = list(CLASSES[kind])
    if kind == "yield":
        own.append(f"contact.limiting_pressure_pa={generator.uniform(0.8e9, 1.6e9)}")
    rig = load("aluminium-3mm", [*changes, *own])
    model = load("aluminium-3mm", changes)
    spoilt = drawn_gain_and_clock(Spoilt(noise=_NOISE), generator)
    plain = known_gain_and_clock(Measurement())
    filtered = replace(plain, low_pass_hz=_LOW_PASS_HZ)
    records = by_one_clock(
        [_truth(rig, quantity, kind) for quantity in _LASTS_S],
        spoilt,
        seed,
        {"contact_force": plain, "v_p": filtered},
        _RATE_HZ,
        _QUIET_S,
    )
    true = {
        RADIUS: start_value(model, RADIUS),
        THICKNESS: start_value(model, THICKNESS),
        STIFFNESS: 1.0,
    }
    base = moved(model, true, _START, generator)
    return fit(base, records, [parse_free_key(base, key) for key in true], exact=exact), true


def run_few(samples: int, seed: int, exact: bool = False) -> tuple[FitResult, dict[str, float]]:
    """Fit a force record with few samples before the impact. Returns the result and the true
    values.

    Args:
        samples: before the impact.
        seed: of the rig and of its noise.
        exact: whether the model is taken as exact.
    """
    generator, changes = _drawn(seed)
    model = load("aluminium-3mm", changes)
    spoilt = Spoilt(noise=_FEW_NOISE, gain=1.0 + _FEW_GAIN * float(generator.standard_normal()))
    one = measured(
        truth(model, "contact_force", 90e-6, accuracy=1e-5),
        spoilt,
        seed,
        quiet_s=samples / 2e6,
    )
    true = {RADIUS: start_value(model, RADIUS), HEIGHT: start_value(model, HEIGHT)}
    return fit(model, [one], [parse_free_key(model, key) for key in true], exact=exact), true


def coverage(kind: str, seeds: int, exact: bool = False) -> Summary:
    """Fit the rigs of a class, or records with few samples, and count what the intervals hold."""
    if kind in CLASSES:
        keys, one = [RADIUS, THICKNESS, STIFFNESS], partial(run, kind, exact=exact)
        return summary(kind, kind != "right class", keys, seeds, one)
    few = partial(run_few, int(kind.split()[0]), exact=exact)
    return summary(kind, False, [RADIUS, HEIGHT], seeds, few)


def main(
    folder: OutDirOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Rigs of a class (1 with --quick).")] = 25,
    exact: ExactOption = False,
    only: OnlyOption = None,
    quick: QuickOption = False,
) -> None:
    """Count how often intervals hold the truth where the model is of another class than the rig.

    Each rig is a steel ball on an aluminium plate, with the contact force and the velocity of the
    plate at 0.02 % noise. Other records have 16, 32 or 64 samples before the impact. With --quick
    there are two classes.

    Example: python -m benchmarks.fit_discrepancy --quick
    """
    known = [*CLASSES, *(f"{n} samples before" for n in FEW)]
    names = only or (["right class", "yield"] if quick else known)
    check_names(names, known)
    with results_in(folder, "fit_discrepancy", "modal") as results:
        found = [
            coverage(name, 1 if quick else seeds, exact) for name in tracked("problems", names)
        ]
        report(results, "fit_discrepancy", found)
        wrong, right = [s for s in found if s.wrong], [s for s in found if not s.wrong]
        parts = [
            f"{share(sum(s.held for s in some), sum(s.values for s in some))} of the true values "
            f"{where}"
            for some, where in (
                (wrong, "where the rig has another class than the model"),
                (right, "where it has the same class"),
            )
            if some
        ]
        whole = share(sum(s.whole for s in found), sum(s.seeds for s in found))
        results.conclude(
            f"The 95 % intervals hold {', and '.join(parts)}; all of a rig in {whole}."
        )


if __name__ == "__main__":
    start("benchmarks.fit_discrepancy")
