"""What the programs that fit synthetic records share: records, starts, counts and tables."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.program import (
    bars,
    check_json,
    compile_first,
    fail,
    median,
    number_table,
    out,
    results_in,
    tracked,
    write_json,
    written,
)
from benchmarks.synthetic_records import Spoilt, measured
from hertzloop.identification.fit.observation import ObservedSignal
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.records.measurement import Measurement
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup
from hertzloop.studies.words import write_rows

ExactOption = Annotated[bool, typer.Option("--exact", help="Take the model as exact.")]
OnlyOption = Annotated[
    list[str] | None, typer.Option("--only", help="Run only this problem; repeatable.")
]
GAIN_SD, CLOCK_SD = 0.01, 25.0
_OTHER_NOISE, _ZERO_S = 100_000, 0.004  # of another channel: seeds later, and the common time
_COLUMNS = ("problem", "key", "held", "of", "rms_error_percent", "half_width_percent", "told",
            "residual_over_noise", "simulations", "wall_s")  # fmt: skip

Fit = Callable[[int], tuple[FitResult, dict[str, float]]]  # of a seed, with the true values


def by_one_clock(
    seen: Sequence[ObservedSignal], spoilt: Spoilt, seed: int, table: Measurement, rate_hz: float,
    quiet_s: float, tables: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Record]:  # fmt: skip
    """Return the channels of one drop.

    Args:
        seen: their noiseless quantities.
        spoilt: what the measurement adds.
        seed: of the noise.
        table: what all channels say of themselves.
        rate_hz: samples per second.
        quiet_s: length before the touch, s.
        tables: other keys of a channel's table, by quantity.
    """
    several = len(seen) > 1
    return [
        measured(
            one, spoilt, seed + number * _OTHER_NOISE, rate_hz=rate_hz, quiet_s=quiet_s,
            table=replace(table, quantity=one.quantity, clock="daq" if several else None,
                          **(tables or {}).get(one.quantity, {})),
            zero_s=_ZERO_S if several else None, name=one.quantity,
        )
        for number, one in enumerate(seen)
    ]  # fmt: skip


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
    median_residual_over_noise: float
    median_evaluations: float
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


def summary(
    problem: str, wrong: bool, keys: Sequence[str], seeds: int, run: Fit, first: int = 0
) -> Summary:
    """Fit so many seeds of a problem, from the first, and count what the intervals cover."""
    covered = dict.fromkeys(keys, 0)
    errors: dict[str, list[float]] = {key: [] for key in keys}
    widths: dict[str, list[float]] = {key: [] for key in keys}
    models: dict[str, int] = {}
    whole, misses, results = 0, [], []
    for seed in range(first, first + seeds):
        try:
            result, true = run(seed)
        except ValueError as error:
            misses.append(f"seed {seed}: {error}")
            continue
        results.append(result)
        models[str(result.model)] = models.get(str(result.model), 0) + 1
        held = {e.key: (e.low or 0.0) <= true[e.key] <= (e.high or math.inf)
                for e in result.estimates}  # fmt: skip
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
        problem, wrong, seeds, covered, whole, models,
        {k: float(np.sqrt(np.mean(np.square(v)))) for k, v in errors.items() if v},
        {k: median(v) for k, v in widths.items()},
        median(r.residual_over_noise for r in results), median(r.evaluations for r in results),
        median(r.wall_s for r in results), misses,
    )  # fmt: skip


def summaries(
    program: str, folder: Path | None, json_file: Path | None, names: Sequence[str],
    known: Sequence[str], of: Callable[[str], Summary],
) -> list[Summary]:  # fmt: skip
    """Summarise problems, write them into a folder and print them.

    Args:
        program: its name.
        folder: that the user named.
        json_file: that the user named.
        names: of the problems to run.
        known: all names.
        of: summary of a problem by its name.
    """
    check_json(json_file)
    for name in names:
        if name not in known:
            fail(f"--only = {name}: unknown problem. Use one of {', '.join(known)}.", 2)
    with results_in(folder, program) as made:
        compile_first()
        found = [of(name) for name in tracked("problems", names)]
        rows = [(s.problem, key, n, s.seeds, 100.0 * s.rms_error.get(key, math.nan),
                 s.half_width_percent[key], s.told, s.median_residual_over_noise,
                 s.median_evaluations, s.median_wall_s)
                for s in found for key, n in s.covered.items()]  # fmt: skip
        write_rows(made / f"{program}.csv", _COLUMNS, (list(row) for row in rows))
        bars(made / f"{program}.png", "Coverage", "intervals that hold the truth (%)",
             [(f"{name}: {key.partition('.')[2]}", 100.0 * n / of)
              for name, key, n, of, *_ in rows])  # fmt: skip
    headings = ("problem", "key", "held", "of", "rms error %", "half-width %", "class told",
                "residual", "simulations", "s")  # fmt: skip
    cells = [(*row[:2], *(f"{x:.3g}" for x in row[2:])) for row in rows]
    out.print(number_table("fits of synthetic records", headings, cells, text=2))
    for s in found:
        for miss in s.misses:
            out.print(f"{s.problem}, {miss}", soft_wrap=True)
    written(made, f"{program}.csv", f"{program}.png")
    write_json(json_file, {"problems": [asdict(s) for s in found]})
    return found
