"""The jitter margin of random loops against a search for a sequence of latencies that is unstable.

The search tries constant, periodic, switching and random latencies, and a greedy choice of the
command that adds most energy in each step.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.jitter_kernels import SimulatedLoop, simulate
from benchmarks.program import OutDirOption, QuickOption, SeedOption, median, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.terminal import out
from hertzloop.studies.margin.gain import gain_margin
from hertzloop.studies.margin.jitter import ErrorResponse
from hertzloop.studies.margin.linear import TransferFunction
from hertzloop.studies.margin.loop import PolyphaseLoop

_LOOPS = 1000
_MOST_DELAY = 50  # steps, at the shortest latency
_MOST_ADDED = 600  # largest additional latency, steps, that the search tries
_SAMPLES = 3000
_GROWS = 1.0  # rise of log energy between the quarters of a run that makes a second, longer one
_MUTATIONS = 60
_NONE = np.empty(0, np.int64)


@dataclass(frozen=True)
class RandomLoop:
    """A linear loop that is stable at its shortest latency.

    Attributes:
        plant: response in steps.
        law: response of the law in samples.
        every: steps from one sample to the next.
        delay: steps from a sample to its force at the shortest latency.
        loops: the loop by latency.
    """

    plant: TransferFunction
    law: TransferFunction
    every: int
    delay: int
    loops: PolyphaseLoop


@dataclass(frozen=True)
class SearchedLoop:
    """The margin of a loop beside what the search found. Latencies in steps beyond the shortest.

    Attributes:
        loop: number of the loop.
        margin: jitter margin.
        constant: first constant latency that is unstable; nan beyond the search.
        unstable: smallest latency with an unstable sequence; nan if none was found.
        sequence: its kind.
        below: kind of an unstable sequence below the margin, a contradiction; "" if none was found.
    """

    loop: int
    margin: float
    constant: float
    unstable: float
    sequence: str
    below: str

    @property
    def contradicts(self) -> bool:
        """Whether a latency below the margin is unstable."""
        return bool(self.below) or self.constant <= self.margin * (1.0 - 1e-6)


def three_modes() -> RandomLoop:
    """Return a loop of three lightly damped modes, collocated."""
    omega = np.array([0.01, 0.027, 0.052])
    plant = TransferFunction.of_modes(
        np.exp((-0.005 + 1j) * omega), np.full(3, 0.5 + 0j), np.zeros(3)
    )
    law = TransferFunction.of_taps(-2e-4)
    return RandomLoop(plant, law, 1, 1, PolyphaseLoop.of(plant, law))


def random_loop(rng: np.random.Generator) -> RandomLoop:
    """Return a random loop that is stable and has a jitter margin of one step at least.

    It has 1 to 40 modes, collocated or not, 1 to 10 steps a sample, and a shortest latency of up to
    50 steps.
    """
    while True:
        modes, collocated = int(rng.integers(1, 41)), rng.random() < 0.5
        every = int(rng.integers(1, 11)) if rng.random() < 0.7 else 1
        delay = int(rng.integers(0, _MOST_DELAY + 1)) if rng.random() < 0.7 else 0
        omega = np.sort(10.0 ** rng.uniform(-2.0, 0.49, modes))
        loss = 10.0 ** rng.uniform(-3.0, -0.5)
        sign = 1.0 if collocated else rng.choice([-1.0, 1.0], modes)
        residues = 0.5 * sign * 10.0 ** rng.uniform(-2.0, 0.0, modes) * (1.0 + 0.1j)
        fir = np.array([0.0, rng.uniform(0.0, 0.5) * (rng.random() < 0.3), 0.0])
        plant = TransferFunction.of_modes(np.exp((-0.5 * loss + 1j) * omega), residues, fir)
        own = np.array([rng.uniform(0.0, 0.95) + 0j][: int(rng.random() < 0.4)])
        own_residue = rng.uniform(-1.0, 1.0) * np.ones(len(own), complex)
        law = TransferFunction(own, own_residue, np.array([-1.0]))
        loop, late = PolyphaseLoop.of(plant, law, every).at(delay)
        factor = (gain_margin(loop, late) or 1.0) * rng.uniform(0.1, 0.95)
        for _ in range(5):
            weak = replace(law, fir=factor * law.fir, residues=factor * law.residues)
            found = RandomLoop(plant, weak, every, delay, PolyphaseLoop.of(plant, weak, every))
            stable = not found.loops.unstable(np.array([delay]))[0]
            if stable and ErrorResponse(found.loops, delay).largest_delay()[0] > 1.0:
                return found
            factor *= 0.4


def simulated(loop: RandomLoop) -> SimulatedLoop:
    """Return a loop as its simulation takes it."""
    own = loop.law.poles.size
    law = [loop.law.fir[0], loop.law.poles[0].real if own else 0.0]
    law.append(loop.law.residues[0].real if own else 0.0)
    plant = loop.plant
    modes = plant.poles.imag > 0.0
    return SimulatedLoop(
        plant.poles[modes], plant.residues[modes], plant.fir, np.array(law), loop.every, loop.delay
    )


class Search:
    """A search for an unstable sequence of latencies of one loop.

    Args:
        loop: the loop.
        angle: critical frequency of the jitter margin, rad/sample.
        seed: of the random sequences.
    """

    def __init__(self, loop: RandomLoop, angle: float, seed: int) -> None:
        self.loop, self.seed, self.run = loop, seed, simulated(loop)
        self.period = 2.0 * math.pi / max(angle, 2.0 * math.pi / _SAMPLES)
        self.weights = 1.0 / np.maximum(np.abs(self.run.residues), 1e-12)
        near = int(np.argmin(np.abs(np.exp(1j * angle) - self.run.poles**loop.every)))
        chosen = np.arange(len(self.weights)) == near
        self.mode = np.where(chosen, 1.0, 1e-6) * self.weights

    def unstable(self, most: int) -> str:
        """Return the kind of an unstable sequence of latencies up to `most` steps; "" if none is
        found."""
        rng = np.random.default_rng([self.seed, most])
        best, pattern = -math.inf, np.array([0, most])
        for kind, late in patterns(rng, self.loop.every, most, self.period):
            rise = self._rise(np.resize(late, _SAMPLES), most)
            if rise > _GROWS and self._lasts(late, most, rise):
                return kind
            if rise > best and kind != "random":
                best, pattern = rise, late
        for weights in (self.weights, self.mode):
            rise = self._rise(_NONE, most, weights)
            if rise > _GROWS and self._lasts(_NONE, most, rise, weights):
                return "greedy"
        for _ in range(_MUTATIONS):
            tried = mutated(rng, pattern, most)
            rise = self._rise(np.resize(tried, _SAMPLES), most)
            if rise > _GROWS and self._lasts(tried, most, rise):
                return "climbing"
            if rise >= best:
                best, pattern = rise, tried
        return ""

    def _rise(
        self,
        late: np.ndarray,
        most: int,
        weights: np.ndarray | None = None,
        samples: int = _SAMPLES,
    ) -> float:
        """Return how much log energy rises from the second to the last quarter of a run."""
        size = 1.0 / np.sqrt(self.weights)
        state = size * np.exp(2j * np.pi * np.random.default_rng(3).random(len(size)))
        energy = np.empty(samples)
        chosen = self.weights if weights is None else weights
        simulate(self.run, state, np.zeros(samples), late, chosen, most, energy)
        quarter = samples // 4
        return float(energy[-quarter:].max() - energy[quarter : 2 * quarter].max())

    def _lasts(
        self, late: np.ndarray, most: int, rise: float, weights: np.ndarray | None = None
    ) -> bool:
        """Return whether the energy rises on in a run four times as long, unlike a transient."""
        longer = np.resize(late, 4 * _SAMPLES) if late.size else late
        return self._rise(longer, most, weights, 4 * _SAMPLES) > 2.0 * rise


def patterns(
    rng: np.random.Generator, every: int, most: int, period: float
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield kinds and delays of commands, 0 to `most` steps, to be repeated; `period`: of the
    critical frequency, samples."""
    yield "random", rng.integers(0, most + 1, 4 * _SAMPLES)
    for length in (1.0, max(1.0, 0.5 * period)):
        yield "random", most * (np.cumsum(rng.random(4 * _SAMPLES) < 1.0 / length) % 2)
    for factor in (0.0, 0.5, 1.0, 2.0):
        turn = max(2, round(factor * period))
        for share in (0.3, 0.6):
            yield "periodic", np.where(np.arange(turn) < max(1, round(share * turn)), most, 0)
    for turn in {2, max(2, most // (2 * every) + 1), most // every + 1}:
        yield "held", np.minimum(most, every * np.arange(turn)[::-1])


def mutated(rng: np.random.Generator, pattern: np.ndarray, most: int) -> np.ndarray:
    """Return a pattern with a stretch set to one latency, or with another length."""
    found = pattern.copy()
    if rng.random() < 0.3:
        return np.resize(found, max(2, len(found) + int(rng.integers(-2, 3))))
    first = int(rng.integers(len(found)))
    length = 1 + int(rng.integers(max(1, len(found) // 2)))
    late = rng.choice([0, most, int(rng.integers(most + 1))])
    found[(first + np.arange(length)) % len(found)] = late
    return found


def searched(number: int, loop: RandomLoop) -> SearchedLoop:
    """Return a loop's margin beside the smallest latency at which the search succeeds."""
    margin, angle = ErrorResponse(loop.loops, loop.delay).largest_delay()
    added = np.arange(_MOST_ADDED + 1)
    bad = np.flatnonzero(loop.loops.unstable(loop.delay + added))
    constant = float(bad[0]) if len(bad) else math.nan
    good = min(math.floor(margin * (1.0 - 1e-6)), _MOST_ADDED)
    search = Search(loop, angle, number)
    below = search.unstable(good) if good else ""
    if len(bad):
        worst, kind = int(bad[0]), "constant"
    else:
        worst, kind = _MOST_ADDED, search.unstable(_MOST_ADDED)
    while kind and worst - good > 1:
        middle = (good + worst) // 2
        if other := search.unstable(middle):
            worst, kind = middle, other
        else:
            good = middle
    first = float(worst) if kind else math.nan
    return SearchedLoop(number, margin, constant, first, kind, below)


def run(seed: int, count: int) -> list[SearchedLoop]:
    """Search in `count` random loops and that of three modes."""
    found = [searched(0, three_modes())]
    for i in tracked("random loops", range(1, count + 1)):
        found.append(searched(i, random_loop(np.random.default_rng([seed, i]))))
    return found


def main(folder: OutDirOption = None, seed: SeedOption = 1, quick: QuickOption = False) -> None:
    """Compare the jitter margin of random loops with a search for unstable sequences of latencies.

    Example: python -m benchmarks.jitter_margin --quick
    """
    with results_in(folder, "jitter_margin") as results:
        found = run(seed, 20 if quick else _LOOPS)
        results.write("jitter_margin", found)
        kinds = Counter(one.sequence or "none found" for one in found)
        columns = {"kind": "{[0]}", "loops": "{[1]}"}
        results.table("First unstable sequence", columns, sorted(kinds.items()))
        ratios = [one.margin / one.unstable for one in found if math.isfinite(one.unstable)]
        out.print(
            "jitter margin over smallest unstable latency: median "
            f"{median(ratios):.3g}, largest {max(ratios, default=math.nan):.3g}"
        )
        for one in found:
            if one.contradicts:
                out.say(f"contradiction: {one}")
        results.conclude(
            f"In {sum(one.contradicts for one in found)} of {len(found)} loops a latency below the "
            "jitter margin is unstable."
        )


if __name__ == "__main__":
    start("benchmarks.jitter_margin")
