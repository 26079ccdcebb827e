"""Known modes, and their response."""

import numpy as np

from hertzloop.plant.structures.mode_file import ModeTable

HZ, LOSS = np.array([180.0, 433.0, 790.0, 1210.0]), np.array([4e-3, 3e-3, 1e-2, 6e-3])
CONTACT, OTHER = np.array([1.2, 0.8, 1.5, 0.9]), np.array([-0.4, 0.9, 0.3, -1.1])
FLEXIBILITY = 2e-7
KNOWN = ModeTable(2 * np.pi * HZ, LOSS, np.ones(4), CONTACT, OTHER, FLEXIBILITY)


def silent(name: str, modes: int, error: float) -> None:
    pass


def response(table: ModeTable, hz: np.ndarray, shape: np.ndarray, order: int) -> np.ndarray:
    """Response at a point to a force at the contact point, from the definition of the modes."""
    w = 2 * np.pi * hz
    found = np.zeros(len(hz), complex)
    parts = (
        table.omega_rad_s,
        table.loss_factor + 0 * table.omega_rad_s,
        table.shape_contact,
        shape,
        table.per_modal_mass_1_kg,
    )
    for omega, loss, contact, there, per_mass in zip(*parts, strict=True):
        found += contact * there * per_mass / (omega**2 - w**2 + 1j * loss * omega * w)
    if shape is table.shape_contact:
        found += table.residual_flexibility_m_n or 0.0
    return found * (1j * w) ** order


def near(table: ModeTable, hz: float) -> int:
    return int(np.argmin(np.abs(table.omega_rad_s / (2 * np.pi) - hz)))
