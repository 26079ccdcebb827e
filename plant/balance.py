"""Energy and momentum of a run, and what is missing from them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from plant import state_kernels as pk
from plant.contact.hertz import GRAVITY_M_S2


@dataclass(frozen=True)
class Balance:
    """Energy (J) and momentum (N s) of a run; residuals are relative, see `balance`.
    `tail_dissipated_j` went to the modes left out, where they are a damped mode."""

    energy_start_j: float
    kinetic_j: float
    gravity_j: float
    modal_j: float
    contact_j: float
    modal_dissipated_j: float
    air_dissipated_j: float
    contact_dissipated_j: float
    injected_j: float
    plastic_dissipated_j: float
    tail_dissipated_j: float
    dent_m: float
    energy_residual: float
    momentum_change_n_s: float
    contact_impulse_n_s: float
    gravity_impulse_n_s: float
    momentum_residual: float
    newton_iterations: int
    newton_iterations_max: int
    contact_steps: int


def balance(
    model: Any,
    state: Any,
    start: np.ndarray,
    speed_m_s: float,
    *,
    modal_j: float,
    contact_j: float,
) -> Balance:
    """Balance of a run that began with the sphere at `start` (m, m/s) and ends at `speed_m_s`.

    The energy residual is relative to the energy at the start plus the size of what the
    actuator exchanged, the momentum residual to the impulses exchanged.
    """
    m, (x0, v0) = model.mass_kg, (float(x) for x in start)
    energy = m * GRAVITY_M_S2 * x0 + 0.5 * m * v0 * v0
    kinetic = 0.5 * m * speed_m_s * speed_m_s
    gravity = m * GRAVITY_M_S2 * float(state.body[pk.XI_S])
    lost_modal, lost_contact, injected, impulse, yielded, air, lost_tail = (
        float(b) for b in state.balance
    )
    gap = kinetic + gravity + modal_j + contact_j + lost_modal + lost_contact + yielded
    gap = gap + lost_tail - injected - energy
    change = m * (speed_m_s - v0)
    weight = -m * GRAVITY_M_S2 * float(state.counts[pk.STEP]) * model.step_s
    return Balance(
        energy_start_j=energy,
        kinetic_j=kinetic,
        gravity_j=gravity,
        modal_j=modal_j,
        contact_j=contact_j,
        modal_dissipated_j=lost_modal - air,
        air_dissipated_j=air,
        contact_dissipated_j=lost_contact,
        injected_j=injected,
        plastic_dissipated_j=yielded,
        tail_dissipated_j=lost_tail,
        dent_m=float(state.body[pk.DENT]),
        energy_residual=gap / (energy + abs(injected)),
        momentum_change_n_s=change,
        contact_impulse_n_s=impulse,
        gravity_impulse_n_s=weight,
        momentum_residual=(change - impulse - weight) / (abs(impulse) + abs(weight) + m * abs(v0)),
        newton_iterations=int(state.counts[pk.NEWTON_TOTAL]),
        newton_iterations_max=int(state.counts[pk.NEWTON_MAX]),
        contact_steps=int(state.counts[pk.CONTACT_STEPS]),
    )
