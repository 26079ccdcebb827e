"""Delay of the response against the force, as of a multiplexed converter: found and corrected.

A delay turns the phase of each mode by its frequency times the delay, and a real residue cannot
follow. So a few modes explain the hits at the true delay only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.hit_responses import HitResponse
from hertzloop.fitting.modes.hit_rows import rows_of_hits
from hertzloop.fitting.modes.identify import add_modes, refine_modes, remove_weak_modes
from hertzloop.fitting.modes.response_rows import FittedModes, ResponseRows

_REACH, _STEP = 6.0, 0.5  # largest delay of the search and its steps, samples
_SEARCH_S, _ESTIMATE_S = 0.02, 0.04  # time after a hit that search and estimate use
_MOST_HITS = 3  # hits that are used: all have one delay
_SEARCH_ROUNDS, _MOST_ROUNDS = 2, 10  # rounds that add modes, of the search and of an estimate
_REFINED = 3  # steps of a fit at each delay that is tried
_MOST_MINIMA = 3  # minima of the search that are followed
_HOPELESS = 9.0  # square of a minimum, over the least one, from which it is not followed
_NEAR, _TOLERANCE = 0.4, 0.005  # reach around an estimate, and its accuracy, samples
_GAIN, _PATIENCE = 0.1, 2  # share of the square that more modes explain; rounds without
_PER_MODE = 3.0  # share of the square that a mode has to explain, times the rows over ln(rows)
_LEAST_DELAY = 0.1  # samples
_LEAST_SHARE = 0.05  # share of the square that a delay has to explain
_SMALL_ERROR = 0.05  # error below which no further delay is searched
_LARGE_ERROR = 0.1  # error above which a delay has to halve the error
_MOST_ERROR = 0.3  # error above which a delay is not trusted
_HALF, _ALIKE = 0.25, 1.1  # ratios of squares: of half the error; of two delays that fit as well
_REMEDY = "Record both with a converter that samples them at the same time, or shift the response."


@dataclass(frozen=True)
class _Estimate:
    """A delay, and how well a few modes explain the hits with it.

    Args:
        samples: the delay.
        square: square of the relative error.
        without: square of the relative error of these modes without a delay.
        score: the square, larger for each mode, by which delays are compared.
    """

    samples: float
    square: float
    without: float
    score: float

    @property
    def error(self) -> float:
        """Relative error, root mean square."""
        return math.sqrt(self.square)

    @property
    def late(self) -> bool:
        """Whether there is a delay, and it explains something."""
        explains = self.square < (1.0 - _LEAST_SHARE) * self.without
        return abs(self.samples) >= _LEAST_DELAY and explains


def delay_force(hit: HitResponse, samples: float) -> HitResponse:
    """Return a hit whose force is moved by the delay of its response, in samples.

    The response stays: it does not end within the record, as the force does.
    """
    length = 2 * scipy.fft.next_fast_len(len(hit.force_n), real=True)
    turned = np.exp(-2j * np.pi * samples * np.fft.rfftfreq(length))
    force = np.fft.irfft(turned * np.fft.rfft(hit.force_n, length), length)
    first = max(1, hit.first + round(samples))
    return replace(hit, force_n=force[: len(hit.force_n)], first=first)


def correct_delay(
    hits: Sequence[HitResponse], others: Sequence[HitResponse]
) -> tuple[list[HitResponse], list[HitResponse], float]:
    """Correct the delay of the responses of hits.

    Args:
        hits: the hits that give the delay. If they have a window, their forces are taken with it or
            without it, whichever a few modes explain better.
        others: hits of the same recorder.

    Returns:
        Hits and others without the delay, and the delay in samples.

    Raises:
        ModalDataError: there is a delay, but the hits do not tell it.
    """
    late = delay_of(hits)
    windowed = [hit.with_force_before_window() for hit in hits]
    if hits[0].window_s is not None and _estimate_near(_first_hits(windowed), late).score < (
        _estimate_near(_first_hits(hits), late).score
    ):
        hits, others = windowed, [hit.with_force_before_window() for hit in others]
        late = delay_of(hits)
    if late:
        hits, others = ([delay_force(hit, late) for hit in some] for some in (hits, others))
    return list(hits), list(others), late


def _first_hits(hits: Sequence[HitResponse], seconds: float = _ESTIMATE_S) -> list[HitResponse]:
    """Return some of the hits, each up to a time after it, s."""
    ends = [hit.first + round(seconds / hit.interval_s) for hit in hits[:_MOST_HITS]]
    return [
        replace(hit, force_n=hit.force_n[:end], response=hit.response[:end])
        for hit, end in zip(hits, ends, strict=False)
    ]


def delay_of(hits: Sequence[HitResponse]) -> float:
    """Return by how many samples the responses are late against the forces.

    It is 0.0 if a delay explains nothing, or if modes do not explain the hits at any delay.

    Raises:
        ModalDataError: there is a delay, but the hits do not tell it.
    """
    fine = _first_hits(hits)
    at_once = _estimate_near(fine, 0.0)
    if abs(at_once.samples) < _LEAST_DELAY and at_once.error < _SMALL_ERROR:
        return 0.0
    minima = _search_minima(_first_hits(hits, _SEARCH_S))
    found = [at_once, *(_estimate_near(fine, start) for start in minima)]
    best = min(found, key=lambda one: one.score)
    if not best.late:
        return 0.0
    best = _estimate_near(fine, best.samples, _PATIENCE)
    if not best.late:
        return 0.0
    if best.error > _LARGE_ERROR and best.square > _HALF * best.without:
        return 0.0
    if best.error > _MOST_ERROR:
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


def _observed(hits: Sequence[HitResponse], samples: float) -> ResponseRows:
    """Return the rows of hits at a delay. Residues have any sign: if they had to be positive, a
    wrong delay could make them so."""
    moved = [delay_force(hit, samples) if samples else hit for hit in hits]
    return replace(rows_of_hits(moved, True), drive=None)


def _no_modes(observed: ResponseRows) -> FittedModes:
    return refine_modes(observed, np.zeros(0), np.zeros(0), 0)


def _with_more_modes(observed: ResponseRows, modes: FittedModes) -> FittedModes:
    return remove_weak_modes(observed, refine_modes(observed, *add_modes(observed, modes)))


def _search_minima(hits: Sequence[HitResponse]) -> list[float]:
    """Return the delays around which few modes fit best, samples."""
    tried = np.arange(-_REACH, _REACH + _STEP, _STEP)
    squares = []
    for samples in tried:
        observed = _observed(hits, float(samples))
        modes = _no_modes(observed)
        for _ in range(_SEARCH_ROUNDS):
            modes = _with_more_modes(observed, modes)
        squares.append(modes.square)
    beside = np.pad(squares, 1, constant_values=np.inf)
    lowest = (beside[1:-1] <= beside[:-2]) & (beside[1:-1] <= beside[2:])
    lowest &= np.array(squares) < _HOPELESS * min(squares)
    order = sorted(np.flatnonzero(lowest), key=lambda i: squares[i])
    return [float(tried[i]) for i in order[:_MOST_MINIMA]]


def _estimate_near(hits: Sequence[HitResponse], start: float, patience: int = 1) -> _Estimate:
    """Return the delay near another one, with as many modes as explain more."""
    samples, observed = start, _observed(hits, start)
    best = modes = _no_modes(observed)
    at, least, since = start, math.inf, 0
    for _ in range(_MOST_ROUNDS):
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
