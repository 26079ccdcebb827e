"""Compiled kernels of the sphere in a step of order four: its flight, and a contact's push."""

import math

from jit import kernel
from plant.schemes import state_kernels as pk


@kernel(inline=True, borrowed=True)
def flight(model, body, counts):
    """Height (m) and velocity (m/s) at the start and, free of contact, at the end of the step;
    ballistic since FLIGHT_STEP."""
    h, gravity = model.step_s, model.gravity_m_s2
    t = (counts[pk.STEP] + 1 - counts[pk.FLIGHT_STEP]) * h
    sphere = body[pk.FLIGHT_X] + t * (body[pk.FLIGHT_V] - 0.5 * gravity * t)
    sphere_v = body[pk.FLIGHT_V] - gravity * t
    t0 = t - h
    sphere_0 = body[pk.FLIGHT_X] + t0 * (body[pk.FLIGHT_V] - 0.5 * gravity * t0)
    return sphere_0, sphere_v + gravity * h, sphere, sphere_v


@kernel(inline=True, borrowed=True)
def push(model, state, sphere, sphere_v, f_c, f_c1, lost):
    """Let the contact force F_0 + F_1 (2 t/h - 1) of the step act, of which damping takes `lost`
    (J): the height and velocity at its end, from where flight goes on, and the books."""
    body, counts, h = state.body, state.counts, model.step_s
    sphere += h * h / model.mass_kg * (0.5 * f_c - f_c1 / 6.0)
    sphere_v += h / model.mass_kg * f_c
    body[pk.FLIGHT_X] = sphere
    body[pk.FLIGHT_V] = sphere_v
    counts[pk.FLIGHT_STEP] = counts[pk.STEP] + 1
    counts[pk.CONTACT_STEPS] += 1
    state.books[pk.CONTACT_IMPULSE] += f_c * h
    state.books[pk.CONTACT_DISSIPATED] += lost
    return sphere, sphere_v


@kernel
def released(speed, gravity, lead_s, step_s, touch_phase):
    """Height (m) and velocity (m/s, up) of a sphere `lead_s` before it hits a plate at rest at
    `speed`, or at its release, if that is later; see plant.plant.PlantSpec for the touch phase."""
    fall_s = speed / gravity
    lead = lead_s
    if lead > 0.0:
        lead = min((math.floor(lead / step_s) + touch_phase) * step_s, fall_s)
    # Going back in time from the impact: height v t - g t^2/2, speed -(v - g t).
    return lead * (speed - 0.5 * gravity * lead), gravity * lead - speed


@kernel
def speed_now(gravity, step_s, body, counts):
    """Velocity of the sphere at the present step, m/s, up positive."""
    flight_s = (counts[pk.STEP] - counts[pk.FLIGHT_STEP]) * step_s
    return body[pk.FLIGHT_V] - gravity * flight_s
