"""What a case of a sweep costs on one core, and how much of that is the compiled loop."""

import json
import statistics
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import case_rounds
from benchmarks.baseline import ROUNDS, Cost, in_turn, plant_case, two_pass_case
from benchmarks.program import (
    BeforeOption,
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    bars,
    check_json,
    compile_first,
    conclude,
    cost_of,
    environment_of,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    write_records,
    written,
)
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.results.deflection import modes_of_scene
from hertzloop.scene.setup import load

_ROOT = Path(__file__).resolve().parent.parent
_MAP_CASES = 1600  # of the whole latency map


@dataclass(frozen=True)
class CaseCost:
    """Processor time of a case and of the loop in it, ms; medians of the rounds. `checkout`: "this"
    or "before"."""

    sweep: str
    checkout: str
    case_ms: float
    loop_ms: float


@dataclass(frozen=True)
class ProcessCost:
    """Wall time and processor time of `hertzloop sweep` for the latency map, s; medians of the
    rounds. Processor time counts that of its workers."""

    checkout: str
    cases: int
    wall_s: float
    cpu_s: float


class _Rounds:
    """A process that measures rounds of cases in a checkout."""

    def __init__(self, root: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, case_rounds.__file__], env=environment_of(root), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def run(self, turn: int) -> dict[str, tuple[float, float]]:
        """Milliseconds of a case, and in its loop, by sweep. Raises RuntimeError."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{turn}\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("the process that measures cases has ended")
        return {sweep: (case, loop) for sweep, (case, loop) in json.loads(line).items()}

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def _whole_s(root: Path) -> tuple[float, float]:
    """Wall time and processor time of `hertzloop sweep` for the latency map in a checkout, s."""
    over = [word for axis in case_rounds.OVER[case_rounds.LATENCY_MAP] for word in ("--over", axis)]
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        words = [sys.executable, "-m", "hertzloop", "sweep", case_rounds.SCENE, *over]
        return cost_of([*words, "--out", "map.parquet"], root, Path(folder))


def measure(rounds: int, before: Path | None) -> tuple[list[CaseCost], list[ProcessCost]]:
    """Costs of cases and of a whole sweep, in this checkout and in that at `before`, in turn.

    All checkouts run the same cases, other ones in every round.
    """
    roots = {"this": _ROOT} | ({} if before is None else {"before": before})
    cases: dict[tuple[str, str], list[tuple[float, float]]] = {}
    whole: dict[str, list[tuple[float, float]]] = {name: [] for name in roots}
    measured = {name: _Rounds(root) for name, root in roots.items()}
    try:
        for turn in tracked("sweeps", range(rounds + 1)):
            for name, root in roots.items():
                for sweep, cost in measured[name].run(turn).items():
                    if turn:  # the first loads what is compiled
                        cases.setdefault((sweep, name), []).append(cost)
                cost = _whole_s(root)
                if turn:
                    whole[name].append(cost)
    finally:
        for process in measured.values():
            process.close()
    return (
        [CaseCost(*key, *_medians(some)) for key, some in sorted(cases.items())],
        [ProcessCost(name, _MAP_CASES, *_medians(some)) for name, some in whole.items()],
    )


def _medians(some: list[tuple[float, float]]) -> tuple[float, float]:
    one, other = (statistics.median(column) for column in zip(*some, strict=True))
    return one, other


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
    before: BeforeOption = None,
) -> None:
    """Measure how many cases of a sweep one core runs in a second.

    Also measures which part of that time is the compiled loop, and how long the command `sweep`
    takes for a latency map of 1600 cases.

    Example: python -m benchmarks.cases --quick
    """
    check_json(json_file)
    with results_in(folder, "cases") as made:
        compile_first()
        found, whole = measure(1 if quick else rounds, before)
        write_records(made / "cases.csv", found)
        ours = [(c.sweep, 1e3 / c.case_ms) for c in found if c.checkout == "this"]
        bars(made / "cases.png", "Cases of a sweep on one core", "cases per second", ours)
    headings = ("sweep", "checkout", "cases/s", "ms a case", "in the loop, ms", "share")
    rows = [
        (c.sweep, c.checkout, f"{1e3 / c.case_ms:.0f}", f"{c.case_ms:.3f}", f"{c.loop_ms:.3f}",
         f"{c.loop_ms / c.case_ms:.0%}") for c in found
    ]  # fmt: skip
    out.print(number_table("cases of a sweep, of one core", headings, rows, text=2))
    columns = ("command", "checkout", "wall time, s", "processor time, s")
    commands = [
        (f"sweep of {w.cases} cases", w.checkout, f"{w.wall_s:.2f}", f"{w.cpu_s:.2f}")
        for w in whole
    ]
    out.print(number_table("latency map, whole process", columns, commands, text=2))
    written(made, "cases.csv", "cases.png")
    first = next(c for c in found if (c.sweep, c.checkout) == (case_rounds.LATENCY_MAP, "this"))
    conclude(
        f"One core runs {1e3 / first.case_ms:.0f} cases of the {first.sweep} in a second, and "
        f"{first.loop_ms / first.case_ms:.0%} of that time is the compiled loop."
    )
    write_json(
        json_file,
        {"cases": [asdict(row) for row in found], "whole": [asdict(row) for row in whole]},
    )


if __name__ == "__main__":
    start("benchmarks.cases")
