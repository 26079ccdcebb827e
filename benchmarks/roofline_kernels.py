"""Compiled loops for the roofline of the default scheme's step: the peaks, and its parts alone."""

from hertzloop.common.jit import kernel
from hertzloop.plant.schemes import collocation_kernels as modes
from hertzloop.plant.schemes.registry import step

MULTIPLY_ADDS = 8  # per number and round of `multiply_adds`


@kernel(fastmath={"contract"})
def multiply_adds(numbers, rounds):
    """MULTIPLY_ADDS in a chain on every number of a small array; chains overlap."""
    for _ in range(rounds):
        for i in range(numbers.size):
            y = numbers[i]
            y = 0.7 * y + 0.3
            y = 0.6 * y + 0.4
            y = 0.5 * y + 0.5
            y = 0.4 * y + 0.6
            y = 0.7 * y + 0.2
            y = 0.6 * y + 0.3
            y = 0.5 * y + 0.4
            numbers[i] = 0.4 * y + 0.5


@kernel(fastmath={"reassoc"})
def _sum(numbers):
    """Two sums, so that additions do not wait for each other."""
    half = numbers.size // 2
    one = 0.0
    other = 0.0
    for i in range(half):
        one += numbers[i]
        other += numbers[half + i]
    return one + other


@kernel
def loads(table, losses, z, rounds):
    """Read what a pass reads, flat, where it lies."""
    most = 0.0
    for _ in range(rounds):
        most = max(most, _sum(z) + _sum(table))
        if losses.size > 0:
            most = max(most, _sum(z) + _sum(losses))
    return most


@kernel
def drifts(model, z, rounds):
    """The pass of a step without force, alone."""
    total = 0.0
    for _ in range(rounds):
        x, v = modes.drift(z.shape[1], z, model.table, model.rho)
        total += x + v
    return total


@kernel
def pushes(model, z, f0, f1, booked, rounds):
    """The pass of a step with force, alone; with the loss of the step if `booked`."""
    total = 0.0
    n = z.shape[1]
    for _ in range(rounds):
        if booked:
            total += modes.dissipated_with_modes(n, z, model.table, f0, f1)
        x, v, swing = modes.propagate_same_point(0, n, z, model.table, model.rho, f0, f1)
        total += x + v + swing
    return total


@kernel
def repeated_steps(model, state, kept, count, rounds):
    """`count` steps from the same state `kept`, again and again."""
    for _ in range(rounds):
        for i in range(state.z.shape[1]):
            state.z[0, i] = kept.z[0, i]
            state.z[1, i] = kept.z[1, i]
        for i in range(state.body.size):
            state.body[i] = kept.body[i]
        for i in range(state.counts.size):
            state.counts[i] = kept.counts[i]
        for _ in range(count):
            step(model, state, 0.0)
