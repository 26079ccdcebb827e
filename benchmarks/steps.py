"""What a step of the shipped scenes costs: of the plant alone, under a force, and of the loop.

Another checkout is measured in turn, so that other work on the machine meets both alike; the least
processor time counts.
"""

import json
import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.commands import BeforeOption, checkouts, environment_of
from benchmarks.program import OutDirOption, QuickOption, RoundsOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import FOLDER

_SCENES = ("aluminium-3mm", "aluminium-20mm", "oak-20mm", "sylomer-20mm", "offcentre-6mm")
_YIELDS = f"{_SCENES[0]} yields"
_KINDS = {"plant": 0.0, "plant, 1 N": 1.0, "loop": None}
_POINTS = (1, 3)  # 3: actuator and sensor beside the contact
_CASES = Path(__file__).with_name("step_cases.py")


@dataclass(frozen=True)
class Row:
    """Least processor time of a step, and over that of the checkout before (NaN without one)."""

    scene: str
    points: int
    kind: str
    step_us: float
    ratio: float


@contextmanager
def _process(checkout: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that measures with the code of a checkout."""
    pipe = subprocess.PIPE
    words, environment = [sys.executable, "-P", str(_CASES)], environment_of(checkout)
    with subprocess.Popen(words, env=environment, stdin=pipe, stdout=pipe, text=True) as process:
        yield process
        process.communicate()


def _file(scene: str) -> tuple[str, bool]:
    """The elastic file of a scene, and whether its contact is to yield."""
    return str(FOLDER / f"{scene.split()[0]}.toml"), scene == _YIELDS


def _ask(process: subprocess.Popen[str], *case: Any) -> float:
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps(case) + "\n")
    process.stdin.flush()
    return float(process.stdout.readline())


def measure(rounds: int, before: Path | None, scenes: Sequence[str]) -> list[Row]:
    """All cases; the checkouts take turns."""
    cases = [(s, n, kind) for n in _POINTS for s in scenes for kind in _KINDS]
    least: dict[tuple[Any, ...], float] = {}
    with ExitStack() as stack:
        processes = {
            name: stack.enter_context(_process(root)) for name, root in checkouts(before).items()
        }
        for _ in tracked("rounds", range(rounds + 1)):  # the first compiles
            for scene, points, kind in cases:
                for name, process in processes.items():
                    found = _ask(process, *_file(scene), points, _KINDS[kind])
                    key = name, scene, points, kind
                    least[key] = min(found, least.get(key, math.inf))
    return [
        Row(
            *case,
            least["this", *case],
            least["this", *case] / least.get(("before", *case), math.nan),
        )
        for case in cases
    ]


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 9,
    quick: QuickOption = False,
    before: BeforeOption = None,
) -> None:
    """Measure what a step costs, with one point and with actuator and sensor elsewhere.

    Example: python -m benchmarks.steps --quick
    """
    with results_in(folder, "steps") as results:
        scenes = _SCENES[:1] if quick else (*_SCENES, _YIELDS)
        rows = measure(1 if quick else rounds, before, scenes)
        results.write("steps", rows)
        columns = {
            "scene": "{.scene}",
            "case": "{.kind}",
            "points": "{.points}",
            "us a step": "{.step_us:.3f}",
            "over before": "{.ratio:.2f}",
        }
        results.table("A step", columns, rows, text=2)
        worst = {n: max(row.step_us for row in rows if row.points == n) for n in _POINTS}
        results.conclude(
            f"A step takes {worst[1]:.2f} us at most with one point, and {worst[3]:.2f} us with "
            "three."
        )


if __name__ == "__main__":
    start("benchmarks.steps")
