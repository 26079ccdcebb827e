"""What the state of every scheme holds, by index, and the loss of a mode in free vibration."""

from jit import kernel

# Indices into a state's body (m, m/s, N).
# V_P: plate velocity at the end of the last step, before the forces of the next one act; A_P: mean
# acceleration over the last step, the change of V_P by its length.
# V_P_OF_STEP: plate velocity at the start of the last step, as a scheme knows it once that
# step's forces are known.
# F_C1: slope of the contact force over the last step, F_C + F_C1 (2 t/h - 1); F_A1: of F_A.
# ACTUATOR_F, ACTUATOR_RATE: force of an actuator of second order and its rate over w, N.
XI, XI_S, XI_P, V_P, A_P, F_C, F_A, XI_A, FLIGHT_X, FLIGHT_V, V_P_OF_STEP, F_C1 = range(12)
# DEEPEST: penetration so far of a contact that yields, REACHED: in this step; CURVE (N/m^1.5)
# and DENT: see plant.contact.plastic_solve_kernels.
# TAIL: state of the modes left out (m), see plant.schemes.tail_kernels.
F_A1, ACTUATOR_F, ACTUATOR_RATE, DEEPEST, REACHED, CURVE, DENT, TAIL_RE, TAIL_IM = range(12, 21)
BODY_SIZE = 21
# Indices into a state's books (J, N s).
# AIR: the part of MODAL_DISSIPATED that is radiated.
MODAL_DISSIPATED, CONTACT_DISSIPATED, INJECTED, CONTACT_IMPULSE, PLASTIC_DISSIPATED, AIR = range(6)
TAIL_DISSIPATED = 6
BOOKS_SIZE = 7
# Indices into a state's counts.
STEP, FLIGHT_STEP, NEWTON_TOTAL, NEWTON_MAX, CONTACT_STEPS, FREE_SINCE, ROWS = range(7)
COUNTS_SIZE = 7

# In flight a row of oscillators below this (m) is set to zero and left out: far below
# anything a double can show, and it avoids denormal numbers, which are 50 times slower.
SILENT_M = 1e-60
LOOK_EVERY = 64  # steps


@kernel
def dissipation(theta, rho, duration, yr, yi, er, ei):
    """2 * integral of 2 delta v^2 over `duration`, v = Theta Re((1 + i rho) y exp(s t)).

    y is z minus its rest position at the start, (er, ei) = exp(s duration). Times modal
    mass/2: joules.
    """
    delta = rho * theta
    norm = er * er + ei * ei
    cr = yr - rho * yi
    ci = yi + rho * yr
    # v^2 = Theta^2/2 (|c|^2 exp(-2 delta t) + Re(c^2 exp(2 s t)))
    steady = (cr * cr + ci * ci) * (1.0 - norm)
    # integral of exp(2 s t) = (e^2 - 1)/(2 s), s = -delta + i theta
    nr = er * er - ei * ei - 1.0
    ni = 2.0 * er * ei
    mod = 2.0 * (delta * delta + theta * theta)
    ir = (-nr * delta + ni * theta) / mod
    ii = (-ni * delta - nr * theta) / mod
    qr = cr * cr - ci * ci
    qi = 2.0 * cr * ci
    return theta * theta * (steady + 2.0 * delta * (qr * ir - qi * ii))
