"""Coverage of the intervals of `hertzloop fit`, and its verdicts, on synthetic records.

The truth is made with other steps and more modes than the fit uses. Every seed has its own noise,
gain, clock and phase of samples.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks import synthetic_fits
from benchmarks.program import JsonOption, OutDirOption, QuickOption, conclude, share, start
from benchmarks.synthetic_fits import (
    CLOCK_SD,
    GAIN_SD,
    ExactOption,
    OnlyOption,
    Summary,
    by_one_clock,
    moved,
    summaries,
)
from benchmarks.synthetic_records import Spoilt, truth
from hertzloop.identification.fit.fit import fit
from hertzloop.identification.fit.free_keys import parse_free_key, start_value
from hertzloop.identification.fit.observation import MeasuringChain
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.records.measurement import Measurement
from hertzloop.scene.setup import Setup, load

_YIELDS = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=8e8")
_PLAIN, _NO_CHAIN, _NO_TABLE = Spoilt(), MeasuringChain(), Measurement()


@dataclass(frozen=True)
class Problem:
    """A question to a record: the true scene, what is recorded, the keys, and the start.

    `changes`: of aluminium-3mm. `start`: factor on the true values that the fit starts from.
    `fitted`: changes of the model that is fitted, where its class is another one. `wrong`: whether
    its class is the wrong one. `second`: quantity of another channel by the same clock. `true`: of
    keys that the true scene says otherwise. `table`: what the record says of itself.
    """

    changes: tuple[str, ...]
    quantity: str
    duration_s: float
    keys: tuple[str, ...]
    spoilt: Spoilt = _PLAIN
    start: float = 1.0
    fitted: tuple[str, ...] | None = None
    wrong: bool = False
    chain: MeasuringChain = _NO_CHAIN
    table: Measurement = _NO_TABLE
    rate_hz: float = 2e6
    quiet_s: float = 250e-6
    second: str | None = None
    true: dict[str, float] = field(default_factory=dict)

    @property
    def under_law(self) -> bool:
        """Whether the records are of a drop under control."""
        return any(change.startswith("controller.law=") for change in self.changes)


_LOW_PASS = MeasuringChain(low_pass_hz=100e3)
_LOSS = ("plate.loss_factor=1e-3",)
PROBLEMS = {
    "force 90 us": Problem(
        _YIELDS, "contact_force", 90e-6,
        ("contact.limiting_pressure_pa", "sphere.drop_height_m"),
    ),
    "v_p 1 ms": Problem(_YIELDS, "v_p", 1e-3, ("sphere.radius_m", "plate.thickness_m")),
    "v_p 30 ms": Problem(
        _LOSS, "v_p", 30e-3, ("plate.loss_factor", "plate.thickness_m"), rate_hz=2e5,
        quiet_s=2e-3,
    ),
    "acceleration 1 ms": Problem(
        _YIELDS, "acceleration", 1e-3, ("sphere.radius_m", "plate.thickness_m",
                                        "contact.stiffness_factor"), rate_hz=1e6,
        quiet_s=400e-6, chain=_LOW_PASS, table=Measurement(low_pass_hz=100e3),
    ),
    "force 70 us, elastic": Problem(
        (), "contact_force", 70e-6, ("sphere.radius_m", "sphere.drop_height_m"),
    ),
    "20 % off": Problem(
        _YIELDS, "v_p", 1e-3, ("plate.thickness_m", "sphere.radius_m"), start=1.2,
    ),
    "8 bits": Problem(
        _YIELDS, "contact_force", 90e-6, ("contact.limiting_pressure_pa",
                                          "sphere.drop_height_m"),
        Spoilt(noise=3e-4, bits=8),
    ),
    "coloured noise": Problem(
        _YIELDS, "v_p", 1e-3, ("sphere.radius_m", "plate.thickness_m"), Spoilt(ar=0.9),
        quiet_s=400e-6,
    ),
    "spikes": Problem(
        _YIELDS, "v_p", 1e-3, ("sphere.radius_m", "plate.thickness_m"), Spoilt(spikes=0.02),
    ),
    "noise 3e-4": Problem(
        _YIELDS, "contact_force", 90e-6, ("contact.limiting_pressure_pa",
                                          "sphere.drop_height_m"), Spoilt(noise=3e-4),
    ),
    "yield fitted elastic": Problem(
        _YIELDS, "contact_force", 90e-6, ("sphere.drop_height_m", "contact.stiffness_factor"),
        fitted=("contact.plasticity=none",), wrong=True,
    ),
    "Hunt-Crossley fitted with yield": Problem(
        ("contact.damping=hunt_crossley", "contact.restitution=0.7"), "contact_force", 90e-6,
        ("contact.limiting_pressure_pa", "sphere.drop_height_m"), fitted=_YIELDS, wrong=True,
    ),
    "3-D fitted with Kirchhoff": Problem(
        ("plate.theory=3d",), "v_p", 150e-6, ("sphere.drop_height_m", "plate.thickness_m"),
        chain=_LOW_PASS, table=Measurement(low_pass_hz=100e3), fitted=(), wrong=True,
    ),
}  # fmt: skip
_LONG = "v_p 1 ms, edges cfcf"  # about 20 s a seed
PROBLEMS[_LONG] = Problem(
    ("plate.edges=cfcf",), "v_p", 1e-3, ("plate.thickness_m", "plate.material.poisson"), start=1.05,
)  # fmt: skip
_SLOPE = ("controller.law=slope_threshold",)
_VELOCITY = ("controller.law=velocity_feedback", "actuator.bandwidth_hz=1e5")
_LATENCY, _KAPPA = "controller.latency_us", "controller.kappa"
_BANDWIDTH = "actuator.bandwidth_hz"
PROBLEMS |= {
    "latency, force 90 us": Problem(
        (*_SLOPE, f"{_LATENCY}=6"), "contact_force", 90e-6, (_LATENCY,), fitted=_SLOPE,
    ),
    # Samples every microsecond, but times of the line in eighths of it: the fit's 6.375 us.
    "latency between steps, force 90 us": Problem(
        (*_SLOPE, "run.step_ns=125", "sensors.every_steps=8", f"{_LATENCY}=7.25"),
        "contact_force", 90e-6, (_LATENCY,), fitted=_SLOPE, true={_LATENCY: 6.375},
    ),
    "latency and radius, force 90 us": Problem(
        (*_SLOPE, f"{_LATENCY}=6"), "contact_force", 90e-6, (_LATENCY, "sphere.radius_m"),
        fitted=(*_SLOPE, "sphere.radius_m=0.0031"),
    ),
    "latency and gain, v_p 150 us": Problem(
        (*_VELOCITY, f"{_LATENCY}=3", f"{_KAPPA}=0.5"), "v_p", 150e-6, (_LATENCY, _KAPPA),
        fitted=(*_VELOCITY, f"{_KAPPA}=0.4"),
    ),
    "bandwidth, actuator force 150 us": Problem(
        (*_SLOPE, f"{_LATENCY}=4", f"{_BANDWIDTH}=4e4"), "actuator_force", 150e-6,
        (_BANDWIDTH,), fitted=(*_SLOPE, f"{_LATENCY}=4", f"{_BANDWIDTH}=5e4"),
    ),
    "latency and bandwidth, both forces 100 us": Problem(
        (*_SLOPE, f"{_LATENCY}=4", f"{_BANDWIDTH}=4e4"), "contact_force", 100e-6,
        (_LATENCY, _BANDWIDTH),
        fitted=(*_SLOPE, f"{_BANDWIDTH}=5e4"), second="actuator_force",
    ),
}  # fmt: skip
PROBLEMS["latency, force 90 us, noise 5 %"] = replace(
    PROBLEMS["latency, force 90 us"], spoilt=Spoilt(noise=0.05)
)
_CLASSES = ("force 90 us", "force 70 us, elastic", "v_p 1 ms",
            *(name for name, problem in PROBLEMS.items() if problem.wrong))  # fmt: skip
PROBLEMS |= {
    f"{name}, noise {100.0 * noise:g} %": replace(PROBLEMS[name], spoilt=Spoilt(noise=noise))
    for noise in (0.01, 0.001)
    for name in _CLASSES
}


def run(
    problem: Problem, seed: int, exact: bool = False
) -> tuple[FitResult, dict[str, float]]:  # fmt: skip
    """Fit one record of a problem. Returns the result and the true values."""
    setup = load("aluminium-3mm", ["controller.law=off", *problem.changes])
    generator = np.random.default_rng(10_000 + seed)
    spoilt = replace(
        problem.spoilt, gain=1.0 + GAIN_SD * float(generator.standard_normal()),
        clock_ppm=CLOCK_SD * float(generator.standard_normal()), offset=0.005,
    )  # fmt: skip
    phase = None
    if problem.under_law:
        phase = float(generator.uniform()) * setup.every_steps
    table = replace(problem.table, sensitivity_uncertainty=GAIN_SD, clock_tolerance_ppm=CLOCK_SD)
    quantities = [problem.quantity, *filter(None, [problem.second])]
    records = by_one_clock(
        [_truth(setup, replace(problem, quantity=q), phase) for q in quantities], spoilt, seed,
        table, problem.rate_hz, problem.quiet_s,
    )  # fmt: skip
    base = setup
    if problem.fitted is not None:
        base = load("aluminium-3mm", ["controller.law=off", *problem.fitted])
    true = {}
    for key in problem.keys:
        true[key] = start_value(setup if not problem.wrong else base, key)
    true |= problem.true
    if problem.start != 1.0:
        base = moved(base, true, problem.start, generator)
    return fit(
        base, records, [parse_free_key(base, key) for key in problem.keys], exact=exact
    ), true


_seen: dict[Any, Any] = {}


def _truth(setup: Setup, problem: Problem, phase: float | None) -> Any:
    if phase is not None:
        return truth(setup, problem.quantity, problem.duration_s, problem.chain, phase=phase)
    key = (problem.changes, problem.quantity, problem.duration_s, problem.chain)
    if key not in _seen:
        accuracy = 1e-4 if problem.duration_s > 5e-3 or setup.theory == "3d" else 1e-5
        _seen[key] = truth(setup, problem.quantity, problem.duration_s, problem.chain, accuracy)
    return _seen[key]


def summary(name: str, seeds: int, exact: bool = False) -> Summary:
    """Run a problem with so many seeds and count what its intervals cover."""
    one = PROBLEMS[name]
    return synthetic_fits.summary(name, one.wrong, one.keys, seeds, partial(run, one, exact=exact))


_QUICK = ("noise 3e-4", "yield fitted elastic")


def main(
    folder: OutDirOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds a problem (2 with --quick).")] = 100,
    exact: ExactOption = False,
    only: OnlyOption = None,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Count how often the intervals of `hertzloop fit` hold the truth, on synthetic records.

    The truth is made with other steps and more modes than the fit uses. Every seed has its own
    noise, gain, clock and phase of samples. With --quick there are two problems. The one of a plate
    with other edges takes 20 s a seed and runs with --only "v_p 1 ms, edges cfcf".

    Example: python -m benchmarks.fit_coverage --quick
    """
    names = only or (_QUICK if quick else [name for name in PROBLEMS if name != _LONG])
    found = summaries(
        "fit_coverage", folder, json_file, names, tuple(PROBLEMS),
        lambda name: summary(name, 2 if quick else seeds, exact),
    )  # fmt: skip
    right, wrong = [s for s in found if not s.wrong], [s for s in found if s.wrong]
    conclude(
        f"The 95 % intervals hold the true value in "
        f"{share(sum(s.held for s in right), sum(s.values for s in right))}, and a wrong class of "
        f"models is told in {share(sum(s.told for s in wrong), sum(s.seeds for s in wrong))}."
    )


if __name__ == "__main__":
    start("benchmarks.fit_coverage")
