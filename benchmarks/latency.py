"""How much latency, how few bits and how slow a sampler a law survives.

"Survives": takes energy off the plate, against the same impact without control. Critical values
are read off by scanning and bisection, to one step of latency.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import Columns, results_in
from benchmarks.scenes import load
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import TOUCH_PHASE_KEY, phases, spread_of
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.pages import words
from hertzloop.studies.tune.plan import LAWS

_BITS = tuple(range(3, 19))
_WITHIN_DB = 0.5
KAPPA = "controller.kappa"
Energies = Callable[[list[dict[str, Any]]], list[float]]  # of cases, dB; inf: unstable


@dataclass(frozen=True)
class Named:
    """A scene of the tables: its settings, and what its metrics are taken over."""

    name: str
    source: str
    settings: tuple[str, ...]
    span: Span

    def scene(self) -> Setup:
        """The scene, with an ideal line."""
        return load(self.source, [*self.settings, "sensors.bits=ideal"])


# As long as the sphere needs to leave for good, or as the first impact; feedback acts for as long
# as the plate moves, here 0.6 ms.
_SHORT = "run.duration_s=0.0016"
SCENES = (
    Named("aluminium-3mm", "aluminium-3mm", (_SHORT,), "impact"),
    Named("aluminium-3mm, early", "aluminium-3mm", (_SHORT, "controller.v_thr_m_s=-0.6"), "impact"),
    Named("aluminium-20mm", "aluminium-20mm", ("run.duration_s=0.014",), "run"),
    Named("oak-20mm", "oak-20mm", ("run.duration_s=0.02",), "run"),
    Named("offcentre-6mm", "offcentre-6mm", (_SHORT,), "impact"),
    Named("sylomer-20mm", "sylomer-20mm", (), "run"),
)


@dataclass(frozen=True)
class Critical:
    """What a law survives in a scene, alone and one at a time.

    `ideal_db`: plate energy at no latency with an ideal converter; `critical_latency_us`: the
    largest latency up to which it is below that without control, nan if it never is, inf if it
    still is at the largest latency tried, `most_latency_us`; `critical_bits`: fewest bits from
    which on every finer converter takes energy off the plate (nan: none does);
    `settled_bits`: the same for plate energies within 0.5 dB of the ideal converter's. All that at
    a touch in the middle of a step; `mean_db`, `least_db`, `most_db`: of the ideal one over touch
    phases, `least_latency_us`, `most_survived_us`: range of the critical latency over them.
    """

    scene: str
    law: str
    kappa: float
    ideal_db: float
    ideal_rebound_percent: float
    critical_latency_us: float
    most_latency_us: float
    critical_bits: float
    settled_bits: float
    mean_db: float
    least_db: float
    most_db: float
    least_latency_us: float
    most_survived_us: float


def rigid_time_us(scene: Setup) -> float:
    """Contact time on a rigid plate, us: the scale of a scene's latencies."""
    spec = scene.plant
    seconds = rigid_contact_time_s(
        spec.sphere.mass_kg, spec.contact.stiffness, spec.sphere.impact_speed_m_s
    )
    return 1e6 * seconds


def latencies_of(scene: Setup, count: int) -> list[int]:
    """Whole latencies from 0 to twice the contact time on a rigid plate, or 1.2 times that on the
    scene's, but less than half the run; us."""
    most = max(2.0 * rigid_time_us(scene), 1.2 * _contact_us(scene))
    most = min(most, 0.45e6 * (scene.run.duration_s - scene.run.lead_in_s))
    step = max(1, math.ceil(most / count))
    return [i * step for i in range(count + 1)]


@lru_cache(maxsize=16)
def _contact_us(scene: Setup) -> float:
    return metrics_of_case(scene.without_control()).contact_us


def law_values(law: str, settings: Sequence[str] = ()) -> dict[str, Any]:
    """Feedback of velocity is tried at half the gain, unless `settings` name one: at 0.8 of the
    plate's impedance it is unstable without latency."""
    values: dict[str, Any] = {"controller.law": law}
    given = any(setting.partition("=")[0].strip() == KAPPA for setting in settings)
    return values | {KAPPA: 0.4} if law.endswith("feedback") and not given else values


