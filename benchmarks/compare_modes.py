"""`hertzloop scene modes` beside sdypy-EMA: modes of known scenes, and hits that are held out.

sdypy-EMA leaves the choice of poles to a person before a stabilisation chart. Here a rule chooses
them: every pole of an order that the order below has too. Order and tolerance are those that fit
the response of a scene best, of a grid. For hits, window and band belong to the grid too, and the
hit that is held out chooses; it also chooses the number of modes of hertzloop.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measured_modes import response
from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.common.optional_dependencies import need
from hertzloop.fitting.modes.frequency_responses import FrequencyResponses, noise_weights
from hertzloop.fitting.modes.from_hits import modes_of_hits
from hertzloop.fitting.modes.from_responses import modes_of_responses
from hertzloop.fitting.modes.hit_responses import (
    HitResponse,
    hits_of_records,
)
from hertzloop.fitting.modes.measured_modes import prediction_errors
from hertzloop.fitting.modes.universal_file import Points
from hertzloop.fitting.records.reading import read_record
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import load

_HAMMER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "hammer"
_NOISE, _JUDGED_HZ, _LOWEST_HZ = 1e-3, 5e3, 50.0
# How near in frequency a mode counts as found, relative, or in bandwidths.
_FOUND, _FOUND_BANDWIDTHS = 1e-3, 0.1
_TOLERANCES = ((0.001, 0.05), (0.01, 0.1), (0.02, 0.5))  # of frequency and damping
_ACCELERATION = 2  # order of the derivative
_PADDED = 16  # lengths of a record, so that a response does not wrap around

# Scenes, and the distance of their lines, Hz.
_CASES = (("offcentre-6mm", 0.5), ("oak-20mm", 0.5))

OURS, SDYPY = "hertzloop", "sdypy-EMA"


class Estimate(NamedTuple):
    """Modes of a response: `poles`, rad/s, (modes,), residues `constants`, 1/kg, (modes,), and the
    lower and the upper residual of the accelerance."""

    poles: np.ndarray
    constants: np.ndarray
    lower: complex
    upper: complex

    def accelerance(self, omega: np.ndarray) -> np.ndarray:
        """Acceleration over force, m/s^2/N, (lines,)."""
        s = 1j * omega[:, None]
        fractions = self.constants / (s - self.poles)
        fractions = fractions + self.constants.conj() / (s - self.poles.conj())
        return s[:, 0] ** 2 * np.sum(fractions, axis=1) + self.lower - omega**2 * self.upper


class Grid(NamedTuple):
    """Settings of sdypy-EMA that are tried: windows, s (None: no window), upper ends of the band,
    Hz, and orders of the polynomial."""

    windows_s: Sequence[float | None]
    highest_hz: Sequence[float]
    orders: Sequence[int]


_RESPONSES = Grid((None,), (6e3,), (60, 80, 100))
_HITS = Grid((None, 0.02, 0.01, 0.006), (8e3, 1e4), (40, 60, 80, 100))
_QUICK_RESPONSES = Grid((None,), (2e3,), (20,))
_QUICK_HITS = Grid((0.02,), (8e3,), (40,))


@dataclass(frozen=True)
class KnownModes:
    """Modes of a scene up to 5 kHz: how many there are, how many a method finds, and the median
    relative deviation of those in frequency, damping and drive-point constant."""

    scene: str
    method: str
    modes: int
    found: int
    frequency: float
    damping: float
    constant: float


@dataclass(frozen=True)
class HeldHit:
    """A hit that a method predicts by the others: its modes, the error over the first 40 ms, rms
    over rms."""

    hit: str
    method: str
    modes: int
    rms: float


def estimates(hz: np.ndarray, accelerance: np.ndarray, grid: Grid) -> Iterator[Estimate]:
    """Modes that sdypy-EMA finds in an accelerance with the settings of a grid."""
    from sdypy import EMA

    for highest_hz in grid.highest_hz:
        with _quiet():
            model = EMA.Model(
                accelerance[None],
                hz,
                lower=_LOWEST_HZ,
                upper=highest_hz,
                pol_order_high=max(grid.orders),
                frf_form="accelerance",
            )
            model.get_poles(method="lscf", show_progress=False)
        for order, tolerances in product(grid.orders, _TOLERANCES):
            chosen = stable_poles(model, order, *tolerances)
            if not chosen:
                continue
            model.pole_ind = np.array([(order - 1, i) for i in chosen])
            with _quiet():
                model.get_constants()
            poles = model.all_poles[order - 1][chosen]
            yield Estimate(poles, model.A[0], complex(model.LR[0]), complex(model.UR[0]))


def stable_poles(model: Any, order: int, frequency: float, damping: float) -> list[int]:
    """Which poles of an order the order below has too, within relative tolerances."""
    hz, loss = model.pole_freq[order - 1], model.pole_xi[order - 1]
    below_hz, below_loss = model.pole_freq[order - 2], model.pole_xi[order - 2]
    chosen = []
    for i in np.flatnonzero((model.all_poles[order - 1].imag > 0.0) & (loss > 0.0)):
        near = int(np.argmin(np.abs(below_hz - hz[i])))
        if (
            model.lower < hz[i] < model.upper
            and abs(below_hz[near] / hz[i] - 1.0) < frequency
            and abs(below_loss[near] / loss[i] - 1.0) < damping
        ):
            chosen.append(int(i))
    return chosen


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what sdypy-EMA prints, and its warnings, from the terminal."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def known_modes(scene: str, line_hz: float, grid: Grid) -> list[KnownModes]:
    """Identify the modes of a scene from its accelerance at the contact point, with noise of 0.1 %
    of each value, by both methods."""
    known, hz = modes_of_scene(load(scene)), np.arange(5.0, max(grid.highest_hz), line_hz)
    exact = response(known, hz, known.shape_contact, _ACCELERATION)
    parts = np.random.default_rng(1).standard_normal((2, len(hz))) / np.sqrt(2.0)
    values = exact + _NOISE * np.abs(exact) * (parts[0] + 1j * parts[1])
    w, band = known.omega_rad_s, hz > _LOWEST_HZ
    judged = (w > 2.0 * np.pi * _LOWEST_HZ) & (w < 2.0 * np.pi * min(_JUDGED_HZ, hz[-1]))
    count = int(np.count_nonzero(judged))
    measured = FrequencyResponses(
        hz, values[None], noise_weights(values)[None], _ACCELERATION, (1,), 1, "z"
    )
    table = modes_of_responses(measured, None, Points(1), lambda *_: None).table
    best = min(
        estimates(hz, values, grid),
        key=lambda one: prediction_errors(one.accelerance(2.0 * np.pi * hz[band]), values[band])[0],
    )
    found, apart = _deviations(known, judged, table)
    ours = KnownModes(scene, OURS, count, found, *apart)
    found, apart = _deviations(known, judged, _as_table(best))
    return [ours, KnownModes(scene, SDYPY, count, found, *apart)]


def _as_table(estimate: Estimate) -> ModeTable:
    """The real modes nearest to an estimate; a drive point has no negative constant."""
    omega = np.abs(estimate.poles)
    residues = (2j * estimate.poles.imag * estimate.constants).real
    shape = np.sqrt(np.maximum(residues, 0.0))
    loss = -2.0 * estimate.poles.real / omega
    return ModeTable(omega, loss, np.ones(len(omega)), shape, shape)


def _deviations(known: ModeTable, judged: np.ndarray, table: ModeTable) -> tuple[int, list[float]]:
    """How many of the `judged` modes are found, and the median deviation of their frequencies,
    damping and constants."""
    loss = np.broadcast_to(known.loss_factor, known.omega_rad_s.shape)
    constant = known.per_modal_mass_1_kg * known.shape_contact**2
    found = []
    for mode in np.flatnonzero(judged):
        omega = known.omega_rad_s[mode]
        near = int(np.argmin(np.abs(table.omega_rad_s - omega)))
        ratio = table.omega_rad_s[near] / omega
        if abs(ratio - 1.0) < max(_FOUND, _FOUND_BANDWIDTHS * loss[mode]):
            damping = table.loss_factor[near] / loss[mode]
            found.append((ratio, damping, table.shape_contact[near] ** 2 / constant[mode]))
    if not found:
        return 0, [math.nan] * 3
    return len(found), np.median(np.abs(np.array(found) - 1.0), axis=0).tolist()


def accelerance_of(
    hits: Sequence[HitResponse], window_s: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and the accelerance H1 of hits, both (lines,); an exponential window on
    force and response makes the poles decay faster by one over its time constant."""
    count = max(len(hit.force_n) for hit in hits)
    across, own = np.zeros(count // 2 + 1, complex), np.zeros(count // 2 + 1)
    for hit in hits:
        window = _window(hit, window_s)
        force = np.fft.rfft(window * hit.force_n, count)
        across += np.conj(force) * np.fft.rfft(window * hit.response, count)
        own += np.abs(force) ** 2
    return np.fft.rfftfreq(count, hits[0].interval_s), across / own


def _window(hit: HitResponse, window_s: float | None) -> np.ndarray:
    after_s = hit.interval_s * np.maximum(np.arange(len(hit.force_n)) - hit.first, 0)
    return np.ones(len(after_s)) if window_s is None else np.exp(-after_s / window_s)


def predicted(estimate: Estimate, hit: HitResponse, window_s: float | None) -> np.ndarray:
    """Acceleration, m/s^2, (samples,), that modes of windowed hits give for the force of a hit."""
    count, window = len(hit.force_n), _window(hit, window_s)
    omega = 2.0 * np.pi * np.fft.rfftfreq(_PADDED * count, hit.interval_s)
    force = np.fft.rfft(window * hit.force_n, _PADDED * count)
    return np.fft.irfft(estimate.accelerance(omega) * force, _PADDED * count)[:count] / window


def held_hits(hits: Sequence[HitResponse], held: int, grid: Grid) -> list[HeldHit]:
    """Predict a hit by the others, by both methods."""
    fitted, hit, name = [*hits[:held], *hits[held + 1 :]], hits[held], f"hit {held + 1}"
    check = modes_of_hits(fitted, [hit], False, lambda *_: None).held_out[0]
    found = HeldHit(name, OURS, check.modes, check.rms)
    others = []
    for window_s in grid.windows_s:
        for estimate in estimates(*accelerance_of(fitted, window_s), grid):
            modelled = predicted(estimate, hit, window_s)[hit.checked]
            errors = prediction_errors(modelled, hit.response[hit.checked])
            others.append((errors[0], len(estimate.poles)))
    rms, modes = min(others)
    return [found, HeldHit(name, SDYPY, modes, rms)]


def main(
    out_dir: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Identify modes of shipped scenes and of the shipped hits of a hammer, with hertzloop and with
    sdypy-EMA.

    Example: python -m benchmarks.compare_modes --quick
    """
    with results_in(out_dir, "compare-modes", json_file=json_file) as results:
        need("sdypy")
        records = [read_record(_HAMMER / f"{kind}{i}.csv") for i in (1, 2, 3) for kind in "fa"]
        hits = hits_of_records(records)
        cases = _CASES[:1] if quick else _CASES
        responses, grid = (_QUICK_RESPONSES, _QUICK_HITS) if quick else (_RESPONSES, _HITS)
        known = [
            one for case in tracked("scenes", cases) for one in known_modes(*case, grid=responses)
        ]
        results.write("known-modes", known)
        results.table(
            f"deviation up to {_JUDGED_HZ / 1e3:g} kHz, median; noise {_NOISE:g}",
            {
                "scene": "{.scene}",
                "method": "{.method}",
                "found": lambda one: f"{one.found} of {one.modes}",
                "frequency": "{.frequency:.0e}",
                "damping, %": lambda one: f"{100 * one.damping:.2g}",
                "constant, %": lambda one: f"{100 * one.constant:.2g}",
            },
            known,
            text=2,
        )
        numbers = tracked("hits", range(1 if quick else len(hits)))
        held = [one for number in numbers for one in held_hits(hits, number, grid)]
        results.write("held-hits", held)
        results.table(
            "hits predicted by the other two, first 40 ms",
            {
                "hit": "{.hit}",
                "method": "{.method}",
                "modes": "{.modes}",
                "error/rms, %": lambda one: f"{100 * one.rms:.1f}",
            },
            held,
            text=2,
        )
        worst = {
            name: 100.0 * max(one.rms for one in held if one.method == name)
            for name in (OURS, SDYPY)
        }
        results.conclude(
            f"The error of a hit that is held out is {worst[OURS]:.1f} % at most with hertzloop, "
            f"and {worst[SDYPY]:.1f} % with sdypy-EMA."
        )


if __name__ == "__main__":
    start("benchmarks.compare_modes")
