"""Compiled kernels of the default scheme `modal`: one step of sphere, contact and structure.

The structure is `plant.structures.linear.Linear`: its poles are propagated exactly under forces
that are linear over a step, F(t) = F_0 + F_1 P(t), P = 2 t/h - 1. The contact force is the
projection of the contact law on such functions, so the scheme has order 4, and it conserves
energy (`plant.contact.contact_kernels`).

Step k runs from time k h to (k+1) h. The contact force F_c > 0 pushes the sphere up and the
structure down, the actuator force F_a > 0 pushes the structure up. Force 0 acts at the contact; the
actuator's is the last one, the same if it acts there too. Point 0 is the contact. Nothing here
allocates.

A step goes: the poles under the forces of the step before, the actuator force, the sphere in
flight, the gap without contact, the contact force if there is one, the works, what can be seen.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.plant import actuator_kernels as act
from hertzloop.plant import state_kernels
from hertzloop.plant.actuator_kernels import ActuatorModel
from hertzloop.plant.contact import contact_kernels
from hertzloop.plant.contact.contact_kernels import ContactModel, GapPath
from hertzloop.plant.lanes import LANES, add, fma, load, mul, neg, splat, store, total
from hertzloop.plant.state_kernels import (
    AWAKE,
    DEEPEST,
    F_A,
    F_A1,
    F_C,
    F_C1,
    FALLBACKS,
    INJECTED,
    MODAL_DISSIPATED,
    NEWTON_MAX,
    NEWTON_TOTAL,
    PLASTIC_DISSIPATED,
    PRUNE_EVERY,
    SENSOR_A,
    SENSOR_V,
    SILENT_POLE,
    STEP,
    XI_A,
)
from hertzloop.plant.structures.linear import IM, MEAN, RE, Linear, V, X

CONTACT = 0  # force and point of the contact
# Further indices into the state's body: work done on the contact and the residual in series (J);
# what the actuator lifts the contact point by through that residual, R F_a, at the end of the last
# step (m).
CONTACT_WORK, RAISED = range(state_kernels.BODY_SIZE, state_kernels.BODY_SIZE + 2)
BODY_SIZE = state_kernels.BODY_SIZE + 2
# Further index into the state's balance: work of all forces on the structure, J.
WORK = state_kernels.BALANCE_SIZE
BALANCE_SIZE = state_kernels.BALANCE_SIZE + 1


class ModalState(NamedTuple):
    """What changes.

    `z`: of the poles, without the forces of the last step, (2, n); `force`: F_0 and F_1 of that
    step, which wait there, (forces, 2): at the present time the poles are z + sum drive force. A
    step makes z <- e^(s h) (z + sum drive force). `seen`: displacement and velocity of every point
    at its end, without what follows a force at once, (points, 2); `before`: the same at its start;
    scalars by the indices of `hertzloop.plant.state_kernels`.
    """

    z: np.ndarray
    force: np.ndarray
    seen: np.ndarray
    before: np.ndarray
    body: np.ndarray
    balance: np.ndarray
    counts: np.ndarray


class ModalModel(NamedTuple):
    """What does not change during a run.

    `by_0`, `by_1`: change of the gap by a unit F_0 and F_1 of the contact force. `raised_by_m_n`:
    the residual R of the modes left out where the actuator acts at the contact, else 0.
    """

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    linear: Linear
    contact: ContactModel
    by_0: GapPath
    by_1: GapPath
    actuator: ActuatorModel
    actuator_force: int
    actuator_point: int
    sensor_point: int
    raised_by_m_n: float
    damped: bool


@kernel(copied=True)
def drive(linear, z, awake, force, f0, f1):
    """Let F_0 and F_1 of a force act on the poles: z <- z + drive_0 F_0 + drive_1 F_1."""
    by_re, by_im = linear.drive[force, :, RE], linear.drive[force, :, IM]
    a, b = splat(f0), splat(f1)
    for k in range(0, awake, LANES):
        store(z[RE], k, fma(load(by_re[1], k), b, fma(load(by_re[0], k), a, load(z[RE], k))))
        store(z[IM], k, fma(load(by_im[1], k), b, fma(load(by_im[0], k), a, load(z[IM], k))))


@kernel(copied=True)
def rotate(linear, z, awake):
    """Rotate the poles by a step, z <- e^(s h) z. Returns displacement (m), the sum of Im z, and
    velocity (m/s) of the contact point."""
    v_by = linear.see[CONTACT, V]
    x = v_re = v_im = splat(0.0)  # sums that wait for each other take longer
    for k in range(0, awake, LANES):
        a, b = load(z[RE], k), load(z[IM], k)
        cos, sin = load(linear.turn[RE], k), load(linear.turn[IM], k)
        re, im = fma(neg(sin), b, mul(cos, a)), fma(sin, a, mul(cos, b))
        store(z[RE], k, re)
        store(z[IM], k, im)
        x = add(x, im)
        v_re = fma(load(v_by[RE], k), re, v_re)
        v_im = fma(load(v_by[IM], k), im, v_im)
    return total(x), total(add(v_re, v_im))


@kernel(part=True)
def look(by, z, awake):
    """What factors of Re z and Im z, (2, n), make of the poles."""
    of_re = of_im = splat(0.0)
    for k in range(0, awake, LANES):
        of_re = fma(load(by[RE], k), load(z[RE], k), of_re)
        of_im = fma(load(by[IM], k), load(z[IM], k), of_im)
    return total(add(of_re, of_im))


@kernel(copied=True)
def prune(state):
    """How many poles have to be propagated: all after a force, else those that have not died away.

    Those of high frequency that have are set to zero from time to time, else they decay into
    denormal numbers, which are slow.
    """
    z, counts = state.z, state.counts
    for force in range(state.force.shape[0]):
        if state.force[force, 0] != 0.0 or state.force[force, 1] != 0.0:
            counts[AWAKE] = z.shape[1]
            return counts[AWAKE]
    if counts[STEP] % PRUNE_EVERY == 0:
        n = counts[AWAKE]
        while n > 0 and abs(z[RE, n - 1]) + abs(z[IM, n - 1]) <= SILENT_POLE:
            n -= 1
            z[RE, n] = 0.0
            z[IM, n] = 0.0
        counts[AWAKE] = (n + LANES - 1) // LANES * LANES
    return counts[AWAKE]


@kernel(copied=True)
def propagate(linear, state):
    """Propagate the poles by a step under the forces of the last one; what is seen at its end."""
    z, seen = state.z, state.seen
    awake = prune(state)
    for point in range(seen.shape[0]):
        state.before[point, X] = seen[point, X]
        state.before[point, V] = seen[point, V]
    for force in range(state.force.shape[0]):
        f0, f1 = state.force[force, 0], state.force[force, 1]
        if f0 != 0.0 or f1 != 0.0:
            drive(linear, z, awake, force, f0, f1)
            state.force[force, 0] = state.force[force, 1] = 0.0
    seen[CONTACT, X], seen[CONTACT, V] = rotate(linear, z, awake)
    for point in range(1, seen.shape[0]):
        seen[point, X] = look(linear.see[point, X], z, awake)
        seen[point, V] = look(linear.see[point, V], z, awake)
    return awake


@kernel(part=True)
def push_structure(linear, state, force, f0, f1):
    """Let F_0 and F_1 (N) of a force act in this step: add what they do to every point."""
    state.force[force, 0] += f0
    state.force[force, 1] += f1
    for point in range(state.seen.shape[0]):
        for what in (X, V):
            gain = linear.gain[point, what, force]
            state.seen[point, what] += gain[0] * f0 + gain[1] * f1


@kernel(part=True)
def mean_under(linear, state, point, mean):
    """Mean displacement of a point over the step under the forces of it so far, m, from that
    without them."""
    for force in range(state.force.shape[0]):
        gain = linear.gain[point, MEAN, force]
        mean += gain[0] * state.force[force, 0] + gain[1] * state.force[force, 1]
    return mean


@kernel(copied=True)
def work_of(state, point, mean, f0, f1):
    """Work of F_0 + F_1 P up on a point that moves by its `mean`, J."""
    begin, end = state.before[point, X], state.seen[point, X]
    return f0 * (end - begin) + f1 * (end + begin - 2.0 * mean)


@kernel(part=True)
def book_contact_at(model, state, gap, guess):
    """Write the work done on the contact and its deepest penetration at a modal gap. Returns its
    force F (N) and dF/dp (N/m), without damping; `guess`: a force nearby (N)."""
    body, curve = state.body, unloading_now(model, state.body)
    if gap >= -curve.dent:
        guess = 0.0
    force, slope, body[CONTACT_WORK], p = contact_kernels.in_series(
        model.contact, gap, curve, guess
    )
    deepen(model, state, p)
    return force, slope


@kernel(part=True)
def deepen(model, state, p):
    """Note a penetration (m), if none was deeper and the contact yields; book what that takes."""
    if p > model.contact.yield_m and p > state.body[DEEPEST]:
        state.body[DEEPEST] = p
        state.balance[PLASTIC_DISSIPATED] = contact_kernels.unloading(model.contact, p).lost


@kernel(part=True)
def unloading_now(model, body):
    """The curve from the deepest penetration so far."""
    return contact_kernels.unloading(model.contact, body[DEEPEST])


@kernel(copied=True)
def gap_without_contact(model, state, sphere, raised_0, raised_1, f_a, f_a1):
    """The modal gap over the step without a contact force, but for its mean; `sphere`: heights and
    velocities at both ends."""
    h = model.step_s
    sphere_0, sphere_v0, sphere_1, sphere_v1 = sphere
    mobility = model.linear.direct[CONTACT, model.actuator_force]
    plate_v0, plate_v1 = state.before[CONTACT, V], state.seen[CONTACT, V]
    raised = raised_1 - raised_0
    return GapPath(
        sphere_0 - state.before[CONTACT, X] - raised_0,
        sphere_1 - state.seen[CONTACT, X] - raised_1,
        h * (sphere_v0 - plate_v0 - mobility * (f_a - f_a1)) - raised,
        h * (sphere_v1 - plate_v1 - mobility * (f_a + f_a1)) - raised,
        0.0,
    )


@kernel(copied=True)
def touches(free, touch_m):
    """Whether the contact can have a force in the step, from the gap without it; `touch_m`: the
    gap at which contact begins."""
    return free.start < touch_m or free.end < touch_m or free.slope_0 < 0.0 < free.slope_1


@kernel(copied=True)
def contact_force(model, state, free, curve):
    """Contact force of the step, F_0 and F_1 (N), and what damping takes (J)."""
    body, counts = state.body, state.counts
    # To begin with, no jump between steps.
    guess_1 = body[F_C1]
    f0, f1, lost, reached, rounds, done = contact_kernels.solve_contact(
        model.contact,
        free,
        model.by_0,
        model.by_1,
        body[CONTACT_WORK],
        curve,
        body[F_C] + 2.0 * guess_1,
        guess_1,
        model.step_s,
    )
    deepen(model, state, reached)
    counts[NEWTON_TOTAL] += rounds
    counts[NEWTON_MAX] = max(counts[NEWTON_MAX], rounds)
    if not done:
        counts[FALLBACKS] += 1
    return f0, f1, lost


@kernel(copied=True)
def plate_speed(model, state, sphere_v, raised, force, slope):
    """Velocity of the contact point at the end of the step, m/s, under a contact force F = `force`
    (N) there, damping left out, with `slope` = dF/dp (N/m); `raised`: change of R F_a over the step
    (m).

    With a mobility Y = `direct` and a damper D: u <- (u + Y (D v_s - F))/(1 + Y D). With a residual
    R in series, which excludes Y: v_p = u + R dF/dp/(1 + R dF/dp) (v_s - u).
    """
    contact, linear, residual = model.contact, model.linear, model.contact.residual_m_n
    actuator = model.actuator_force
    damper = 0.0
    if force > 0.0:
        damper = contact.viscous_n_s_m + contact.hunt_crossley_s_m * force
    speed = state.seen[CONTACT, V] + raised / model.step_s
    speed += linear.direct[CONTACT, actuator] * (state.body[F_A] + state.body[F_A1])
    mobility = linear.direct[CONTACT, CONTACT]
    speed = (speed + mobility * (damper * sphere_v - force)) / (1.0 + mobility * damper)
    return speed + residual * slope / (1.0 + residual * slope) * (sphere_v - speed)


@kernel(copied=True)
def observe(model, state, sphere, raised, plate_v, force):
    """Write what can be seen at the end of the step: gap, plate and sensor. The contact force
    `force` (N) bends the residual, and the actuator raises the contact point by `raised` (m)."""
    body, at = state.body, model.actuator_point
    plate = state.seen[CONTACT, X] + raised - model.contact.residual_m_n * force
    state_kernels.note_contact_point(body, model.step_s, sphere, plate, plate_v)
    body[XI_A] = plate if at == CONTACT else state.seen[at, X]
    seen = state.seen[model.sensor_point, V]
    body[SENSOR_A] = (seen - body[SENSOR_V]) / model.step_s
    body[SENSOR_V] = seen


@kernel(part=True)
def step(model, state, command):
    """Advance one step under a commanded actuator force (N); returns the mean contact force (N)."""
    linear, body, balance, counts = model.linear, state.body, state.balance, state.counts
    f_a, f_a1 = act.force(model.actuator, body, command)
    awake = propagate(linear, state)
    push_structure(linear, state, model.actuator_force, f_a, f_a1)
    sphere = state_kernels.flight(model, body, counts)

    raised_0 = model.raised_by_m_n * (f_a - f_a1)
    raised_1 = model.raised_by_m_n * (f_a + f_a1)
    free = gap_without_contact(model, state, sphere, raised_0, raised_1, f_a, f_a1)
    # The actuator's force jumps: it bends the residual, and works on it and on the contact.
    if raised_0 != body[RAISED]:
        before = body[CONTACT_WORK]
        book_contact_at(model, state, free.start, body[F_C] + body[F_C1])
        balance[INJECTED] += body[CONTACT_WORK] - before
    body[RAISED] = raised_1

    f_c = f_c1 = lost = unforced = 0.0
    height_0, sphere_v0, height, sphere_v = sphere
    curve = unloading_now(model, body)
    if touches(free, -curve.dent):
        fall = model.gravity_m_s2 * model.step_s * model.step_s
        mean_gap = height_0 + 0.5 * model.step_s * sphere_v0 - fall / 6.0
        unforced = look(linear.see[CONTACT, MEAN], state.z, awake)
        mean_gap -= mean_under(linear, state, CONTACT, unforced) + 0.5 * (raised_0 + raised_1)
        free = GapPath(free.start, free.end, free.slope_0, free.slope_1, mean_gap)
        f_c, f_c1, lost = contact_force(model, state, free, curve)
    if f_c != 0.0 or f_c1 != 0.0:
        push_structure(linear, state, CONTACT, -f_c, -f_c1)
        height, sphere_v = state_kernels.push_sphere(
            model, state, height, sphere_v, f_c, f_c1, lost
        )
        mean = mean_under(linear, state, CONTACT, unforced)
        balance[WORK] += work_of(state, CONTACT, mean, -f_c, -f_c1)
    if f_a != 0.0 or f_a1 != 0.0:
        at = model.actuator_point
        mean = 0.0
        if f_a1 != 0.0:
            unforced = look(linear.see[at, MEAN], state.z, awake)
            mean = mean_under(linear, state, at, unforced)
        work = work_of(state, at, mean, f_a, f_a1)
        balance[WORK] += work
        # Over u = R (F_a - F_c) the actuator works R F_a^2/2 - R F_a F_c, which is a state and left
        # out, and the integral of R F_c dF_a.
        balance[INJECTED] += work + (raised_1 - raised_0) * f_c
    gap = height - state.seen[CONTACT, X] - raised_1
    force, slope = book_contact_at(model, state, gap, f_c + f_c1)
    body[F_C] = f_c
    body[F_C1] = f_c1
    body[F_A] = f_a
    body[F_A1] = f_a1
    plate_v = plate_speed(model, state, sphere_v, raised_1 - raised_0, force, slope)
    observe(model, state, height, raised_1, plate_v, force)
    counts[STEP] += 1
    return f_c


@kernel(part=True)
def modal_energy(drive, energy, z, forces):
    """Kinetic and elastic energy of the structure at the present step, J, under the forces of the
    last one."""
    kept = 0.0
    for n in range(z.shape[1]):
        re, im = z[RE, n], z[IM, n]
        for force in range(forces.shape[0]):
            f0, f1 = forces[force, 0], forces[force, 1]
            re += drive[force, 0, RE, n] * f0 + drive[force, 1, RE, n] * f1
            im += drive[force, 0, IM, n] * f0 + drive[force, 1, IM, n] * f1
        kept += energy[0, n] * re * re + energy[1, n] * re * im + energy[2, n] * im * im
    return kept


@kernel
def close_balance(model, state):
    """Book what the structure has lost until the present step: the work done on it, less what it
    keeps. Returns the `modal_energy` then, J."""
    linear = model.linear
    kept = modal_energy(linear.drive, linear.energy, state.z, state.force)
    if model.damped:  # else the difference is an error, which the energy residual shows
        state.balance[MODAL_DISSIPATED] = state.balance[WORK] - kept
    return kept


@kernel(part=True)
def contact_energy(model, state):
    """Energy stored in the contact and the residual of the modes left out, J."""
    return state.body[CONTACT_WORK] - state.balance[PLASTIC_DISSIPATED]
