"""Modes of a measurement: their table, their error on data that were held out, and notes."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hertzloop.fitting.modes.response_rows import FittedModes
from hertzloop.plant.structures.mode_file import ModeTable

ModesCallback = Callable[[str, int, float], None]  # name, number of modes, error

NO_DRIVE_POINT = (
    "No response was measured at the contact point itself. Each mode is taken as large there as at "
    "the sensor: the response from contact to sensor is the measured one, but how far the contact "
    "point gives way is not known. Measure there too to know it."
)
_LEAST_SQUARE = 1e-300  # of a shape: a mode at rest at the force would have no finite shape


@dataclass(frozen=True)
class HoldOutCheck:
    """Data that were held out of a fit, and what its modes predict of them.

    Args:
        name: of the data.
        modes: number of modes.
        rms: error, root mean square over root mean square.
        peak: largest error over the largest value.
        x: times after the hit, s, or frequencies, Hz, (rows,).
        measured: response in SI units, (rows,), real or complex.
        modelled: the same of the modes.
    """

    name: str
    modes: int
    rms: float
    peak: float
    x: np.ndarray
    measured: np.ndarray
    modelled: np.ndarray


@dataclass(frozen=True)
class MeasuredModes:
    """Modes of a measurement.

    Args:
        table: the modes as in a mode file.
        held_out: their check.
        notes: sentences on what they miss.
        delay_s: by which the response was late against the force, s; it is corrected.
    """

    table: ModeTable
    held_out: tuple[HoldOutCheck, ...]
    notes: tuple[str, ...]
    delay_s: float = 0.0


def prediction_errors(modelled: np.ndarray, measured: np.ndarray) -> tuple[float, float]:
    """Return the error of a modelled response: rms over rms, and largest over largest."""
    apart = np.abs(modelled - measured)
    rms = math.sqrt(float(np.mean(apart**2) / np.mean(np.abs(measured) ** 2)))
    return rms, float(np.max(apart) / np.max(np.abs(measured)))


def check_prediction(
    name: str, modes: FittedModes, x: np.ndarray, measured: np.ndarray, modelled: np.ndarray
) -> HoldOutCheck:
    """Return the check of a response that modes predict; arguments are those of `HoldOutCheck`."""
    rms, peak = prediction_errors(modelled, measured)
    return HoldOutCheck(name, len(modes.omega_rad_s), rms, peak, x, measured, modelled)


def scaled_shapes(residues: np.ndarray, drive: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Return mass-normalised shapes.

    Args:
        residues: of receptances, 1/kg, (points, modes).
        drive: the point of the force. If it is None, each mode is taken as large at the force as at
            the first point.

    Returns:
        Shapes at the force, (modes,), and at the points, (points, modes), 1/sqrt(kg).
    """
    own = residues[drive] if drive is not None else np.abs(residues[0])
    at_force = np.sqrt(np.maximum(own, _LEAST_SQUARE))
    return at_force, residues / at_force


def mode_table(
    modes: FittedModes,
    contact: np.ndarray,
    actuator: np.ndarray,
    sensor: np.ndarray | None,
    residual_m_n: float | None,
) -> ModeTable:
    """Return modes with mass-normalised shapes at contact, actuator and sensor, (modes,) each, and
    the residual flexibility of the contact point, m/N."""
    return ModeTable(
        modes.omega_rad_s,
        modes.loss_factor,
        np.ones(len(contact)),
        contact,
        actuator,
        residual_m_n,
        shape_sensor=sensor,
    )
