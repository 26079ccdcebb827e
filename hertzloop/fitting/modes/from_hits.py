"""Modes of hits, checked by hits that are held out."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hertzloop.fitting.modes.delay import correct_delay
from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.hit_responses import HitResponse
from hertzloop.fitting.modes.hit_rows import rows_of_hits
from hertzloop.fitting.modes.identify import (
    identify_modes,
    refine_modes,
    remove_modes_below,
    remove_weak_modes,
)
from hertzloop.fitting.modes.measured_modes import (
    NO_DRIVE_POINT,
    HoldOutCheck,
    MeasuredModes,
    ModesCallback,
    check_prediction,
    mode_table,
    scaled_shapes,
)
from hertzloop.fitting.modes.peaks import response_peaks
from hertzloop.fitting.modes.response_rows import (
    FLEXIBILITY_M_N,
    FittedModes,
    ResponseRows,
)
from hertzloop.plant.one_thread import on_one_thread

_LARGE = 0.1  # error of held-out hits above which a note names possible causes
# A response is not of the drive point if residues of any sign have an error that is half as large.
# Errors below 5 % are good enough to tell nothing.
_HALF, _GOOD = 2.0, 0.05
_FEWEST_TRIED = 8  # modes with residues of any sign; with a wrong sign the best model may have one
# A mode up to this factor on the least bandwidth has no damping of its own. It is tried with a
# negative one, a share of that of the window, which has to explain this share of the square.
_NO_WIDTH, _NEGATIVE, _EXPLAINS = 1.01, 0.25, 0.1
_LEAST_SHARE = 0.05  # of the squares left, for a mode: what a correction leaves is not noise
_TOO_MANY = 3.0  # modes for each peak


@on_one_thread
def modes_of_hits(
    hits: Sequence[HitResponse],
    held: Sequence[HitResponse],
    at_contact: bool,
    on_round: ModesCallback,
) -> MeasuredModes:
    """Return the modes of hits.

    Args:
        hits: the hits that are fitted. Without `held` ones, each is held out in turn first.
        held: hits that are predicted.
        at_contact: whether the response was measured at the point that is hit.
        on_round: is called with the hit that is held out, the number of modes and the error.

    Raises:
        ModalDataError: the response cannot be of the point that is hit, or is late by a delay that
            the hits do not tell, or the window takes more damping than a mode has.
    """
    hits, held, late = correct_delay(hits, held)
    best, checks = _best_turn(_turns(hits, held), at_contact, on_round)
    observed = rows_of_hits(hits, at_contact)
    modes = remove_weak_modes(observed, refine_modes(observed, best.omega_rad_s, best.loss_factor))
    if late or hits[0].window_s is not None:
        modes = remove_modes_below(observed, modes, _LEAST_SHARE)
    _check_window(hits, observed, modes)
    notes = [note for one in (*hits, *held) for note in one.notes]
    notes += _note_on_many_modes(hits, modes)
    if late:
        notes.append(_note_on_delay(late, hits[0].interval_s))
    if len(hits) == 1 and not held:
        notes.append("One hit checks nothing: the error is that of the fit. Measure two or more.")
        checks = [replace(one, name=f"{one.name} (fitted)") for one in checks]
    notes += _note_on_large_error(max(one.rms for one in checks))
    at_force, shapes = scaled_shapes(modes.residues, 0 if at_contact else None)
    sensor, residual_m_n = None, None
    if at_contact:
        residual_m_n = max(0.0, float(modes.rest[0, 0]) * FLEXIBILITY_M_N)
    else:
        sensor = shapes[0]
        notes.append(NO_DRIVE_POINT)
    table = mode_table(modes, at_force, at_force, sensor, residual_m_n)
    return MeasuredModes(table, tuple(checks), tuple(notes), late * hits[0].interval_s)


_Turn = tuple[list[HitResponse], list[HitResponse]]  # hits to fit, hits to predict


def _turns(hits: list[HitResponse], held: list[HitResponse]) -> list[_Turn]:
    """Return which hits are fitted and which are predicted in each turn."""
    if held:
        return [(hits, held)]
    if len(hits) == 1:
        return [(hits, hits)]
    return [([*hits[:i], *hits[i + 1 :]], [one]) for i, one in enumerate(hits)]


def _best_turn(
    turns: Sequence[_Turn], at_contact: bool, on_round: ModesCallback
) -> tuple[FittedModes, list[HoldOutCheck]]:
    """Return the modes of the turn with the least error, and the checks of all turns."""
    found: list[HoldOutCheck] = []
    best: FittedModes | None = None
    least = math.inf  # sum of the errors of the best turn; every turn predicts as many hits
    for fitted, predicted in turns:
        observed = rows_of_hits(fitted, at_contact)

        def error(modes: FittedModes, predicted: list[HitResponse] = predicted) -> float:
            return math.sqrt(
                np.mean([one.rms**2 for one in _predict_hits(modes, predicted, at_contact)])
            )

        name = "; ".join(one.name for one in predicted)
        modes = identify_modes(observed, error, on_round=partial(on_round, name))
        if at_contact:
            _check_drive_point(observed, modes, error)
        checked = _predict_hits(modes, predicted, at_contact)
        total = sum(c.rms for c in checked)
        if best is None or total < least:
            best, least = modes, total
        found += checked
    assert best is not None
    return best, found


def _predict_hits(
    modes: FittedModes, hits: Sequence[HitResponse], at_contact: bool
) -> list[HoldOutCheck]:
    """Return the checks of the hits, over the first 40 ms of each."""
    found = []
    for one in hits:
        modelled = modes.response(rows_of_hits([one], at_contact))[0]
        x, kept = one.interval_s * (np.arange(len(modelled)) - one.first), one.checked
        found.append(check_prediction(one.name, modes, x[kept], one.response[kept], modelled[kept]))
    return found


def _check_drive_point(
    observed: ResponseRows, modes: FittedModes, error: Callable[[FittedModes], float]
) -> None:
    """Raise ModalDataError if residues of any sign explain a response much better: then it was not
    measured at the point of the force."""
    positive = error(modes)
    if positive <= _HALF * _GOOD:
        return
    most = max(len(modes.omega_rad_s), _FEWEST_TRIED)
    any_sign = error(identify_modes(replace(observed, drive=None), error, most=most))
    if positive > _HALF * max(any_sign, _GOOD):
        raise ModalDataError(
            f"--sensor: is missing. Taken as measured at the contact point, the response is "
            f"modelled to {100 * positive:.0f} % only, else to {100 * any_sign:.0f} %: its modes "
            "differ in sign there. Give --sensor NAME, the point of the response, or turn the sign "
            "of the response if its sensor looks down."
        )


def _check_window(hits: Sequence[HitResponse], observed: ResponseRows, modes: FittedModes) -> None:
    """Raise ModalDataError if the window takes all damping of a mode that matters."""
    window_s = hits[0].window_s
    if window_s is None:
        return
    hz, loss = modes.omega_rad_s / (2.0 * math.pi), modes.loss_factor
    undamped = loss * hz <= _NO_WIDTH * observed.least_width_hz
    negative = np.where(undamped, -_NEGATIVE * 2.0 / (window_s * modes.omega_rad_s), loss)
    for i in np.flatnonzero(undamped):
        tried = np.where(np.arange(len(loss)) == i, negative, loss)
        square = refine_modes(observed, modes.omega_rad_s, tried, 0).square
        if square <= (1.0 - _EXPLAINS) * modes.square:
            raise ModalDataError(
                f"--exponential-window = {window_s:g}: the mode at {hz[i]:.5g} Hz would get a "
                "negative damping, since it decays more slowly than the window. Give the time "
                "constant of the recorder's window, or remove the option."
            )


def _note_on_many_modes(hits: Sequence[HitResponse], modes: FittedModes) -> list[str]:
    """Return a sentence if there are far more modes than peaks of the response."""
    peaks, end_hz = response_peaks(hits)
    count = int(np.count_nonzero(modes.omega_rad_s <= 2.0 * math.pi * end_hz))
    if count < _TOO_MANY * max(1, peaks):
        return []
    if hits[0].window_s is None:
        cause = "an exponential window (give --exponential-window SECONDS, its time constant)"
    else:
        cause = "another time constant than --exponential-window gives"
    return [
        f"{count} modes stand for {peaks} peaks of the response up to {end_hz:.4g} Hz. So many "
        "modes say that the records are not those of a structure alone. Possible causes: "
        f"{cause}, or a delay that differs between the hits."
    ]


def _note_on_delay(samples: float, interval_s: float) -> str:
    size = f"{abs(samples):.2f}"
    return (
        f"The response is {'late' if samples > 0.0 else 'early'} by {size} "
        f"sample{'' if size == '1.00' else 's'} ({1e6 * abs(samples) * interval_s:.3g} us) against "
        "the force. The delay is corrected."
    )


def _note_on_large_error(worst: float) -> list[str]:
    if worst <= _LARGE:
        return []
    return [
        f"The error of {100 * worst:.0f} % is large: the hits do not follow from each other. "
        "Check that forces and responses are of the same hits in the same order, that no range "
        "was exceeded, that the structure was at rest before each hit, that both were sampled "
        "at the same time, and the noise."
    ]
