"""Frequencies of damped oscillators."""

import math

import numpy as np

RIGID_RAD_S = 1e-9  # after 20 s the displacement is wrong by 7e-17


def damped_frequency(
    omega: np.ndarray, eta: float | np.ndarray
) -> tuple[np.ndarray, float | np.ndarray]:
    """Theta of every oscillator (rad/s), and delta/Theta: one number, or one for every oscillator.

    A rigid body's mode takes a frequency so low that within any run it turns by less than
    rounding can show.
    """
    omega = np.maximum(omega, RIGID_RAD_S)
    if isinstance(eta, np.ndarray):
        root = np.sqrt(1.0 - eta * eta / 4.0)
        return omega * root, (eta / 2.0) / root
    one_root = math.sqrt(1.0 - eta * eta / 4.0)
    return omega * one_root, (eta / 2.0) / one_root