def _first_failure(better: list[bool]) -> int:
    """Index of the first value that is not better; the length if all are."""
    return better.index(False) if False in better else len(better)


def _fewest_bits(good: list[bool]) -> float:
    """Fewest of _BITS from which on all are good."""
    last_bad = max((i for i, ok in enumerate(good) if not ok), default=-1)
    return float(_BITS[last_bad + 1]) if last_bad + 1 < len(_BITS) else math.nan


def bits_needed(energies: Energies) -> tuple[float, float]:
    """Fewest bits from which on every finer converter takes energy off the plate, and from which on
    the plate energy stays within 0.5 dB of the ideal one's; nan if none does."""
    ideal, *coarse = energies([{"sensors.bits": bits} for bits in ("ideal", *_BITS)])
    helps = [db < 0.0 for db in coarse]
    return _fewest_bits(helps), _fewest_bits([abs(db - ideal) <= _WITHIN_DB for db in coarse])


def survived_us(energies: Energies, latencies: list[int]) -> tuple[list[float], float]:
    """Plate energies (dB) at some latencies, and the largest latency up to which they are below 0,
    to 1 us: nan if none is, inf if all are."""
    scan = energies([{"controller.latency_us": latency} for latency in latencies])
    at = _first_failure([db < 0.0 for db in scan])
    if at == 0:
        return scan, math.nan
    if at == len(latencies):
        return scan, math.inf
    low, high = latencies[at - 1], latencies[at]
    while high - low > 1:
        middle = (low + high) // 2
        if energies([{"controller.latency_us": middle}])[0] < 0.0:
            low = middle
        else:
            high = middle
    return scan, float(low)


def critical(pool: Pool, named: Named, law: str, points: int) -> Critical:
    """Critical latency and bits of one law in one scene."""
    scene, base = named.scene(), law_values(law, named.settings)
    latencies = latencies_of(scene, points)

    def energies(cases: list[dict[str, Any]]) -> list[float]:
        rows = evaluate(pool, scene, named.span, [base | case for case in cases])
        # A loop that is unstable has no metrics; it is worse than none.
        return [math.inf if row["status"] else float(row["plate_energy_db"]) for row in rows]

    scan, survived = survived_us(energies, latencies)
    ranged = over_phases(energies, survived, latencies[-1])
    critical_bits, settled_bits = bits_needed(energies)
    ideal = evaluate(pool, scene, named.span, [base])[0]
    return Critical(
        scene=named.name,
        law=law,
        kappa=getattr(scene.vary(base).scene.controller.keys, "kappa", math.nan),
        ideal_db=scan[0],
        ideal_rebound_percent=math.nan if ideal["status"] else ideal["rebound_percent"],
        critical_latency_us=survived,
        most_latency_us=float(latencies[-1]),
        critical_bits=critical_bits,
        settled_bits=settled_bits,
        **ranged,
    )


def over_phases(energies: Energies, middle_us: float, most_us: int) -> dict[str, float]:
    """Range of a critical latency over touch phases, from that at a touch in the middle of a step;
    plate energies (dB) without latency. A phase moves it by a step or so, so each is followed from
    there."""
    found = []
    for phase in phases():

        def helps(latency_us: int, phase: float = phase) -> bool:
            return (
                energies([{"controller.latency_us": latency_us, TOUCH_PHASE_KEY: phase}])[0] < 0.0
            )

        at = most_us if middle_us == math.inf else -1 if math.isnan(middle_us) else round(middle_us)
        if at >= 0 and not helps(at):
            while at >= 0 and not helps(at):
                at -= 1
        else:
            while at < most_us and helps(at + 1):
                at += 1
        found.append(math.inf if at >= most_us else -1.0 if at < 0 else float(at))
    ideal = spread_of(
        energies([{"controller.latency_us": 0, TOUCH_PHASE_KEY: p} for p in phases()])
    )
    least, most = (math.nan if us < 0.0 else us for us in (min(found), max(found)))
    return {
        "mean_db": ideal.mean,
        "least_db": ideal.least,
        "most_db": ideal.most,
        "least_latency_us": least,
        "most_survived_us": most,
    }


