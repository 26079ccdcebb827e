"""Coverage of the intervals of `hertzloop fit`, and its verdicts, on synthetic records.

The truth is made with other steps and more modes than the fit uses. Every seed has its own noise,
gain, clock and phase of samples.
"""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    compile_first,
    conclude,
    fail,
    median,
    number_table,
    out,
    results_in,
    share,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.setup import Setup, load
from hertzloop.studies.fit.fit import FitResult, fit, free_of, value_of
from hertzloop.studies.fit.observation import Chain
from hertzloop.studies.fit.records import Measured, Record
from hertzloop.studies.fit.synthetic import Spoilt, measured, truth
from hertzloop.studies.words import write_rows

_YIELDS = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=8e8")
_GAIN_SD, _CLOCK_SD = 0.01, 25.0
_OTHER_NOISE, _ZERO_S = 100_000, 0.004  # of a second channel: seeds later, and the common time
_PLAIN, _NO_CHAIN, _NO_TABLE = Spoilt(), Chain(), Measured()


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
    chain: Chain = _NO_CHAIN
    table: Measured = _NO_TABLE
    rate_hz: float = 2e6
    quiet_s: float = 250e-6
    second: str | None = None
    true: dict[str, float] = field(default_factory=dict)

    @property
    def under_law(self) -> bool:
        """Whether the records are of a drop under control."""
        return any(change.startswith("controller.law=") for change in self.changes)


_LOW_PASS = Chain(low_pass_hz=100e3)
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
        quiet_s=400e-6, chain=_LOW_PASS, table=Measured(low_pass_hz=100e3),
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
        chain=_LOW_PASS, table=Measured(low_pass_hz=100e3), fitted=(), wrong=True,
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


def run(problem: Problem, seed: int) -> tuple[FitResult, dict[str, float]]:
    """Fit one record of a problem. Returns the result and the true values."""
    setup = load("aluminium-3mm", ["controller.law=off", *problem.changes])
    generator = np.random.default_rng(10_000 + seed)
    spoilt = replace(
        problem.spoilt, gain=1.0 + _GAIN_SD * float(generator.standard_normal()),
        clock_ppm=_CLOCK_SD * float(generator.standard_normal()), offset=0.005,
    )  # fmt: skip
    phase = None
    if problem.under_law:
        phase = float(generator.uniform()) * setup.every_steps
    table = replace(
        problem.table, sensitivity_uncertainty=_GAIN_SD, clock_tolerance_ppm=_CLOCK_SD,
        quantity=problem.quantity, clock="daq" if problem.second else None,
    )  # fmt: skip
    records: list[Record] = []
    for number, quantity in enumerate([problem.quantity, *filter(None, [problem.second])]):
        seen = _truth(setup, replace(problem, quantity=quantity), phase)
        records.append(measured(
            seen, spoilt, seed + number * _OTHER_NOISE, rate_hz=problem.rate_hz,
            quiet_s=problem.quiet_s, table=replace(table, quantity=quantity),
            zero_s=_ZERO_S if problem.second else None,
        ))  # fmt: skip
    base = setup
    if problem.fitted is not None:
        base = load("aluminium-3mm", ["controller.law=off", *problem.fitted])
    true = {}
    for key in problem.keys:
        true[key] = value_of(setup if not problem.wrong else base, key)
    true |= problem.true
    if problem.start != 1.0:
        signs = generator.choice([-1.0, 1.0], size=len(true))
        base = base.vary({
            key: value * problem.start**sign
            for (key, value), sign in zip(true.items(), signs, strict=True)
        })  # fmt: skip
    return fit(base, records, [free_of(base, key) for key in problem.keys]), true


_seen: dict[Any, Any] = {}


def _truth(setup: Setup, problem: Problem, phase: float | None) -> Any:
    if phase is not None:
        return truth(setup, problem.quantity, problem.duration_s, problem.chain, phase=phase)
    key = (problem.changes, problem.quantity, problem.duration_s, problem.chain)
    if key not in _seen:
        accuracy = 1e-4 if problem.duration_s > 5e-3 or setup.theory == "3d" else 1e-5
        _seen[key] = truth(setup, problem.quantity, problem.duration_s, problem.chain, accuracy)
    return _seen[key]


@dataclass(frozen=True)
class Summary:
    """What the intervals of a problem's seeds covered.

    `covered`: seeds whose interval holds the true value, by key. `models`: seeds by verdict on the
    class of models. `rms_error`: of the values, relative. `misses`: each seed whose interval does
    not hold the truth, with its distance in standard deviations, or with its error.
    """

    problem: str
    wrong: bool
    seeds: int
    covered: dict[str, int]
    models: dict[str, int]
    rms_error: dict[str, float]
    median_residual_over_noise: float
    median_evaluations: float
    median_wall_s: float
    misses: list[str]

    @property
    def told(self) -> int:
        """Seeds whose verdict on the class of models is right."""
        return self.models.get("does not fit" if self.wrong else "fits", 0)


