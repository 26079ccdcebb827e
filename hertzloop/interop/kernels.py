"""Compiled kernels of an exported plant: release of the sphere, steps under a command, energies.

A unit is all that they need, put together from the exported library's own memory.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.closed_loop import loop
from hertzloop.closed_loop.exchange import Exchange, Unsent
from hertzloop.closed_loop.loop import PlantSide
from hertzloop.common.jit import kernel
from hertzloop.plant import state_kernels
from hertzloop.plant.schemes import registry as scheme
from hertzloop.plant.state_kernels import (
    CONTACT_DISSIPATED,
    FLIGHT_V,
    FLIGHT_X,
    GRAVITY_M_S2,
    MODAL_DISSIPATED,
    PLASTIC_DISSIPATED,
    XI,
    XI_S,
)

# Indices into a unit's energies (J); RESIDUAL: relative, see plant.balance.balance.
KINETIC, GRAVITY, MODAL, CONTACT, INJECTED, MODAL_LOST = range(6)
CONTACT_LOST, PLASTIC_LOST, RESIDUAL = range(6, 9)
ENERGIES = 9


class Unit(NamedTuple):
    """Plant and sensor, and one row of what they produce; `start`: height (m) and velocity (m/s) of
    the sphere at the start of the run, `lead_s` before the first touch."""

    side: PlantSide
    exchange: Exchange
    unsent: Unsent
    start: np.ndarray
    energies: np.ndarray
    lead_s: float


@kernel
def release(unit, drop_height_m, touch_phase):
    """Put the sphere where it is at the start of a run."""
    model, body = unit.side.plant, unit.side.plant_state.body
    speed = math.sqrt(2.0 * GRAVITY_M_S2 * drop_height_m)
    height, velocity = state_kernels.released(
        speed, model.gravity_m_s2, unit.lead_s, model.step_s, touch_phase
    )
    body[FLIGHT_X] = body[XI] = body[XI_S] = unit.start[0] = height
    body[FLIGHT_V] = unit.start[1] = velocity


@kernel(inline=True)
def advance(unit, command, steps):
    """`steps` steps under one commanded actuator force (N). The sensor sees the first state too,
    once, also with no steps at all."""
    end = unit.side.plant_state.counts[state_kernels.STEP] + max(steps, 0)
    unit.exchange.commands[0] = command
    loop.run(unit.side, unit.exchange, unit.unsent, end)


@kernel
def balance(unit):
    """The energies at the present step. To close the balance changes the state, so the run goes on
    from a copy of the state before."""
    model, state, energies = unit.side.plant, unit.side.plant_state, unit.energies
    balance, mass, gravity = state.balance, model.mass_kg, model.gravity_m_s2
    energies[MODAL] = scheme.close_balance(model, state)
    speed = state_kernels.speed_now(gravity, model.step_s, state.body, state.counts)
    energies[KINETIC] = 0.5 * mass * speed * speed
    energies[GRAVITY] = mass * gravity * state.body[XI_S]
    energies[CONTACT] = scheme.contact_energy(model, state)
    energies[INJECTED] = balance[state_kernels.INJECTED]
    energies[MODAL_LOST] = balance[MODAL_DISSIPATED]
    energies[CONTACT_LOST] = balance[CONTACT_DISSIPATED]
    energies[PLASTIC_LOST] = balance[PLASTIC_DISSIPATED]
    begun = mass * gravity * unit.start[0] + 0.5 * mass * unit.start[1] * unit.start[1]
    gap = energies[KINETIC] + energies[GRAVITY] + energies[MODAL] + energies[CONTACT]
    gap += balance[MODAL_DISSIPATED] + balance[CONTACT_DISSIPATED]
    gap += balance[PLASTIC_DISSIPATED]
    gap -= balance[state_kernels.INJECTED] + begun
    energies[RESIDUAL] = gap / (begun + abs(balance[state_kernels.INJECTED]))
