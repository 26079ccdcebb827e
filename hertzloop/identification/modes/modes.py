"""From measured responses to a file of modes, with its error on what was held out."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hertzloop.identification.modes.delay import correct_delay
from hertzloop.identification.modes.hits import Hit, peaks_hz, response_errors, rows_of_hits
from hertzloop.identification.modes.identify import (
    FLEXIBILITY_M_N,
    FittedModes,
    ResponseRows,
    identify_modes,
    refine_modes,
    remove_modes_below,
    remove_weak_modes,
)
from hertzloop.identification.modes.responses import EVERY, FrequencyResponses
from hertzloop.identification.modes.universal import ModalDataError, Points
from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.mode_file import ModeTable

ModesCallback = Callable[[str, int, float], None]
_NOT_HERE = 2.0  # times the error, without the modes of negative residue: not a drive point
_POOR = 0.1  # error of held-out hits, above which something is wrong
_SMALL = 0.05  # error that is good enough without them
_ENOUGH = 8  # modes that tell; with a wrong sign the best model may have a single one
# A mode without bandwidth, over the least; the negative damping that is tried for it, of what the
# window adds; and by which share of the square it has to fit better.
_NO_WIDTH, _NEGATIVE, _MATTERS = 1.01, 0.25, 0.1
# Share of the squares left that a mode has to explain where something was corrected, as what the
# correction leaves is not noise.
_LEAST_WORTH = 0.05
_TOO_MANY = 3.0  # modes for each peak
_LAST_LINES = 30_000  # of the last fit, whose accuracy goes with the root of their number


@dataclass(frozen=True)
class HoldOutCheck:
    """What was held out, its error, relative: rms over rms, and the largest over the largest; and
    what was measured and modelled over `x`, for a picture."""

    name: str
    modes: int
    rms: float
    peak: float
    x: np.ndarray
    measured: np.ndarray
    modelled: np.ndarray


@dataclass(frozen=True)
class MeasuredModes:
    """Modes of a measurement as a file has them, their check, and sentences on what they miss.
    `delay_s`: by which the response was late against the force, now corrected."""

    table: ModeTable
    held_out: tuple[HoldOutCheck, ...]
    notes: tuple[str, ...]
    delay_s: float = 0.0


@on_one_thread
def modes_of_hits(
    hits: Sequence[Hit], held: Sequence[Hit], at_contact: bool, tell: ModesCallback
) -> MeasuredModes:
    """Return the modes of hits.

    Args:
        hits: the hits that are fitted. Without `held` ones, each is held out in turn first.
        held: hits that are predicted.
        at_contact: whether the response was measured at the point that is hit.
        tell: is told the hit that is held out, the number of modes, and the error.

    Raises:
        ModalDataError: the response cannot be of the point that is hit, or is late by a delay that
            the hits do not tell, or the window takes more damping than a mode has.
    """
    hits, held, late = correct_delay(hits, held)
    turns = (
        [(list(hits), list(held))]
        if held
        else [([*hits[:i], *hits[i + 1 :]], [one]) for i, one in enumerate(hits)]
    )
    if len(hits) == 1 and not held:
        turns = [(list(hits), list(hits))]
    found: list[HoldOutCheck] = []
    best: FittedModes | None = None
    for fitted, predicted in turns:
        observed = rows_of_hits(fitted, at_contact)

        def error(modes: FittedModes, predicted: list[Hit] = predicted) -> float:
            return math.sqrt(
                np.mean([one.rms**2 for one in _predict_hits(modes, predicted, at_contact)])
            )

        name = "; ".join(one.name for one in predicted)
        modes = identify_modes(observed, error, tell=partial(tell, name))
        if at_contact:
            _check_passive(observed, modes, error)
        checked = _predict_hits(modes, predicted, at_contact)
        if best is None or sum(c.rms for c in checked) < found[-1].rms * len(checked):
            best = modes
        found += checked
    assert best is not None
    observed = rows_of_hits(hits, at_contact)
    modes = remove_weak_modes(observed, refine_modes(observed, best.omega_rad_s, best.loss_factor))
    if late or hits[0].window_s is not None:
        modes = remove_modes_below(observed, modes, _LEAST_WORTH)
    notes = [note for one in (*hits, *held) for note in one.notes]
    _check_window(hits, observed, modes)
    notes += _note_on_many_modes(hits, modes)
    if late:
        notes.append(_note_on_delay(late, hits[0].interval_s))
    if len(hits) == 1 and not held:
        notes.append("One hit checks nothing: the error is that of the fit. Measure two or more.")
        found = [replace(one, name=f"{one.name} (fitted)") for one in found]
    worst = max(one.rms for one in found)
    if worst > _POOR:
        notes.append(
            f"The error of {100 * worst:.0f} % is large: the hits do not follow from each other. "
            "Check that forces and responses are of the same hits in the same order, that no range "
            "was exceeded, that the structure was at rest before each hit, that both were sampled "
            "at the same time, and the noise."
        )
    by_force, shapes = _scaled_shapes(modes.residues, 0 if at_contact else None)
    if at_contact:
        residual = max(0.0, float(modes.rest[0, 0]) * FLEXIBILITY_M_N)
    else:
        residual = None
        notes.append(_SPLIT)
    table = _mode_table(modes, by_force, by_force, None if at_contact else shapes[0], residual)
    return MeasuredModes(table, tuple(found), tuple(notes), late * hits[0].interval_s)


def _check_window(hits: Sequence[Hit], observed: ResponseRows, modes: FittedModes) -> None:
    """Raise ModalDataError if the window takes all damping of a mode that matters."""
    window_s = hits[0].window_s
    if window_s is None:
        return
    hz, loss = modes.omega_rad_s / (2.0 * math.pi), modes.loss_factor
    least = loss * hz <= _NO_WIDTH * observed.least_width_hz
    negative = np.where(least, -_NEGATIVE * 2.0 / (window_s * modes.omega_rad_s), loss)
    for i in np.flatnonzero(least):
        tried = np.where(np.arange(len(loss)) == i, negative, loss)
        if (
            refine_modes(observed, modes.omega_rad_s, tried, 0).square
            > (1.0 - _MATTERS) * modes.square
        ):
            continue
        raise ModalDataError(
            f"--exponential-window = {window_s:g}: the mode at {hz[i]:.5g} Hz would get a negative "
            "damping, since it decays more slowly than the window. Give the time constant of the "
            "recorder's window, or remove the option."
        )


def _note_on_many_modes(hits: Sequence[Hit], modes: FittedModes) -> list[str]:
    """A sentence on far more modes than the response has peaks."""
    peaks, end_hz = peaks_hz(hits)
    count = int(np.count_nonzero(modes.omega_rad_s <= 2.0 * math.pi * end_hz))
    if count < _TOO_MANY * max(1, len(peaks)):
        return []
    windowed = hits[0].window_s is not None
    return [
        f"{count} modes stand for {len(peaks)} peaks of the response up to {end_hz:.4g} Hz. So "
        "many modes say that the records are not those of a structure alone. Possible causes: "
        + (
            "another time constant than --exponential-window gives"
            if windowed
            else "an exponential window (give --exponential-window SECONDS, its time constant)"
        )
        + ", or a delay that differs between the hits."
    ]


def _note_on_delay(samples: float, interval_s: float) -> str:
    size = f"{abs(samples):.2f}"
    return (
        f"The response is {'late' if samples > 0.0 else 'early'} by {size} "
        f"sample{'' if size == '1.00' else 's'} ({1e6 * abs(samples) * interval_s:.3g} us) against "
        "the force. The delay is corrected."
    )


_SPLIT = (
    "No response was measured at the contact point itself. Each mode is taken as large there as at "
    "the sensor: the response from contact to sensor is the measured one, but how far the contact "
    "point gives way is not known. Measure there too to know it."
)


def _check_passive(
    observed: ResponseRows, modes: FittedModes, error: Callable[[FittedModes], float]
) -> None:
    """Raise ModalDataError if residues of any sign explain a response much better: then it was not
    measured at the point of the force."""
    passive = error(modes)
    if passive <= _NOT_HERE * _SMALL:
        return
    most = max(len(modes.omega_rad_s), _ENOUGH)
    of_any_sign = identify_modes(replace(observed, drive=None), error, most=most)
    free = error(of_any_sign)
    if passive > _NOT_HERE * max(free, _SMALL):
        raise ModalDataError(
            f"--sensor: is missing. Taken as measured at the contact point, the response is "
            f"modelled to {100 * passive:.0f} % only, else to {100 * free:.0f} %: its modes differ "
            "in sign there. Give --sensor NAME, the point of the response, or turn the sign of the "
            "response if its sensor looks down."
        )


def _predict_hits(modes: FittedModes, hits: Sequence[Hit], at_contact: bool) -> list[HoldOutCheck]:
    found = []
    for one in hits:
        modelled = modes.response(rows_of_hits([one], at_contact))[0]
        x = one.interval_s * (np.arange(len(modelled)) - one.first)
        kept = one.judged
        pair = response_errors(modelled[kept], one.response[kept])
        found.append(
            HoldOutCheck(
                one.name,
                len(modes.omega_rad_s),
                *pair,
                x[kept],
                one.response[kept],
                modelled[kept],
            )
        )
    return found


@on_one_thread
def modes_of_responses(
    responses: FrequencyResponses,
    held: FrequencyResponses | None,
    points: Points,
    tell: ModesCallback,
) -> MeasuredModes:
    """Return the modes of frequency responses. Every fifth line is held out, or another
    measurement, `held`; the file has the modes within the band only."""
    lines = responses.thinned()
    out = np.zeros(len(lines.hz), bool)
    out[EVERY - 1 :: EVERY] = held is None
    fitted, judged = lines.at(~out), held or lines.at(out)
    drive = responses.drive

    def error(modes: FittedModes) -> float:
        left = (modes.response(judged.observed()) - judged.values) * judged.weights
        return float(np.sqrt(np.mean(np.abs(left) ** 2)))

    name = "lines held out" if held is None else "held-out measurement"
    observed = fitted.observed()
    modes = identify_modes(observed, error, fitted.start(), tell=partial(tell, name))
    observed = lines.observed()
    modes = remove_weak_modes(
        observed, refine_modes(observed, modes.omega_rad_s, modes.loss_factor)
    )
    observed = responses.thinned(_LAST_LINES).observed()
    modes = refine_modes(observed, modes.omega_rad_s, modes.loss_factor, gain=1e-6)
    inside = modes.omega_rad_s <= 2.0 * np.pi * responses.hz[-1]
    kept = FittedModes(
        modes.omega_rad_s[inside],
        modes.loss_factor[inside],
        modes.residues[:, inside],
        0.0 * modes.rest,
        modes.square,
    )
    by_force, shapes = _scaled_shapes(kept.residues, drive)
    residual, notes = None, []
    if drive is None:
        notes.append(_SPLIT)
    elif points.contact == responses.reference:
        above = modes.residues[drive, ~inside] / modes.omega_rad_s[~inside] ** 2
        residual = max(0.0, float(modes.rest[drive, 0] * FLEXIBILITY_M_N + np.sum(above)))
        kept.rest[drive, 0] = residual / FLEXIBILITY_M_N

    def at(node: int | None) -> np.ndarray:
        node = points.contact if node is None else node
        return shapes[responses.nodes.index(node)] if node in responses.nodes else by_force

    table = _mode_table(
        kept,
        at(points.contact),
        at(points.actuator),
        None if points.sensor is None else at(points.sensor),
        residual,
    )
    modelled = kept.response(judged.observed())
    checked = [
        HoldOutCheck(
            f"node {node}, {name}",
            len(kept.omega_rad_s),
            *response_errors(model, measured),
            judged.hz,
            measured,
            model,
        )
        for node, measured, model in zip(judged.nodes, judged.values, modelled, strict=True)
    ]
    return MeasuredModes(table, tuple(checked), tuple(notes))


def _scaled_shapes(residues: np.ndarray, drive: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Mass-normalised shapes at the force, (modes,), and at the points, (points, modes)."""
    own = residues[drive] if drive is not None else np.abs(residues[0])
    by_force = np.sqrt(np.maximum(own, 1e-300))
    return by_force, residues / by_force


def _mode_table(
    modes: FittedModes,
    contact: np.ndarray,
    actuator: np.ndarray,
    sensor: np.ndarray | None,
    residual: float | None,
) -> ModeTable:
    return ModeTable(
        modes.omega_rad_s,
        modes.loss_factor,
        np.ones(len(contact)),
        contact,
        actuator,
        residual,
        shape_sensor=sensor,
    )
