"""Modes of frequency responses, checked by lines or a measurement that are held out."""

from dataclasses import replace
from functools import partial

import numpy as np

from hertzloop.fitting.modes.frequency_responses import HELD_OUT_EVERY, FrequencyResponses
from hertzloop.fitting.modes.identify import identify_modes, refine_modes, remove_weak_modes
from hertzloop.fitting.modes.measured_modes import (
    NO_DRIVE_POINT,
    MeasuredModes,
    ModesCallback,
    check_prediction,
    mode_table,
    scaled_shapes,
)
from hertzloop.fitting.modes.response_rows import FLEXIBILITY_M_N, FittedModes
from hertzloop.fitting.modes.universal_file import Points
from hertzloop.plant.one_thread import on_one_thread

_LAST_LINES = 30_000  # lines of the last fit, whose accuracy goes with the root of their number
_LAST_GAIN = 1e-6  # least relative gain of a step of the last fit


@on_one_thread
def modes_of_responses(
    responses: FrequencyResponses,
    held: FrequencyResponses | None,
    points: Points,
    on_round: ModesCallback,
) -> MeasuredModes:
    """Return the modes of frequency responses within their band.

    Args:
        responses: the responses that are fitted.
        held: a measurement that is predicted; None to hold out every fifth line.
        points: nodes of contact, actuator and sensor.
        on_round: is called with what is held out, the number of modes and the error.
    """
    lines = responses.thinned()
    out = np.zeros(len(lines.hz), bool)
    out[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY] = held is None
    fitted, judged = lines.at(~out), held or lines.at(out)

    def error(modes: FittedModes) -> float:
        left = (modes.response(judged.observed()) - judged.values) * judged.weights
        return float(np.sqrt(np.mean(np.abs(left) ** 2)))

    name = "lines held out" if held is None else "held-out measurement"
    modes = identify_modes(
        fitted.observed(), error, fitted.start(), on_round=partial(on_round, name)
    )
    modes = _fit_all_lines(responses, modes)
    inside = modes.omega_rad_s <= 2.0 * np.pi * responses.hz[-1]
    drive, residual_m_n, rest = responses.drive, None, np.zeros_like(modes.rest)
    notes: tuple[str, ...] = ()
    if drive is None:
        notes = (NO_DRIVE_POINT,)
    elif points.contact == responses.reference:
        above = modes.residues[drive, ~inside] / modes.omega_rad_s[~inside] ** 2
        residual_m_n = max(0.0, float(modes.rest[drive, 0] * FLEXIBILITY_M_N + np.sum(above)))
        rest[drive, 0] = residual_m_n / FLEXIBILITY_M_N
    kept = replace(
        modes,
        omega_rad_s=modes.omega_rad_s[inside],
        loss_factor=modes.loss_factor[inside],
        residues=modes.residues[:, inside],
        rest=rest,
    )
    at_force, shapes = scaled_shapes(kept.residues, drive)

    def shape_at(node: int | None) -> np.ndarray:
        node = points.contact if node is None else node
        return shapes[responses.nodes.index(node)] if node in responses.nodes else at_force

    table = mode_table(
        kept,
        shape_at(points.contact),
        shape_at(points.actuator),
        None if points.sensor is None else shape_at(points.sensor),
        residual_m_n,
    )
    modelled = kept.response(judged.observed())
    checks = [
        check_prediction(f"node {node}, {name}", kept, judged.hz, measured, model)
        for node, measured, model in zip(judged.nodes, judged.values, modelled, strict=True)
    ]
    return MeasuredModes(table, tuple(checks), notes)


def _fit_all_lines(responses: FrequencyResponses, modes: FittedModes) -> FittedModes:
    """Return the modes refined on the lines that are fitted and held out, then on more lines."""
    observed = responses.thinned().observed()
    modes = remove_weak_modes(
        observed, refine_modes(observed, modes.omega_rad_s, modes.loss_factor)
    )
    observed = responses.thinned(_LAST_LINES).observed()
    return refine_modes(observed, modes.omega_rad_s, modes.loss_factor, gain=_LAST_GAIN)
