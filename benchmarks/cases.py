"""What a case of a sweep costs on one core, and how much of that is the compiled loop."""

import json
import statistics
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import case_rounds
from benchmarks.commands import BeforeOption, checkouts, environment_of, take
from benchmarks.program import OutDirOption, QuickOption, RoundsOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import FOLDER

_MAP_CASES = 1600  # of the whole latency map
_SCENE = str(FOLDER / "aluminium-3mm.toml")


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
            [sys.executable, case_rounds.__file__, _SCENE],
            env=environment_of(root),
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

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
    words = [sys.executable, "-m", "hertzloop", "sweep", _SCENE, *over]
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        taken = take([*words, "--out", "map.parquet"], root, Path(folder))
    return taken.wall_s, taken.cpu_s


def measure(rounds: int, before: Path | None) -> tuple[list[CaseCost], list[ProcessCost]]:
    """Costs of cases and of a whole sweep, in this checkout and in that at `before`, in turn.

    All checkouts run the same cases, other ones in every round.
    """
    roots = checkouts(before)
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


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    before: BeforeOption = None,
) -> None:
    """Measure how many cases of a sweep one core runs in a second.

    Also measures which part of that time is the compiled loop, and how long the command `sweep`
    takes for a latency map of 1600 cases.

    Example: python -m benchmarks.cases --quick
    """
    with results_in(folder, "cases", "modal") as results:
        found, whole = measure(1 if quick else rounds, before)
        results.write("cases", found)
        results.write("whole", whole)
        results.table(
            "cases of a sweep, of one core",
            {
                "sweep": "{.sweep}",
                "checkout": "{.checkout}",
                "cases/s": lambda c: f"{1e3 / c.case_ms:.0f}",
                "ms a case": "{.case_ms:.3f}",
                "in the loop, ms": "{.loop_ms:.3f}",
                "share": lambda c: f"{c.loop_ms / c.case_ms:.0%}",
            },
            found,
            text=2,
        )
        results.table(
            "latency map, whole process",
            {
                "command": "sweep of {.cases} cases",
                "checkout": "{.checkout}",
                "wall time, s": "{.wall_s:.2f}",
                "processor time, s": "{.cpu_s:.2f}",
            },
            whole,
            text=2,
        )
        first = next(c for c in found if (c.sweep, c.checkout) == (case_rounds.LATENCY_MAP, "this"))
        results.conclude(
            f"One core runs {1e3 / first.case_ms:.0f} cases of the {first.sweep} in a second, and "
            f"{first.loop_ms / first.case_ms:.0%} of that time is the compiled loop."
        )


if __name__ == "__main__":
    start("benchmarks.cases")
