"""What the programs that fit synthetic records share: records, starts, counts and tables."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from benchmarks.program import median
from benchmarks.results import Results
from benchmarks.synthetic_records import Spoilt, measured
from hertzloop.cli.terminal import fail, out
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.simulated_impact import ObservedSignal
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

ExactOption = Annotated[bool, typer.Option("--exact", help="Take the model as exact.")]
OnlyOption = Annotated[
    list[str] | None, typer.Option("--only", help="Run only this problem; repeatable.")
]
GAIN_SD, CLOCK_SD = 0.01, 25.0
_OTHER_NOISE, _ZERO_S = 100_000, 0.004  # of another channel: seeds later, and the common time

Fit = Callable[[int], tuple[FitResult, dict[str, float]]]  # of a seed, with the true values


def by_one_clock(
    seen: Sequence[ObservedSignal],
    spoilt: Spoilt,
    seed: int,
    tables: Mapping[str, Measurement],
    rate_hz: float,
    quiet_s: float,
) -> list[Record]:
    """Return the channels of one drop.

    Args:
        seen: their noiseless quantities.
        spoilt: what the measurement adds.
        seed: of the noise.
        tables: what a channel says of itself, by quantity.
        rate_hz: samples per second.
        quiet_s: length before the touch, s.
    """
    clock = "daq" if len(seen) > 1 else ""
    return [
        measured(
            one,
            spoilt,
            seed + number * _OTHER_NOISE,
            rate_hz=rate_hz,
            quiet_s=quiet_s,
            name=one.quantity,
            table=replace(tables[one.quantity], quantity=one.quantity),
            clock=clock,
            zero_s=_ZERO_S if clock else None,
        )
        for number, one in enumerate(seen)
    ]


def known_gain_and_clock(table: Measurement) -> Measurement:
    """A table that states the priors of gain and clock from which `spoilt` draws."""
    return replace(table, sensitivity_uncertainty=GAIN_SD, clock_tolerance_ppm=CLOCK_SD)


def drawn_gain_and_clock(spoilt: Spoilt, generator: np.random.Generator) -> Spoilt:
    """The same measurement with gain and clock drawn from their priors, and an offset."""
    return replace(
        spoilt,
        gain=1.0 + GAIN_SD * float(generator.standard_normal()),
        clock_ppm=CLOCK_SD * float(generator.standard_normal()),
        offset=0.005,
    )


def moved(
    setup: Setup, true: Mapping[str, float], factor: float, generator: np.random.Generator
) -> Setup:
    """Return a setup whose keys are off by a factor, up or down at random."""
    signs = generator.choice([-1.0, 1.0], size=len(true))
    pairs = zip(true.items(), signs, strict=True)
    return setup.vary({key: value * factor**sign for (key, value), sign in pairs})


@dataclass(frozen=True)
class Summary:
    """What the intervals of a problem's seeds covered.

    `wrong`: whether the model is of another class than the truth. `covered`: seeds whose interval
    holds the true value, by key; `whole`: those that hold all. `models`: seeds by verdict on the
    class of models. `rms_error`: of the values, relative. `half_width_percent`: median. `misses`:
    each seed whose interval does not hold the truth, with its distance in standard deviations, or
    with its error.
    """

    problem: str
    wrong: bool
    seeds: int
    covered: dict[str, int]
    whole: int
    models: dict[str, int]
    rms_error: dict[str, float]
    half_width_percent: dict[str, float]
    median_wall_s: float
    misses: list[str]

    @property
    def told(self) -> int:
        """Seeds whose verdict on the class of models is right."""
        return self.models.get("does not fit" if self.wrong else "fits", 0)

    @property
    def held(self) -> int:
        """True values that an interval holds."""
        return sum(self.covered.values())

    @property
    def values(self) -> int:
        """True values."""
        return self.seeds * len(self.covered)


def summary(problem: str, wrong: bool, keys: Sequence[str], seeds: int, run: Fit) -> Summary:
    """Fit so many seeds of a problem and count what the intervals cover."""
    covered = dict.fromkeys(keys, 0)
    errors: dict[str, list[float]] = {key: [] for key in keys}
    widths: dict[str, list[float]] = {key: [] for key in keys}
    models: dict[str, int] = {}
    whole, misses, results = 0, [], []
    for seed in range(seeds):
        try:
            result, true = run(seed)
        except ValueError as error:
            misses.append(f"seed {seed}: {error}")
            continue
        results.append(result)
        models[str(result.model)] = models.get(str(result.model), 0) + 1
        held = {
            e.key: (e.low or 0.0) <= true[e.key] <= (e.high or math.inf) for e in result.estimates
        }
        whole += all(held.values())
        for e in result.estimates:
            errors[e.key].append(e.value / true[e.key] - 1.0)
            widths[e.key].append(e.half_width_percent or math.inf)
            covered[e.key] += held[e.key]
            if not held[e.key]:
                off = math.log(e.value / true[e.key]) if e.value else math.nan
                off /= e.sd_log or math.nan
                misses.append(f"seed {seed}: {e.key} = {e.value:.6g}, {off:+.2f} sd")
    return Summary(
        problem,
        wrong,
        seeds,
        covered,
        whole,
        models,
        {k: float(np.sqrt(np.mean(np.square(v)))) for k, v in errors.items() if v},
        {k: median(v) for k, v in widths.items()},
        median(r.wall_s for r in results),
        misses,
    )


def check_names(names: Sequence[str], known: Sequence[str]) -> None:
    """End the program for a problem that is not known."""
    for name in names:
        if name not in known:
            fail(f"--only = {name}: unknown problem. Use one of {', '.join(known)}.", 2)


def report(results: Results, program: str, found: Sequence[Summary]) -> None:
    """Write and print the summaries of all problems."""
    rows = [
        (
            s.problem,
            key,
            held,
            s.seeds,
            100.0 * s.rms_error.get(key, math.nan),
            s.half_width_percent[key],
            s.told,
            s.median_wall_s,
        )
        for s in found
        for key, held in s.covered.items()
    ]
    headings = ("problem", "key", "held", "of", "rms error %", "half-width %", "class told", "s")
    results.write_rows(program, headings, rows)
    formats = [f"{{[{i}]{':.3g}' if i in (4, 5, 7) else '}'}" for i in range(len(headings))]
    columns = dict(zip(headings, formats, strict=True))
    results.table("fits of synthetic records", columns, rows, text=2)
    for s in found:
        for miss in s.misses:
            out.say(f"{s.problem}, {miss}")
