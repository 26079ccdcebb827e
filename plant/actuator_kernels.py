"""Compiled kernels of the actuator between a commanded force and the plate.

A command is held over a step. An actuator of second order answers it with
F'' + 2 zeta w F' + w^2 F = w^2 c, which is propagated exactly; what the plate gets is the
projection of F on linear functions of the step, F_0 + F_1 (2 t/h - 1), as the contact force is.
Then force is limited at both ends of the step.

An actuator is one of these NamedTuples, or None: ideal, every command acts as it is.
"""

from typing import NamedTuple

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import by_type, no, yes
from hertzloop.plant.state_kernels import ACTUATOR_F, ACTUATOR_RATE

# A command beyond this (N) acts as this: a loop that runs away stays finite for as long as it runs.
MOST_N = 1e12
# Below this (N) an actuator without command is at rest: 1e-20 of a newton moves nothing, and a
# number that decays for ever ends in denormal ones, which are slow.
_REST_N = 1e-20


class ForceLimit(NamedTuple):
    """An actuator that follows at once, up to a force (N)."""

    limit_n: float


class SecondOrder(NamedTuple):
    """Coefficients by y = (F - c, F'/w) at the start of a step: y at its end, mean and slope of
    F - c over it; and the largest force, N."""

    turn_ff: float
    turn_fd: float
    turn_df: float
    turn_dd: float
    mean_f: float
    mean_d: float
    slope_f: float
    slope_d: float
    limit_n: float


@kernel(inline=True)
def _ideal(actuator, body, command):
    return command, 0.0


@kernel(inline=True)
def _limited(actuator, body, command):
    return max(-actuator.limit_n, min(actuator.limit_n, command)), 0.0


@kernel(inline=True)
def _second_order(actuator, body, command):
    f, d = body[ACTUATOR_F], body[ACTUATOR_RATE]
    if command == 0.0 and abs(f) + abs(d) < _REST_N:
        body[ACTUATOR_F] = 0.0
        body[ACTUATOR_RATE] = 0.0
        return 0.0, 0.0
    y = f - command
    mean = command + (actuator.mean_f * y + actuator.mean_d * d)
    slope = actuator.slope_f * y + actuator.slope_d * d
    body[ACTUATOR_F] = command + (actuator.turn_ff * y + actuator.turn_fd * d)
    body[ACTUATOR_RATE] = actuator.turn_df * y + actuator.turn_dd * d
    limit = actuator.limit_n
    if abs(mean) + abs(slope) > limit:
        start = max(-limit, min(limit, mean - slope))
        end = max(-limit, min(limit, mean + slope))
        mean = 0.5 * (start + end)
        slope = 0.5 * (end - start)
    return mean, slope


# Of each actuator: whether its force changes within a step, known when a caller is compiled, and
# the force on the plate over the step: actuator, state's body, command (N) -> F_0, F_1 (N). What
# remains from step to step is in ACTUATOR_F and ACTUATOR_RATE of the body.
_ACTUATORS = {
    type(None): (no, _ideal),
    ForceLimit: (no, _limited),
    SecondOrder: (yes, _second_order),
}
has_slope = by_type({kind: row[0] for kind, row in _ACTUATORS.items()})
force = by_type({kind: row[1] for kind, row in _ACTUATORS.items()})
