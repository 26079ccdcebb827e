"""The time series of a plant: one row a step, with the columns of `TRUTH`."""

from hertzloop.common.jit import kernel
from hertzloop.plant import state_kernels
from hertzloop.plant.schemes import registry as scheme

# Columns by the names of the fields of the message `TruthBlock`: unit, meaning. Positions and
# velocity are values at the start of the step, forces are means over it.
TRUTH = {
    "xi_m": ("m", "gap: sphere's lowest point minus plate surface"),
    "xi_s_m": ("m", "sphere's lowest point"),
    "xi_p_m": ("m", "plate at the contact point"),
    "v_p_m_s": ("m/s", "plate velocity at the contact point at the start of the step"),
    "f_c_n": ("N", "contact force, mean of the step, up on the sphere"),
    "f_a_n": ("N", "actuator force, mean of the step, up on the plate"),
    "xi_a_m": ("m", "plate at the actuator"),
    "f_c1_n": ("N", "slope of the contact force over the step: f_c + f_c1 (2 t/h - 1)"),
    "f_a1_n": ("N", "slope of the actuator force over the step: f_a + f_a1 (2 t/h - 1)"),
    "deepest_m": ("m", "deepest penetration so far, at least that of first yield"),
}
COLUMNS = len(TRUTH)
# Indices of the columns, in the order of TRUTH.
XI, XI_S, XI_P, V_P, F_C, F_A, XI_A, F_C1, F_A1, DEEPEST = range(COLUMNS)


@kernel(copied=True)
def record_step(plant, plant_state, command, truth, row):
    """One plant step under a commanded force; writes its row of the time series."""
    body = plant_state.body
    truth[XI, row] = body[state_kernels.XI]
    truth[XI_S, row] = body[state_kernels.XI_S]
    truth[XI_P, row] = body[state_kernels.XI_P]
    truth[XI_A, row] = body[state_kernels.XI_A]
    truth[DEEPEST, row] = body[state_kernels.DEEPEST]
    truth[F_C, row] = scheme.step(plant, plant_state, command)
    truth[V_P, row] = body[state_kernels.V_P_OF_STEP]
    truth[F_A, row] = body[state_kernels.F_A]
    truth[F_C1, row] = body[state_kernels.F_C1]
    truth[F_A1, row] = body[state_kernels.F_A1]
