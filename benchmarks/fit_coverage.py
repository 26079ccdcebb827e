"""Coverage of the intervals of `hertzloop fit`, and its verdicts, on synthetic records.

The truth is made with other steps and more modes than the fit uses. Every seed has its own noise,
gain, clock and phase of samples.
"""

import tomllib
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from pydantic import TypeAdapter

from benchmarks import synthetic_fits
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
)
from benchmarks.synthetic_records import Spoilt, truth
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key, start_value
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.simulated_impact import MeasuringChain
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.scene.setup import Setup

_PLAIN = Spoilt()


@dataclass(frozen=True)
class Problem:
    """A question to a record: the true scene, what is recorded, the keys, and the start.

    `changes`: of aluminium-3mm. `start`: factor on the true values that the fit starts from.
    `fitted`: changes of the model that is fitted, where its class is another one. `wrong`: whether
    its class is the wrong one. `second`: quantity of another channel by the same clock. `true`: of
    keys that the true scene says otherwise. `low_pass_hz`: filter of the record, which it states.
    """

    changes: tuple[str, ...]
    quantity: str
    duration_s: float
    keys: tuple[str, ...]
    spoilt: Spoilt = _PLAIN
    start: float = 1.0
    fitted: tuple[str, ...] | None = None
    wrong: bool = False
    low_pass_hz: float | None = None
    rate_hz: float = 2e6
    quiet_s: float = 250e-6
    second: str | None = None
    true: dict[str, float] = field(default_factory=dict)

    @property
    def under_law(self) -> bool:
        """Whether the records are of a drop under control."""
        return any(change.startswith("controller.law=") for change in self.changes)


_TABLES = tomllib.loads(Path(__file__).with_name("fit_problems.toml").read_text("utf-8"))
PROBLEMS = TypeAdapter(dict[str, Problem]).validate_python(_TABLES)
_LONG = "v_p 1 ms, edges cfcf"  # minutes a seed
_LATENCY = "latency, force 90 us"
_CLASSES = [name for name, problem in PROBLEMS.items() if problem.wrong]
_NOISY = [(_LATENCY, 0.05)] + [
    (name, noise)
    for noise in (0.01, 0.001)
    for name in ("force 90 us", "force 70 us, elastic", "v_p 1 ms", *_CLASSES)
]
PROBLEMS |= {
    f"{name}, noise {100.0 * noise:g} %": replace(PROBLEMS[name], spoilt=Spoilt(noise=noise))
    for name, noise in _NOISY
}


def run(problem: Problem, seed: int, exact: bool = False) -> tuple[FitResult, dict[str, float]]:
    """Fit one record of a problem. Returns the result and the true values."""
    setup = load("aluminium-3mm", ["controller.law=off", *problem.changes])
    generator = np.random.default_rng(10_000 + seed)
    spoilt = drawn_gain_and_clock(problem.spoilt, generator)
    phase = None
    if problem.under_law:
        phase = float(generator.uniform()) * setup.sensor.every_steps
    table = known_gain_and_clock(Measurement(low_pass_hz=problem.low_pass_hz))
    quantities = [problem.quantity, *filter(None, [problem.second])]
    records = by_one_clock(
        [_truth(setup, replace(problem, quantity=q), phase) for q in quantities],
        spoilt,
        seed,
        dict.fromkeys(quantities, table),
        problem.rate_hz,
        problem.quiet_s,
    )
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
    chain = MeasuringChain(low_pass_hz=problem.low_pass_hz)
    if phase is not None:
        return truth(setup, problem.quantity, problem.duration_s, chain, phase=phase)
    key = (problem.changes, problem.quantity, problem.duration_s, chain)
    if key not in _seen:
        accuracy = 1e-4 if problem.duration_s > 5e-3 else 1e-5
        _seen[key] = truth(setup, problem.quantity, problem.duration_s, chain, accuracy)
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
) -> None:
    """Count how often the intervals of `hertzloop fit` hold the truth, on synthetic records.

    The truth is made with other steps and more modes than the fit uses. Every seed has its own
    noise, gain, clock and phase of samples. With --quick there are two problems. The one of a plate
    with other edges takes minutes a seed and runs with --only "v_p 1 ms, edges cfcf".

    Example: python -m benchmarks.fit_coverage --quick
    """
    names = only or (_QUICK if quick else [name for name in PROBLEMS if name != _LONG])
    check_names(names, list(PROBLEMS))
    with results_in(folder, "fit_coverage", "modal") as results:
        found = [summary(name, 2 if quick else seeds, exact) for name in tracked("problems", names)]
        report(results, "fit_coverage", found)
        right, wrong = [s for s in found if not s.wrong], [s for s in found if s.wrong]
        held = share(sum(s.held for s in right), sum(s.values for s in right))
        told = share(sum(s.told for s in wrong), sum(s.seeds for s in wrong))
        results.conclude(
            f"The 95 % intervals hold the true value in {held}, and a wrong class of models is "
            f"told in {told}."
        )


if __name__ == "__main__":
    start("benchmarks.fit_coverage")
