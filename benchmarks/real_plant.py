"""What each law does in an ideal plant and in a real one: plate energy and critical latency.

Real: a contact that yields, a plate with thickness, an actuator with a bandwidth, and a converter
with bits and noise; both over the phases of the touch. The line's latency is varied in both.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from benchmarks.latency import (
    SCENES,
    Energies,
    Named,
    bits_needed,
    latencies_of,
    law_values,
    over_phases,
    survived_us,
)
from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import Columns, Results, results_in
from hertzloop.cli.terminal import fail, out
from hertzloop.results.touch_phases import Spread, spread_of
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.real_plant import NOISE, REAL
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.touch_phases import at_all
from hertzloop.studies.cases.workers import WorkersLost
from hertzloop.studies.pages import pictures, words
from hertzloop.studies.tune.plan import LAWS

PLANTS = ("ideal", "real")
LATENCIES_US = (0, 2, 5)
# Where the scene's contact loses by a damper, that stays its loss.
_NOT_WITH_A_DAMPER = ("contact.plasticity",)
_POINTS = 20  # of the scan for a critical latency
_WANTED_DB = -3.0
_WORST_DB = 5.0  # what is worse stands at the right end as a number
_APART = 0.16  # of a law's line, between its plants
_FACES = {"ideal": "white", "real": None}


@dataclass(frozen=True)
class Effect:
    """What a law does in one plant. `energies`: plate energy against no control, dB, over touch
    phases, by latency (us); nan: unstable. The largest latency (us) up to which it takes energy off
    the plate, for a touch in the middle of a step, and its range over phases: nan if never, inf if
    it still does at the largest tried. Fewest bits from which on it helps without latency, and is
    within 0.5 dB of an ideal converter. `noise_rms`, in the unit of what the law works on, at the
    largest of the latencies."""

    scene: str
    law: str
    plant: str
    noise_rms: float
    energies: dict[int, Spread]
    critical_us: float
    least_us: float
    most_us: float
    tried_us: float
    critical_bits: float
    settled_bits: float

    def takes_off(self, latency_us: int, wanted_db: float) -> bool:
        """Whether it takes so much energy off the plate at a latency, whatever the phase."""
        return self.energies[latency_us].most <= -wanted_db


def plant_of(named: Named, plant: str) -> Setup:
    """The scene's ideal or real plant."""
    scene = named.scene()
    if plant == "ideal":
        return scene
    left_out = _NOT_WITH_A_DAMPER if scene.mechanics.contact.has_damper else ()
    return scene.vary({key: value for key, value in REAL.items() if key not in left_out})


def with_noise(scene: Setup, values: dict[str, Any]) -> dict[str, Any]:
    """A case with the noise that belongs to its converter's range, which its law and latency have
    a share in; as it is with an ideal converter."""
    limits = scene.vary(values).sensor.full_scale
    if limits is None:
        return values
    return values | {"sensors.noise_rms": NOISE * (limits[1] - limits[0])}


def energies_of(pool: Pool, named: Named, plant: str, law: str) -> Energies:
    """A function from cases to their plate energies, dB; inf where there is none."""
    scene, base = plant_of(named, plant), law_values(law)

    def energies(cases: list[dict[str, Any]]) -> list[float]:
        values = [base | case for case in cases]
        if plant == "real":
            values = [with_noise(scene, each) for each in values]
        rows = evaluate(pool, scene, named.span, values)
        return [math.inf if row["status"] else float(row["plate_energy_db"]) for row in rows]

    return energies


def effect(pool: Pool, named: Named, plant: str, law: str, points: int = _POINTS) -> Effect:
    """What one law does in one plant."""
    scene, energies = plant_of(named, plant), energies_of(pool, named, plant, law)
    cases = [at_all({"controller.latency_us": latency}) for latency in LATENCIES_US]
    found = [[x if x < math.inf else math.nan for x in energies(case)] for case in cases]
    latencies = latencies_of(scene, points)
    _, survived = survived_us(energies, latencies)
    ranged = over_phases(energies, survived, latencies[-1])
    last = with_noise(scene, law_values(law) | {"controller.latency_us": LATENCIES_US[-1]})
    return Effect(
        named.name,
        law,
        plant,
        last.get("sensors.noise_rms", 0.0),
        {us: spread_of(x) for us, x in zip(LATENCIES_US, found, strict=True)},
        survived,
        ranged["least_latency_us"],
        ranged["most_survived_us"],
        float(latencies[-1]),
        *bits_needed(energies),
    )


def _columns() -> list[str]:
    energies = [f"{part}_db_{us}us" for us in LATENCIES_US for part in ("mean", "least", "most")]
    return [
        "scene",
        "law",
        "plant",
        *energies,
        "critical_us",
        "least_us",
        "most_us",
        "tried_us",
        "critical_bits",
        "settled_bits",
        "noise_rms",
    ]


def _row(e: Effect) -> Iterator[Any]:
    yield from (e.scene, e.law, e.plant)
    for spread in e.energies.values():
        yield from (spread.mean, spread.least, spread.most)
    yield from (e.critical_us, e.least_us, e.most_us, e.tried_us)
    yield from (e.critical_bits, e.settled_bits, e.noise_rms)