def summary(name: str, seeds: int) -> Summary:
    """Run a problem with so many seeds and count what its intervals cover."""
    problem = PROBLEMS[name]
    covered = dict.fromkeys(problem.keys, 0)
    errors: dict[str, list[float]] = {key: [] for key in problem.keys}
    models: dict[str, int] = {}
    misses, ratios, walls, counts = [], [], [], []
    for seed in range(seeds):
        try:
            result, true = run(problem, seed)
        except ValueError as error:
            misses.append(f"seed {seed}: {error}")
            continue
        models[str(result.model)] = models.get(str(result.model), 0) + 1
        ratios.append(result.residual_over_noise)
        walls.append(result.wall_s)
        counts.append(result.evaluations)
        for e in result.estimates:
            low, high = e.low or 0.0, e.high or math.inf
            errors[e.key].append(e.value / true[e.key] - 1.0)
            if low <= true[e.key] <= high:
                covered[e.key] += 1
            elif not problem.wrong:
                sd = e.sd_log or math.nan
                off = math.log(e.value / true[e.key]) if e.value else math.nan
                misses.append(f"seed {seed}: {e.key} = {e.value:.6g}, {off / sd:+.2f} sd")
    rms = {k: float(np.sqrt(np.mean(np.square(v)))) for k, v in errors.items() if v}
    return Summary(
        name, problem.wrong, seeds, covered, models, rms, median(ratios), median(counts),
        median(walls), misses,
    )  # fmt: skip


_QUICK = ("noise 3e-4", "yield fitted elastic")


def main(
    folder: OutDirOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds a problem (2 with --quick).")] = 100,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Run only this problem; repeatable.")
    ] = None,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Count how often the intervals of `hertzloop fit` hold the truth, on synthetic records.

    The truth is made with other steps and more modes than the fit uses. Every seed has its own
    noise, gain, clock and phase of samples. With --quick there are two problems. The one of a plate
    with other edges takes 20 s a seed and runs with --only "v_p 1 ms, edges cfcf".

    Example: python -m benchmarks.fit_coverage --quick
    """
    check_json(json_file)
    names = tuple(only or (_QUICK if quick else [name for name in PROBLEMS if name != _LONG]))
    for name in names:
        if name not in PROBLEMS:
            fail(f"--only = {name}: unknown problem. Use one of {', '.join(PROBLEMS)}.", 2)
    with results_in(folder, "fit_coverage") as made:
        compile_first()
        found = [summary(name, 2 if quick else seeds) for name in tracked("problems", names)]
        rows = [(s.problem, key, n, s.seeds, s.rms_error.get(key, math.nan), s.told,
                 s.median_residual_over_noise, s.median_evaluations, s.median_wall_s)
                for s in found for key, n in s.covered.items()]  # fmt: skip
        write_rows(made / "fit_coverage.csv", _COLUMNS, (list(row) for row in rows))
        shares = [(f"{name}: {key.partition('.')[2]}", 100.0 * n / of)
                  for name, key, n, of, *_ in rows if not PROBLEMS[name].wrong]  # fmt: skip
        bars(made / "fit_coverage.png", "Coverage", "intervals that hold the truth (%)", shares)
    headings = ("problem", "key", "covered", "of", "rms error", "class told", "residual",
                "simulations", "s")  # fmt: skip
    cells = [(*row[:2], *(f"{x:.3g}" for x in row[2:])) for row in rows]
    out.print(number_table("fits of synthetic records", headings, cells, text=2))
    for s in found:
        for miss in s.misses:
            out.print(f"{s.problem}, {miss}", soft_wrap=True)
    written(made, "fit_coverage.csv", "fit_coverage.png")
    right = [s for s in found if not s.wrong]
    wrong = [s for s in found if s.wrong]
    held = sum(sum(s.covered.values()) for s in right)
    conclude(
        f"The 95 % intervals hold the true value in "
        f"{share(held, sum(s.seeds * len(s.covered) for s in right))}, and a wrong class of models "
        f"is told in {share(sum(s.told for s in wrong), sum(s.seeds for s in wrong))}."
    )
    write_json(json_file, {"problems": [asdict(s) for s in found]})


_COLUMNS = ("problem", "key", "covered", "seeds", "rms_error", "class_told", "residual_over_noise",
            "simulations", "wall_s")  # fmt: skip


if __name__ == "__main__":
    start("benchmarks.fit_coverage")
