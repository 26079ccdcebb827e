"""The mode of the structure that limits a loop: its indices and its shape."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.structures.modes import NO_PARTICIPATION
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.linear import linear_plant, plant_in_flight

# Relative amplitudes from which a mode takes part, and within which it stands for the response.
_LEAST, _ALONE, _CANCELS = 0.1, 0.7, 1.1
_NAMED = 3  # modes of one frequency
_SAME = 1e-9  # relative difference of frequencies of one mode


@dataclass(frozen=True)
class BindingMode:
    """The mode with the largest amplitude at the frequency that limits the loop.

    Attributes:
        frequency_hz: natural frequency, Hz.
        relative_amplitude: its amplitude over that of the whole response there; more than 1 where
            other modes cancel it.
        number: from 1 on, by rising frequency, among the modes that the plant computes with.
        indices: half-waves along x and y, one pair for each mode of this frequency; None where the
            structure has no such indices.
    """

    frequency_hz: float
    relative_amplitude: float
    number: int
    indices: list[list[int]] | None


def binding_mode(setup: Setup, frequency_hz: float) -> BindingMode | None:
    """Return the mode with the largest amplitude at a frequency; None if that is below a tenth of
    the response. Then the actuator, a filter or the sum of the truncated modes prevails.

    Args:
        setup: the run.
        frequency_hz: the binding frequency, Hz.
    """
    form = plant_in_flight(setup)
    count = len(linear_plant(setup).modes.omega)
    z = np.exp(2j * math.pi * frequency_hz * setup.run.step_s)
    weights = np.abs(form.residues / (z - form.poles))[:count]
    largest = int(np.argmax(weights))
    amplitude = float(weights[largest] / np.abs(form.at(np.array([z]))[0]))
    if amplitude < _LEAST:
        return None
    natural = np.abs(np.log(form.poles[:count])) / setup.run.step_s
    omega = float(natural[largest])
    number = int(np.sum(natural < omega * (1.0 - _SAME))) + 1
    spec = setup.plant
    plate = spec.plate.simply_supported
    if plate is None:
        return BindingMode(omega / (2.0 * math.pi), amplitude, number, None)
    m, n, all_omega = plate.mode_numbers(omega * (1.0 + 10.0 * _SAME))
    same = np.abs(all_omega - omega) <= _SAME * omega
    at_contact = plate.mode_shape(m[same], n[same], spec.contact_point_m)
    at_actuator = plate.mode_shape(m[same], n[same], spec.actuator_point_m)
    moved = np.maximum(np.abs(at_contact), np.abs(at_actuator)) > NO_PARTICIPATION
    return BindingMode(
        omega / (2.0 * math.pi),
        amplitude,
        number,
        np.stack([m[same][moved], n[same][moved]], axis=1).tolist(),
    )


def hertz(frequency_hz: float) -> str:
    """Return a frequency with its unit, in Hz, or in kHz from 10 kHz on."""
    if frequency_hz >= 1e4:
        return f"{1e-3 * frequency_hz:.5g} kHz"
    return f"{frequency_hz:.5g} Hz"


def mode_name(mode: BindingMode) -> str:
    """Return a short name of a mode, as for a label; modes of one frequency are named together."""
    if not mode.indices:
        return f"mode {mode.number}"
    named = ", ".join(f"({m}, {n})" for m, n in mode.indices[:_NAMED])
    more = ", ..." if len(mode.indices) > _NAMED else ""
    return f"mode{'s' if len(mode.indices) > 1 else ''} {named}{more}"


def mode_line(mode: BindingMode | None, frequency_hz: float) -> str:
    """Return a sentence on the binding mode."""
    if mode is None:
        return (
            f"no single mode limits it: at {hertz(frequency_hz)} the sum of the truncated modes, "
            "the actuator or a filter prevails"
        )
    words = f"limited by {mode_name(mode)} at {hertz(mode.frequency_hz)}, no. {mode.number}"
    amplitude = mode.relative_amplitude
    others = ", as other modes overlap with it" if amplitude <= _ALONE else ""
    others = ", as other modes cancel a part of it" if amplitude > _CANCELS else others
    times = f"{amplitude:.2f} times that of the whole response{others}"
    return f"{words}; its amplitude at {hertz(frequency_hz)} is {times}"