def best_laws(found: list[Critical]) -> Iterator[tuple[str, str, float, float]]:
    """Scene, the law that survives most latency there, how much (us), and what it buys over the
    two-point law (one that never helps counts as 0)."""
    for name in dict.fromkeys(c.scene for c in found):
        mine = [c for c in found if c.scene == name]

        def survives(c: Critical) -> float:
            us = c.critical_latency_us
            return 0.0 if math.isnan(us) else min(us, c.most_latency_us)

        best = max(mine, key=lambda c: (survives(c), -c.ideal_db))
        two_point = next(c for c in mine if c.law == "slope_threshold")
        yield name, best.law, survives(best), survives(best) - survives(two_point)


def _over_phases(words: str, ends: Iterable[float], digits: str, *names: str) -> str:
    """A number in words with its range over touch phases, where that is another one; `names`: of
    nan and of infinity."""
    least, most = (
        names[0] if math.isnan(x) else names[1] if math.isinf(x) else f"{x:{digits}}" for x in ends
    )
    ranged = least if least == most else f"{least} to {most}"
    return words if ranged == words else f"{words} ({ranged})"


def _latency(c: Critical) -> str:
    """The latency that a law tolerates, with its range over touch phases."""
    us, most = c.critical_latency_us, f"> {c.most_latency_us:.0f}"
    middle = "never" if math.isnan(us) else most if us == math.inf else f"{us:.0f}"
    return _over_phases(middle, (c.least_latency_us, c.most_survived_us), ".0f", "never", most)


def _energy(c: Critical) -> str:
    """The plate energy without latency, with its range over touch phases."""
    middle = "unstable" if c.ideal_db == math.inf else f"{c.ideal_db:.2f}"
    return _over_phases(middle, (c.least_db, c.most_db), ".2f", "unstable", "unstable")


def _law(c: Critical) -> str:
    return words.law(c.law) + ("" if math.isnan(c.kappa) else f", kappa {c.kappa:g}")


def _or(value: float, missing: str, unit: str = "") -> str:
    """A number without digits after the point, or a word for one that is missing."""
    return missing if math.isnan(value) else f"{value:.0f}{unit}"


_COLUMNS: Columns = {
    "law": _law,
    "plate energy (dB)": _energy,
    "rebound": lambda c: _or(c.ideal_rebound_percent, "", " %"),
    "latency (us)": _latency,
    "bits": lambda c: _or(c.critical_bits, "none"),
    "bits to 0.5 dB": lambda c: _or(c.settled_bits, "none"),
}


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Find how much latency and how few bits each law tolerates.

    With --quick there is one scene, and the scan is coarser.

    Example: python -m benchmarks.latency --quick
    """
    scenes = SCENES[:1] if quick else SCENES
    with results_in(folder, "latency", "modal") as results:
        pairs = tracked("critical values", product(scenes, LAWS))
        with local_pool() as pool:
            found = [critical(pool, named, law, 20 if quick else 40) for named, law in pairs]
        results.write("latency-critical", found)
        for named in scenes:
            title = f"{named.name}: latency and bits that each law tolerates"
            caption = "in brackets: least to most over touch phases"
            mine = [c for c in found if c.scene == named.name]
            results.table(title, _COLUMNS, mine, caption=caption)
        parts = [
            f"in {name} {law} tolerates most latency, {survives:.0f} us, {buys:.0f} us more than "
            "slope_threshold"
            for name, law, survives, buys in best_laws(found)
        ]
        results.conclude("; ".join(parts).capitalize() + ".")


if __name__ == "__main__":
    start("benchmarks.latency")
