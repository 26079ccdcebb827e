"""Rounds of cases of a sweep, measured in a process of its own, on request.

The process runs the checkout on its PYTHONPATH, which may be another one than that of this file. It
uses only what earlier versions have as well. It takes a scene file, reads a number per line, and
answers with a line of JSON: for each sweep the processor time of a case and of the loop in it, ms.
"""

import json
import random
import sys
import time
from typing import Any

from hertzloop.__main__ import collect_rarely
from hertzloop.scene.setup import load
from hertzloop.studies.cases.axis import axes_from
from hertzloop.studies.cases.design import DesignKind, design_of
from hertzloop.studies.cases.evaluate import chunked, run_cases

LATENCY_MAP, PLATES = "latency map", "radius, thickness, material (Sobol)"
OVER = {
    LATENCY_MAP: ["controller.latency_us=0:99:1", "sensors.bits=8:23:1"],
    PLATES: [
        "sphere.radius_m=0.001:0.006",
        "plate.thickness_m=0.001:0.006",
        "plate.material=aluminium,steel,glass",
    ],
}
_KINDS: dict[str, DesignKind] = {LATENCY_MAP: "grid", PLATES: "sobol"}
_CASES = {LATENCY_MAP: 192, PLATES: 32}  # a round
_ROUNDS = 64  # with plates of their own each; the latency map begins anew after four


class InLoop:
    """Processor time of the compiled loop."""

    def __init__(self, loop: Any) -> None:
        self.seconds, self.running, self._run = 0.0, False, loop.run
        loop.run = self

    def __call__(self, *given: Any) -> Any:
        """Run the loop. A look at the clock of a thread may cost more than a short case."""
        if not self.running:
            return self._run(*given)
        began = time.thread_time()
        status = self._run(*given)
        self.seconds += time.thread_time() - began
        return status


def loop_timer() -> Any:
    """Measure the compiled loop, by what earlier versions had for it."""
    try:
        from hertzloop.closed_loop import loop
    except ImportError:
        from hertzloop.loop import simulate

        return simulate.IN_LOOP  # type: ignore[attr-defined]
    return InLoop(loop)


def answer() -> None:
    """Answer each number that is read with the round of this number."""
    collect_rarely()  # as `hertzloop` does, whose speed is measured
    in_loop = loop_timer()
    setup = load(sys.argv[1])
    chunks = {}
    for sweep, over in OVER.items():
        cases = design_of(
            setup, axes_from(over), _KINDS[sweep], _ROUNDS * _CASES[sweep], seed=1
        ).cases()
        found = chunked(list(enumerate(cases)))
        random.Random(1).shuffle(found)
        chunks[sweep] = found
    for line in sys.stdin:
        answer = {}
        for sweep, found in chunks.items():
            count = _CASES[sweep] // len(found[0])
            first = 2 * int(line) * count
            timed, inside = (
                [found[i % len(found)] for i in range(at, at + count)]
                for at in (first, first + count)
            )
            began = time.thread_time()
            for chunk in timed:
                list(run_cases(setup, "impact", chunk))
            case_s = time.thread_time() - began
            in_loop.seconds, in_loop.running = 0.0, True
            for chunk in inside:
                list(run_cases(setup, "impact", chunk))
            in_loop.running = False
            answer[sweep] = [1e3 * s / _CASES[sweep] for s in (case_s, in_loop.seconds)]
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    answer()
