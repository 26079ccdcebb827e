"""Compiled loops that studies measure or compare with."""

from jit import kernel
from plant.schemes.registry import step
from plant.state_kernels import XI
from studies.speed_accuracy.integrator_kernels import slope


@kernel(borrowed=True)
def plant_steps(model, state, f_a, count):
    """`count` plant steps under the same actuator force."""
    for _ in range(count):
        step(model, state, f_a)


@kernel
def two_pass_steps(z, turn, grown, count):
    """The obvious loop, as a yardstick: predict with one pass over all oscillators, then
    apply the force with a second one. Arrays are complex, shape (frequencies,)."""
    x = 0.0
    for _ in range(count):
        x = 0.0
        for i in range(z.size):
            z[i] *= turn[i]
            x += z[i].imag
        force = 1.0 - x
        for i in range(z.size):
            z[i] += grown[i] * force
    return x


@kernel(borrowed=True)
def plant_gaps(model, state, every, gaps):
    """Step without control; the gap after every `every` steps."""
    for i in range(gaps.size):
        for _ in range(every):
            step(model, state, 0.0)
        gaps[i] = state.body[XI]


@kernel
def many_slopes(y, omega2, drive, stiffness, mass, count):
    """The right-hand side of the modal equations, `count` times."""
    total = 0.0
    for i in range(count):
        total += slope(0.0, y, omega2, drive, stiffness, mass + 1e-9 * i)[0]
    return total
