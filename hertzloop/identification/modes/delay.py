"""Delay of the response against the force, as of a multiplexed converter: found and corrected.

A delay turns the phase of each mode by its frequency times the delay, and a real residue cannot
follow. So a few modes explain the hits at the true delay only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from hertzloop.identification.modes.hits import Hit, rows_of_hits
from hertzloop.identification.modes.identify import (
    FittedModes,
    ResponseRows,
    add_modes,
    refine_modes,
    remove_weak_modes,
)
from hertzloop.identification.modes.universal import ModalDataError

_REACH, _STEP = 6.0, 0.5  # samples: how far a delay is looked for, and in which steps
_ROUGH_S, _FINE_S = 0.02, 0.04  # after the hit, that the search and the estimate use
_HITS = 3  # that are used: all have one delay
_FIRST, _ROUNDS = 2, 10  # rounds that add modes: of the search, and the most of an estimate
_REFINED = 3  # steps of a fit at each delay that is tried
_BASINS, _HOPELESS = 3, 9.0  # of the search: how many are followed; square, over the least
_NEAR, _TOLERANCE = 0.4, 0.005  # samples: around the present estimate, and its accuracy
_GAIN, _PATIENCE = 0.1, 2  # share of the square that more modes explain, and rounds without
_PER_MODE = 3.0  # of ln(rows) over the rows: share of the square that a mode has to explain
_LEAST = 0.1  # samples: less is no delay
_WORTH = 0.05  # share of the square that a delay has to explain
# Errors: below, nothing else is looked for; above, a delay has to halve it; above, it is not told.
_GOOD, _POOR, _LOST = 0.05, 0.1, 0.3
_HALF, _ALIKE = 0.25, 1.1  # ratios of squares: half the error; two delays that fit as well


@dataclass(frozen=True)
class _Estimate:
    """A delay, the square of the error of a few modes with it, relative, that with none, and the
    first one with a share for each mode, by which delays are compared."""

    samples: float
    square: float
    without: float
    score: float

    @property
    def error(self) -> float:
        """Rms over rms."""
        return math.sqrt(self.square)

    @property
    def late(self) -> bool:
        """Whether there is a delay, and it explains something."""
        explains = self.square < (1.0 - _WORTH) * self.without
        return abs(self.samples) >= _LEAST and explains


def delay_force(hit: Hit, samples: float) -> Hit:
    """Return a hit whose force is moved by the delay of its response, in samples.

    The response stays: it does not end within the record, as the force does.
    """
    length = 2 * scipy.fft.next_fast_len(len(hit.force_n), real=True)
    turned = np.exp(-2j * np.pi * samples * np.fft.rfftfreq(length))
    force = np.fft.irfft(turned * np.fft.rfft(hit.force_n, length), length)
    first = max(1, hit.first + round(samples))
    return replace(hit, force_n=force[: len(hit.force_n)], first=first)


def correct_delay(hits: Sequence[Hit], others: Sequence[Hit]) -> tuple[list[Hit], list[Hit], float]:
    """Return hits without the delay of their responses, others that share it, and the delay in
    samples. Of hits with a window, the force has it or not, whichever explains them better.

    Raises:
        ModalDataError: there is a delay, but the hits do not tell it.
    """
    late = delay_of(hits)
    windowed = [hit.of_windowed_force() for hit in hits]
    if hits[0].window_s is not None and _estimate_near(_first_hits(windowed), late).score < (
        _estimate_near(_first_hits(hits), late).score
    ):
        hits, others = windowed, [hit.of_windowed_force() for hit in others]
        late = delay_of(hits)
    if late:
        hits, others = ([delay_force(hit, late) for hit in some] for some in (hits, others))
    return list(hits), list(others), late


def _first_hits(hits: Sequence[Hit], seconds: float = _FINE_S) -> list[Hit]:
    """Some of the hits, for so long after each hit."""
    ends = [hit.first + round(seconds / hit.interval_s) for hit in hits[:_HITS]]
    return [
        replace(hit, force_n=hit.force_n[:end], response=hit.response[:end])
        for hit, end in zip(hits, ends, strict=False)
    ]


def delay_of(hits: Sequence[Hit]) -> float:
    """Return by how many samples the responses are late against the forces; 0.0 if that explains
    nothing, and where the modes do not explain the hits at any delay.

    Raises:
        ModalDataError: there is a delay, but the hits do not tell it.
    """
    fine = _first_hits(hits)
    at_once = _estimate_near(fine, 0.0)
    if abs(at_once.samples) < _LEAST and at_once.error < _GOOD:
        return 0.0
    basins = _basins(_first_hits(hits, _ROUGH_S))
    found = [at_once, *(_estimate_near(fine, start) for start in basins)]
    best = min(found, key=lambda one: one.score)
    if not best.late:
        return 0.0
    best = _estimate_near(fine, best.samples, _PATIENCE)
    if not best.late:
        return 0.0
    if best.error > _POOR and best.square > _HALF * best.without:
        return 0.0
    if best.error > _LOST:
        raise ModalDataError(
            "--from: the response is not simultaneous with the force, and the hits do not tell its "
            f"delay. A delay of {best.samples:.2f} samples fits best, with an error of "
            f"{100 * best.error:.0f} %. {_REMEDY}"
        )
    for other in found:
        alike = other.late and other.score < _ALIKE * best.score
        if alike and abs(other.samples - best.samples) > _STEP:
            raise ModalDataError(
                "--from: the hits do not tell the delay of the response against the force: "
                f"{best.samples:.2f} and {other.samples:.2f} samples fit equally well. {_REMEDY}"
            )
    return best.samples


_REMEDY = "Record both with a converter that samples them at the same time, or shift the response."


def _observed(hits: Sequence[Hit], samples: float) -> ResponseRows:
    """Hits at a delay. Residues have any sign: positive ones could be had by a wrong delay."""
    moved = [delay_force(hit, samples) if samples else hit for hit in hits]
    return replace(rows_of_hits(moved, True), drive=None)


def _no_modes(observed: ResponseRows) -> FittedModes:
    return refine_modes(observed, np.zeros(0), np.zeros(0), 0)


def _with_more_modes(observed: ResponseRows, modes: FittedModes) -> FittedModes:
    return remove_weak_modes(observed, refine_modes(observed, *add_modes(observed, modes)))


def _basins(hits: Sequence[Hit]) -> list[float]:
    """The delays around which few modes fit best, samples."""
    tried = np.arange(-_REACH, _REACH + _STEP, _STEP)
    squares = []
    for samples in tried:
        observed = _observed(hits, float(samples))
        modes = _no_modes(observed)
        for _ in range(_FIRST):
            modes = _with_more_modes(observed, modes)
        squares.append(modes.square)
    beside = np.pad(squares, 1, constant_values=np.inf)
    lowest = (beside[1:-1] <= beside[:-2]) & (beside[1:-1] <= beside[2:])
    lowest &= np.array(squares) < _HOPELESS * min(squares)
    order = sorted(np.flatnonzero(lowest), key=lambda i: squares[i])
    return [float(tried[i]) for i in order[:_BASINS]]


def _estimate_near(hits: Sequence[Hit], start: float, patience: int = 1) -> _Estimate:
    """The delay near another one, with as many modes as explain more."""
    samples, observed = start, _observed(hits, start)
    best = modes = _no_modes(observed)
    at, least, since = start, math.inf, 0
    for _ in range(_ROUNDS):
        grown = _with_more_modes(observed, modes)

        def square(x: float, grown: FittedModes = grown) -> float:
            return refine_modes(
                _observed(hits, x), grown.omega_rad_s, grown.loss_factor, _REFINED
            ).square

        samples = float(
            scipy.optimize.minimize_scalar(
                square,
                bounds=(samples - _NEAR, samples + _NEAR),
                method="bounded",
                options={"xatol": _TOLERANCE},
            ).x
        )
        observed = _observed(hits, samples)
        modes = refine_modes(observed, grown.omega_rad_s, grown.loss_factor)
        since = 0 if modes.square < (1.0 - _GAIN) * least else since + 1
        if modes.square < least:
            least, best, at = modes.square, modes, samples
        if since == patience:
            break
    without = refine_modes(_observed(hits, 0.0), best.omega_rad_s, best.loss_factor).square
    rows = observed.values.size
    per_mode = _PER_MODE * math.log(rows) / rows
    score = best.square / rows * math.exp(per_mode * len(best.omega_rad_s))
    return _Estimate(at, best.square / rows, without / rows, score)
