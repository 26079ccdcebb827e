"""The linear margin against independent answers.

The count of unstable poles of random loops against all poles and against dense eigenvalues; growth
against the compiled closed loop in flight; and laws of a user that are linear, or nearly so.
"""

import csv
import math
import tempfile
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    SeedOption,
    median,
    progress,
    start,
)
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.terminal import out
from hertzloop.closed_loop.parts import series_under
from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.plant.state_kernels import STEP
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.growth import growth_of
from hertzloop.studies.margin.identify import NotLinearError, law_filter
from hertzloop.studies.margin.linear import TransferFunction
from hertzloop.studies.margin.loop import loops_of
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import Loop

_E_FOLDS = 60.0
_SHOWS = 5.0  # e-folds over the flight from which the sign of a growth must be right
_CLOSE = 0.02  # relative difference of a slower growth that still counts as agreement
_ON_CIRCLE = 1e-13
_BASES = ("aluminium-3mm", "aluminium-20mm", "offcentre-6mm", "oak-20mm")
# A fast sphere flies for long enough to show a slow growth, and the loop in flight is the same.
_FLIGHT = {"run.lead_in_s": 1.0, "run.duration_s": 1.01, "sphere.drop_height_m": 20.0}
_BESIDE = (
    "controller.law=velocity_feedback",
    "sensors.quantity=v_p",
    "run.accuracy=0.05",
    "run.step_ns=5000",
)
_BEATS_PER_S = 0.1


@dataclass(frozen=True)
class Check:
    """One comparison of the margin with an independent answer.

    Attributes:
        kind: which comparison it belongs to.
        case: what was compared.
        predicted: number of the margin.
        found: number of the other method.
        agrees: whether both agree; None where the case cannot tell.
        why: explanation of a miss, or of a case that cannot tell.
    """

    kind: str
    case: str
    predicted: float
    found: float
    agrees: bool | None
    why: str = ""


def hard_loop(
    rng: np.random.Generator, modes: int | None = None
) -> tuple[TransferFunction, TransferFunction, int]:
    """Return a random loop that is hard to count: loss factors from 1e-6 to 0.03, near-double and
    hardly coupled modes, and a delay of up to 200 samples."""
    n = modes or int(rng.integers(1, 40))
    loss = 10.0 ** rng.uniform(-6.0, -1.5)
    even = rng.random() < 0.5
    omega = rng.uniform(0.001, 3.1, n) if even else 10.0 ** rng.uniform(-3.0, math.log10(3.1), n)
    omega.sort()
    if n > 2 and rng.random() < 0.5:
        i = int(rng.integers(1, n))
        omega[i] = omega[i - 1] * (1.0 + 10.0 ** rng.uniform(-9.0, -3.0))
    poles = np.exp((-0.5 * loss + 1j) * omega)
    size = 10.0 ** rng.uniform(-6.0, 0.0, n) if rng.random() < 0.4 else np.ones(n)
    sign = rng.choice([1, 1, 1, -1], n) if rng.random() < 0.3 else 1
    residues = 0.5 * size * sign * (1.0 + 0.1j * rng.standard_normal(n))
    fir = np.array([0.0, rng.uniform(0.0, 2.0) * (rng.random() < 0.5), 0.0])
    if rng.random() < 0.3:
        fir[2] = rng.uniform(-1.0, 1.0)
    gain = 10.0 ** rng.uniform(-4.0, 0.5) * (-1.0 if rng.random() < 0.8 else 1.0)
    own = own_residue = np.empty(0, complex)
    if rng.random() < 0.5:
        own = np.array([rng.uniform(0.0, 0.99) + 0j])
        own_residue = np.array([rng.uniform(-1.0, 1.0) * abs(gain) + 0j])
    delay = int(rng.integers(0, 200 if rng.random() < 0.5 else 5))
    law = TransferFunction(own, own_residue, np.array([gain]))
    return TransferFunction.of_modes(poles, residues, fir), law, delay


