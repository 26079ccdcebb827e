"""What a case of a sweep costs on one core, and how much of that is the compiled loop."""

import random
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.baseline import ROUNDS, Cost, in_turn, plant_case, two_pass_case
from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    bars,
    check_json,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.analysis.deflection import modes_of_scene
from hertzloop.loop.compiled import IN_LOOP
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.setup import load
from hertzloop.studies.sweeps.design import Kind, make_design
from hertzloop.studies.sweeps.evaluate import run_cases
from hertzloop.studies.words import write_records

_SWEEPS: dict[str, tuple[Kind, list[str]]] = {
    "latency map": ("grid", ["controller.latency_us=0:99:1", "sensors.bits=8:23:1"]),
    "radius, thickness, material (Sobol)": (
        "sobol",
        ["sphere.radius_m=0.001:0.006", "plate.thickness_m=0.001:0.006",
         "plate.material=aluminium,steel,glass"],
    ),
}  # fmt: skip
_CASES = {"grid": 200, "sobol": 16}  # a round


@dataclass(frozen=True)
class CaseCost:
    """Processor time of a case and of the loop in it, ms; medians of the rounds."""

    sweep: str
    case_ms: float
    loop_ms: float


def measure(rounds: int) -> list[CaseCost]:
    """Costs of the latency map of `aluminium-3mm` and of other plants, of new cases each round."""
    scene, found = load("aluminium-3mm"), []
    for sweep, (kind, over) in _SWEEPS.items():
        count, whole, loop = _CASES[kind], [], []
        cases = make_design(scene, over, kind, (rounds + 1) * count, seed=1).cases()
        random.Random(1).shuffle(cases)
        for turn in tracked(sweep, range(rounds + 1)):
            some = cases[turn * count % len(cases) :][:count]
            numbered = list(enumerate(some))
            started = time.thread_time()
            list(run_cases(scene, "impact", numbered))
            took_s = time.thread_time() - started
            IN_LOOP.seconds, IN_LOOP.running = 0.0, True
            list(run_cases(scene, "impact", numbered))
            IN_LOOP.running = False
            if turn:  # the first loads what is compiled
                whole.append(1e3 * took_s / len(some))
                loop.append(1e3 * IN_LOOP.seconds / len(some))
        found.append(CaseCost(sweep, statistics.median(whole), statistics.median(loop)))
    return found


_SCENE, _SETTINGS = "aluminium-20mm", ["run.accuracy=1e-3", "run.lead_in_s=0"]
_FEW = 100


def _lowest(table: ModeTable, count: int) -> ModeTable:
    """The `count` lowest modes of a table."""
    names = ("omega_rad_s", "loss_factor", "per_modal_mass_1_kg", "shape_contact", "shape_actuator")
    return replace(table, **{name: getattr(table, name)[:count] for name in names})


def mode_file_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per step of `aluminium-20mm` in closed form, by a file of all its modes, and by one of the
    lowest 100; yardstick: a plain two-pass loop over 100 frequencies."""
    setup = load(_SCENE, _SETTINGS)
    table = modes_of_scene(setup)
    cases: dict[str, Callable[[], float]] = {
        f"two-pass loop, {_FEW} frequencies": two_pass_case(_FEW)
    }
    with TemporaryDirectory() as folder:
        scenes = {"closed form": setup}
        for words, modes in (("file of all modes", table), ("file", _lowest(table, _FEW))):
            file = Path(folder) / f"{len(modes.omega_rad_s)}.npz"
            file.write_bytes(write_modes(".npz", modes))
            scenes[words] = load(_SCENE, [*_SETTINGS, f"plate.modes={file}"])
        for words, one in scenes.items():
            for name, contact in (("flight", False), ("contact", True)):
                plant = CollocationPlant(one.plant)
                case = f"{words}, {name}, {len(plant.modes.omega)} frequencies"
                cases[case] = plant_case(plant, contact=contact)
        return in_turn(cases, rounds)


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure how many cases of a sweep one core runs in a second.

    Also measures which part of that time is the compiled loop.

    Example: python -m benchmarks.cases --quick
    """
    check_json(json_file)
    with results_in(folder, "cases") as made:
        compile_first()
        found = measure(1 if quick else rounds)
        write_records(made / "cases.csv", found)
        sizes = [(c.sweep, 1e3 / c.case_ms) for c in found]
        bars(made / "cases.png", "Cases of a sweep on one core", "cases per second", sizes)
    headings = ("sweep", "cases/s", "ms a case", "in the loop, ms", "share")
    rows = [
        (c.sweep, f"{1e3 / c.case_ms:.0f}", f"{c.case_ms:.3f}", f"{c.loop_ms:.3f}",
         f"{c.loop_ms / c.case_ms:.0%}") for c in found
    ]  # fmt: skip
    out.print(number_table("cases of a sweep, of one core", headings, rows, text=1))
    written(made, "cases.csv", "cases.png")
    first = found[0]
    conclude(
        f"One core runs {1e3 / first.case_ms:.0f} cases of the {first.sweep} in a second, and "
        f"{first.loop_ms / first.case_ms:.0%} of that time is the compiled loop."
    )
    write_json(json_file, {"cases": [asdict(row) for row in found]})


if __name__ == "__main__":
    start("benchmarks.cases")
