"""What every scheme shares: its state by index, the sphere in flight."""

import math

from hertzloop.common.jit import kernel

# Indices into a state's body (m, m/s, N).
# V_P: plate velocity at the end of the last step, before the forces of the next one act; A_P: mean
# acceleration over the last step, the change of V_P by its length.
# V_P_OF_STEP: V_P at the start of the last step; `thesis2008` adds what the actuator force of that
# step changes at once.
# XI: gap between sphere and plate; XI_S, XI_P, XI_A: heights of the sphere, of the plate at the
# contact and at the actuator.
# F_C1: half the rise of the contact force over the last step, F_C + F_C1 (2 t/h - 1); F_A1: of F_A.
# ACTUATOR_F, ACTUATOR_RATE: force of an actuator of second order and its rate over w, N.
XI, XI_S, XI_P, V_P, A_P, F_C, F_A, XI_A, FLIGHT_X, FLIGHT_V, V_P_OF_STEP, F_C1 = range(12)
# DEEPEST: penetration so far of a contact that yields, at least that of first yield.
# SENSOR_V, SENSOR_A: of the modes, where a sensor elsewhere is; not for use at the contact.
F_A1, ACTUATOR_F, ACTUATOR_RATE, DEEPEST, SENSOR_V, SENSOR_A = range(12, 18)
BODY_SIZE = 18
# Indices into a state's balance (J, N s).
MODAL_DISSIPATED, CONTACT_DISSIPATED, INJECTED, CONTACT_IMPULSE, PLASTIC_DISSIPATED = range(5)
BALANCE_SIZE = 5
# Indices into a state's counts.
# AWAKE: number of poles, from the slowest on, that have not died away.
# FALLBACKS: contact steps in which Newton or the correction of energy did not end.
STEP, FLIGHT_STEP, NEWTON_TOTAL, NEWTON_MAX, CONTACT_STEPS, AWAKE, FALLBACKS = range(7)
COUNTS_SIZE = 7

# In flight a pole below this (m) is set to zero and left out: far below anything a double can
# show, and it avoids denormal numbers, which are 50 times slower.
SILENT_POLE = 1e-60
PRUNE_EVERY = 64  # steps

GRAVITY_M_S2 = 9.81


@kernel(part=True)
def flight(model, body, counts):
    """Height (m) and velocity (m/s) at the start and, free of contact, at the end of the step;
    ballistic since FLIGHT_STEP."""
    h, gravity = model.step_s, model.gravity_m_s2
    t = (counts[STEP] + 1 - counts[FLIGHT_STEP]) * h
    sphere = body[FLIGHT_X] + t * (body[FLIGHT_V] - 0.5 * gravity * t)
    sphere_v = body[FLIGHT_V] - gravity * t
    t0 = t - h
    sphere_0 = body[FLIGHT_X] + t0 * (body[FLIGHT_V] - 0.5 * gravity * t0)
    return sphere_0, sphere_v + gravity * h, sphere, sphere_v


@kernel(part=True)
def push_sphere(model, state, sphere, sphere_v, f_c, f_c1, lost):
    """Let the contact force F_0 + F_1 (2 t/h - 1) of the step act, of which damping takes `lost`
    (J): the height and velocity at its end, from where flight goes on, with the balance."""
    body, counts, h = state.body, state.counts, model.step_s
    sphere += h * h / model.mass_kg * (0.5 * f_c - f_c1 / 6.0)
    sphere_v += h / model.mass_kg * f_c
    body[FLIGHT_X] = sphere
    body[FLIGHT_V] = sphere_v
    counts[FLIGHT_STEP] = counts[STEP] + 1
    counts[CONTACT_STEPS] += 1
    state.balance[CONTACT_IMPULSE] += f_c * h
    state.balance[CONTACT_DISSIPATED] += lost
    return sphere, sphere_v


@kernel(part=True)
def note_contact_point(body, step_s, sphere, plate, plate_v):
    """Write what can be seen at the contact at the end of the step: heights of sphere and plate
    (m), and the velocity of the plate (m/s)."""
    body[V_P_OF_STEP] = body[V_P]
    body[A_P] = (plate_v - body[V_P]) / step_s
    body[V_P] = plate_v
    body[XI] = sphere - plate
    body[XI_S] = sphere
    body[XI_P] = plate


@kernel
def released(speed, gravity, lead_s, step_s, touch_phase):
    """Height (m) and velocity (m/s, up) of a sphere `lead_s` before it hits a plate at rest at
    `speed`, or at its release, if that is later; see plant.plant.PlantSpec for the touch phase."""
    fall_s = speed / gravity if gravity > 0.0 else math.inf
    lead = lead_s
    if lead > 0.0:
        lead = min((math.floor(lead / step_s) + touch_phase) * step_s, fall_s)
    # Going back in time from the impact: height v t - g t^2/2, speed -(v - g t).
    return lead * (speed - 0.5 * gravity * lead), gravity * lead - speed


@kernel
def speed_now(gravity, step_s, body, counts):
    """Velocity of the sphere at the present step, m/s, up positive."""
    flight_s = (counts[STEP] - counts[FLIGHT_STEP]) * step_s
    return body[FLIGHT_V] - gravity * flight_s