def run(names: Sequence[str]) -> list[Effect]:
    """Measure all laws in both plants of the scenes named."""
    scenes = [named for named in SCENES if named.name in names]
    cases = list(product(scenes, LAWS, PLANTS))
    with local_pool() as pool:
        return [effect(pool, named, plant, law) for named, law, plant in tracked("real", cases)]


def write(results: Results, found: list[Effect]) -> None:
    """Table and picture."""
    results.write_rows("real", _columns(), map(_row, found))
    draw(results.path("real.png"), found)


def draw(path: Path, found: list[Effect]) -> None:
    """A row a scene, a column a latency: plate energy of every law, mean and range over phases."""
    scenes, latencies = list(dict.fromkeys(e.scene for e in found)), list(found[0].energies)
    sheet, axes = pictures.sheet(len(scenes), len(latencies), width=11.0, height=2.9)
    for line, scene in enumerate(scenes):
        mine = [e for e in found if e.scene == scene]
        for column, latency_us in enumerate(latencies):
            ax = axes[line, column]
            _draw(ax, mine, latency_us)
            ax.set_title(f"{scene}, latency {latency_us:g} us", fontsize=9)
            if column:
                ax.tick_params(labelleft=False)
            if line == len(scenes) - 1:
                ax.set_xlabel(words.against_none("plate_energy_db"))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    sheet.suptitle("Left of the line: energy taken off the plate. Bars: range over touch phases")
    pictures.save(sheet, path)


def _draw(ax: Any, mine: list[Effect], latency_us: int) -> None:
    laws = list(dict.fromkeys(e.law for e in mine))
    for i, plant in enumerate(dict.fromkeys(e.plant for e in mine)):
        some = [
            (e.energies[latency_us], laws.index(e.law) + (2 * i - 1) * _APART)
            for e in mine
            if e.plant == plant
        ]
        shown = [(s, y) for s, y in some if s.mean <= _WORST_DB]
        style = pictures.look(i, marked=True) | {"linestyle": ""}
        face = _FACES.get(plant) or style["color"]
        ax.errorbar(
            [s.mean for s, _ in shown],
            [y for _, y in shown],
            xerr=[[s.mean - s.least for s, _ in shown], [s.most - s.mean for s, _ in shown]],
            label=plant,
            markerfacecolor=face,
            **style,
        )
        for spread, y in some:
            if not spread.mean <= _WORST_DB:
                beyond = "unstable" if math.isnan(spread.mean) else f"{spread.mean:+.0f} dB"
                ax.annotate(
                    beyond,
                    (0.98, y),
                    xycoords=("axes fraction", "data"),
                    ha="right",
                    va="center",
                    fontsize=7,
                    color=style["color"],
                )
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.axvline(_WANTED_DB, color="0.5", linewidth=0.8, linestyle=":")
    ax.set_yticks(range(len(laws)), [words.law(law) for law in laws])
    ax.set_ylim(len(laws) - 0.5, -0.5)


def _critical(e: Effect) -> str:
    """A critical latency with its range over touch phases."""

    def one(x: float) -> str:
        return "never" if math.isnan(x) else f"> {e.tried_us:.0f}" if math.isinf(x) else f"{x:.0f}"

    least, most = one(e.least_us), one(e.most_us)
    return least if least == most else f"{least} to {most}"


def _bits(bits: float) -> str:
    return "none" if math.isnan(bits) else f"{bits:.0f}"


def _energy(latency_us: int) -> Callable[[Effect], str]:
    """The plate energy at a latency as text."""

    def text(e: Effect) -> str:
        spread = e.energies[latency_us]
        return "unstable" if math.isnan(spread.mean) else str(spread)

    return text


_COLUMNS: Columns = {
    "law": lambda e: words.law(e.law),
    "plant": "{.plant}",
    **{f"at {us} us": _energy(us) for us in LATENCIES_US},
    "helps up to (us)": _critical,
    "bits": lambda e: _bits(e.critical_bits),
    "to 0.5 dB": lambda e: _bits(e.settled_bits),
}
_HELP_DB = 0.1  # less is no help


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Compare every law in the ideal plant and in a realistic plant.

    In the real plant the contact yields, the plate has a thickness, and actuator and sensor have
    limits. With --quick only the two scenes of the 3 mm sphere are used.

    Example: python -m benchmarks.real_plant --quick
    """
    known = [named.name for named in SCENES]
    names = known[:2] if quick else known
    with results_in(folder, "real_plant", "modal") as results:
        try:
            found = run(names)
        except WorkersLost as error:
            fail(str(error), 1)
        write(results, found)
        for scene in names:
            title = f"{scene}: plate energy (dB), mean (range) over phases"
            results.table(title, _COLUMNS, [e for e in found if e.scene == scene], text=2)
        changed = " ".join(f"--set {key}={value}" for key, value in REAL.items())
        noise = f"noise of {NOISE:g} of the converter's range (noise_rms in real.csv)"
        out.say(
            f"real: {changed}, and {noise}; without contact.plasticity where the "
            "scene's contact has a damper"
        )
        real = [e for e in found if e.plant == "real"]
        helps = sum(e.takes_off(LATENCIES_US[-1], _HELP_DB) for e in real)
        results.conclude(
            f"In the real plant {helps} of {len(real)} laws take energy off the plate at every "
            f"touch phase with {LATENCIES_US[-1]} us of latency."
        )


if __name__ == "__main__":
    start("benchmarks.real_plant")