def eigenvalues(loop: Loop, delay: int) -> np.ndarray:
    """Return the closed-loop poles as eigenvalues of a dense matrix."""
    plant, law = loop.plant, loop.law
    p, residues = plant.poles, plant.residues
    n, m, late = len(p), len(law.poles), delay + 2
    total, first = n + m + late, n + m
    # State: plant, law, commands of the last `late` samples, the newest first.
    a = np.zeros((total, total), complex)
    seen = np.zeros(total, complex)
    seen[:n] = 1.0
    seen[first + delay] += plant.fir[1]
    seen[first + delay + 1] += plant.fir[2]
    command = law.fir[0] * seen
    command[n:first] += 1.0
    if delay:
        a[:n, first + delay - 1] = residues
    else:
        a[:n] = residues[:, None] * command
    a[np.arange(n), np.arange(n)] += p
    a[n:first] = law.residues[:, None] * seen
    a[np.arange(n, first), np.arange(n, first)] += law.poles
    a[first] = command
    a[np.arange(first + 1, total), np.arange(first, total - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(a))


def counted(
    kind: str, case: str, loop: Loop, delay: int, poles: np.ndarray | None, rounding: float
) -> Check:
    """Return the check of a count; `rounding`: distance from the circle that cannot be told."""
    count = int(loop.table.unstable(np.array([delay]))[0])
    if poles is None:
        return Check(kind, case, count, math.nan, None, "the poles did not converge: undecided")
    size = np.abs(poles)
    least, most = np.sum(size > 1.0 + rounding), np.sum(size > 1.0 - rounding)
    agrees = bool(least <= count <= most)
    return Check(kind, case, count, float(least), agrees, "" if agrees else "the counts differ")


def synthetic(seed: int, loops: int) -> Iterator[Check]:
    """Yield the checks of random loops against all their poles."""
    for i in range(loops):
        plant, law, delay = hard_loop(np.random.default_rng([seed, i]))
        poles = closed_loop_poles(plant, law, delay)
        case = f"loop {i}, {len(plant.poles)} modes, delay {delay}"
        yield counted("all poles", case, Loop(plant, law), delay, poles, _ON_CIRCLE)


def dense(seed: int, sizes: tuple[int, ...]) -> Iterator[Check]:
    """Yield the checks of random loops against dense eigenvalues."""
    for i, modes in enumerate(sizes):
        plant, law, delay = hard_loop(np.random.default_rng([seed, 1_000_000 + i]), modes)
        loop = Loop(plant, law)
        poles = eigenvalues(loop, delay)
        yield counted(
            "eigenvalues", f"loop {i}, {modes} modes, delay {delay}", loop, delay, poles, 1e-11
        )


def random_scene(rng: np.random.Generator) -> tuple[str, Setup]:
    """Return a random scene with a linear law and its settings."""
    base = str(rng.choice(_BASES))
    law = str(rng.choice(["velocity_feedback", "velocity_feedback", "acceleration_feedback"]))
    settings = [
        f"controller.law={law}",
        f"sensors.quantity={'v_p' if law[0] == 'v' else 'acceleration'}",
        f"controller.kappa={10.0 ** rng.uniform(-1.3, 0.0):.3f}",
        f"controller.latency_us={int(rng.integers(0, 20))}",
        f"run.accuracy={rng.choice(['0.001', '0.003', '0.01'])}",
        f"plate.loss_factor={10.0 ** rng.uniform(-4, -2):.2e}",
    ]
    for key, low, high in (
        ("actuator.bandwidth_hz", 2e4, 3e5),
        ("sensors.low_pass_hz", 2e4, 3e5),
        ("sensors.ac_coupling_hz", 5.0, 500.0),
        ("sensors.resonance_hz", 4e4, 2e5),
    ):
        if rng.random() < 0.2:
            settings.append(f"{key}={math.exp(rng.uniform(math.log(low), math.log(high))):.0f}")
    if rng.random() < 0.2:
        settings.append(f"actuator.dead_time_us={int(rng.integers(1, 6))}")
    if rng.random() < 0.2:
        settings.append(f"sensors.every_steps={int(rng.integers(2, 5))}")
    name = " ".join([base, *(s.partition(".")[2] for s in settings)])
    return name, load(base, settings).vary({"sensors.bits": "ideal", "controller.bits": "ideal"})


def fastest_per_s(setup: Setup) -> float:
    """Return the growth of the fastest closed-loop pole, 1/s; negative if the loop is stable."""
    loops = loops_of(setup)
    if isinstance(loops, NotLinearError):
        raise loops
    loop, delay = loops.at(setup.signal_path.latency_steps)
    poles = closed_loop_poles(loop.plant, loop.law, delay)
    if poles is None:
        return math.nan
    return math.log(float(np.abs(poles).max())) / (setup.sensor.every_steps * setup.run.step_s)


def growth_of_rows(rows: np.ndarray, step_s: float) -> float:
    """Return the growth of the plate's velocity over the later half of a time series, 1/s."""
    speed, width = rows[ts.V_P], rows.shape[1] // 5
    largest = float(np.abs(speed[-width:]).max())
    if not (largest > 0.0 and math.isfinite(largest)):
        return math.nan
    late = float(np.mean((speed[-width:] / largest) ** 2))
    before = float(np.mean((speed[-3 * width : -2 * width] / largest) ** 2))
    return 0.5 * math.log(late / before) / (2 * width * step_s) if before > 0.0 else math.nan


def simulated_growth_per_s(setup: Setup, expected_per_s: float) -> float:
    """Return the growth of the plate's velocity in the compiled closed loop in flight, 1/s.

    Fifty small random forces excite the plate before the loop is closed. The run lasts for 60
    e-folds of the expected growth, so that the fastest pole dominates, or to the end of the flight.
    """
    steps = int((setup.run.lead_in_s - 1e-4) / setup.run.step_s)
    if expected_per_s:
        steps = min(steps, int(_E_FOLDS / (abs(expected_per_s) * setup.run.step_s)))
    steps = max(steps, 300)
    setup = setup.vary({"sensors.bits": "ideal", "controller.bits": "ideal"})
    setup = setup.with_plate_model("modal").with_steps(steps)
    plant = build_plant(setup)
    size_n = min(math.exp(-expected_per_s * steps * setup.run.step_s), 1e-3)
    series_under(plant, size_n * np.random.default_rng(5).standard_normal(50))
    plant.state.counts[STEP] = 0
    rows = simulate(setup, own_plant=plant).truth
    if rows[ts.F_C].any():
        raise ValueError("the sphere touched the plate within the flight")
    return growth_of_rows(rows, setup.run.step_s)


def compared(kind: str, case: str, setup: Setup) -> Check:
    """Return the check of the sign of a growth in flight, with both growths."""
    flight = setup.vary(_FLIGHT)
    predicted = fastest_per_s(flight)
    if math.isnan(predicted):
        return Check(kind, case, predicted, math.nan, None, "the poles did not converge: undecided")
    try:
        found = simulated_growth_per_s(flight, predicted)
    except (ValueError, SceneError) as error:
        return Check(kind, case, predicted, math.nan, None, str(error))
    folds = abs(predicted) * flight.run.lead_in_s
    if folds < _SHOWS and not abs(found - predicted) <= _CLOSE * abs(predicted):
        why = f"only {folds:.2g} e-folds fit into the flight"
        return Check(kind, case, predicted, found, None, why)
    agrees = (predicted > 0.0) == (found > 0.0)
    return Check(kind, case, predicted, found, agrees, "" if agrees else "the signs differ")


def growth_in_flight(seed: int, scenes: int) -> Iterator[Check]:
    """Yield predicted and simulated growth of random scenes in flight."""
    for i in range(scenes):
        case, setup = random_scene(np.random.default_rng([seed, 2_000_000 + i]))
        yield compared("growth", case, setup)


def beside_the_contact(seed: int, wanted: int) -> Iterator[Check]:
    """Yield growths at the latency limit of random loops that are not collocated, and beyond it, as
    near to it as a second of simulation tells."""
    rng, found = np.random.default_rng(seed), 0

    def checked(setup: Setup, case: str, steps: int, per_s: float) -> Check:
        late = setup.vary({"controller.latency_us": steps * 1e6 * setup.run.step_s})
        grows = simulated_growth_per_s(late, per_s)
        # Right at the limit modes beat.
        agrees = grows > 0.5 * per_s if per_s else grows < _BEATS_PER_S
        why = "" if agrees else "does not grow" if per_s else "grows"
        return Check(
            "beside the contact", f"{case}, latency {steps} steps", per_s, grows, agrees, why
        )

    while found < wanted:
        points = [[float(x) for x in rng.uniform(0.06, 0.44, 2)] for _ in range(3)]
        case = [
            f"plate.contact_point_m={points[0]}",
            f"sensors.point_m={points[1]}",
            f"controller.kappa={float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.8))}",
            *([f"plate.actuator_point_m={points[2]}"] if rng.random() < 0.5 else []),
        ]
        setup = load("oak-20mm", [*case, *_BESIDE]).vary(_FLIGHT)
        limit = margin_of(setup).latency_limit_steps
        if limit is None or not 10 <= limit <= 2000:
            continue
        yield checked(setup, " ".join(case), limit, 0.0)
        for away in range(9):
            steps = limit + 1 + (1 << away >> 1)
            growth = growth_of(
                setup.vary({"controller.latency_us": steps * 1e6 * setup.run.step_s})
            )
            if growth is None or growth.per_s is None or growth.per_s < 4.0:
                continue
            found += 1
            yield checked(setup, " ".join(case), steps, growth.per_s)
            break


_LAW = '''"""A law of the margin's validation."""

senses = "v_p"


class State:
    """What the law remembers."""

    a: float = 0.0
    b: float = 0.0


def command(p, s, samples, i):
    """Force of sample i, N."""
    x = samples[i]
BODY
'''
_LAWS = Path(__file__).with_name("margin_laws.csv")


def laws() -> list[dict[str, str]]:
    """Laws of a user: name, whether it is linear, and the body."""
    with _LAWS.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def own_laws(some: Iterable[dict[str, str]]) -> Iterator[Check]:
    """Yield whether laws of a user are classified rightly."""
    with tempfile.TemporaryDirectory() as folder:
        for i, row in enumerate(some):
            path = Path(folder) / f"law_{i}.py"
            body = textwrap.indent(row["body"], "    ")
            path.write_text(_LAW.replace("BODY", body), encoding="utf-8")
            setup = load("oak-20mm", [f"controller.law={path}", "sensors.quantity=v_p"])
            linear = row["linear"] == "yes"
            try:
                law_filter(setup)
                found, why = True, ""
            except NotLinearError as error:
                found, why = False, str(error)
            yield Check("own law", row["name"], float(linear), float(found), found == linear, why)


def run(seed: int, quick: bool) -> list[Check]:
    """Make all comparisons."""
    sizes = (30, 60) if quick else (25, 50, 100, 200, 200, 300, 300, 400, 500, 600)
    parts = (
        ("random loops", 100 if quick else 2000, lambda n: synthetic(seed, n)),
        ("dense eigenvalues", len(sizes), lambda n: dense(seed, sizes[:n])),
        ("growth in flight", 3 if quick else 50, lambda n: growth_in_flight(seed, n)),
        ("beside the contact", 2 if quick else 40, lambda n: beside_the_contact(seed, n // 2)),
        ("own laws", 4 if quick else 20, lambda n: own_laws(laws()[:: 20 // n])),
    )
    found: list[Check] = []
    for name, count, checks in parts:
        with progress(name, count) as advance:
            for i, check in enumerate(checks(count), 1):
                found.append(check)
                advance(i)
    return found


def relative(checks: Sequence[Check]) -> list[float]:
    """Return the relative differences of growths that both are positive and finite."""
    return [
        abs(c.found / c.predicted - 1.0)
        for c in checks
        if c.predicted > 0.0 and c.agrees and math.isfinite(c.found)
    ]


def main(folder: OutDirOption = None, seed: SeedOption = 1, quick: QuickOption = False) -> None:
    """Compare the linear margin with all poles, simulations and laws whose answer is known.

    Example: python -m benchmarks.margin --quick
    """
    with results_in(folder, "margin", "modal") as results:
        checks = run(seed, quick)
        results.write("margin", checks)
        rows = []
        for kind in dict.fromkeys(c.kind for c in checks):
            some = [c for c in checks if c.kind == kind]
            away = relative(some) if kind == "growth" else []
            counts = [sum(c.agrees is answer for c in some) for answer in (True, False, None)]
            rows.append((kind, len(some), *counts, f"{median(away):.1e}" if away else "-"))
        headings = ("comparison", "cases", "agree", "differ", "cannot tell", "median difference")
        columns = {heading: f"{{[{i}]}}" for i, heading in enumerate(headings)}
        results.table("Linear margin against independent answers", columns, rows)
        for check in checks:
            if not check.agrees:
                out.say(
                    f"{check.kind}: {check.case}: predicted {check.predicted:.5g}, found "
                    f"{check.found:.5g}: {check.why}"
                )
        differ = sum(c.agrees is False for c in checks)
        results.conclude(
            f"The linear margin agrees in {sum(c.agrees is True for c in checks)} of {len(checks)} "
            f"comparisons and differs in {differ}; the others cannot tell."
        )


if __name__ == "__main__":
    start("benchmarks.margin")
