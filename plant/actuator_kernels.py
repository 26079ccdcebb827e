"""Compiled kernel of the actuator between a commanded force and the plate.

A command is held over a step. An actuator of second order answers it with
F'' + 2 zeta w F' + w^2 F = w^2 c, which is propagated exactly; what the plate gets is the
projection of F on linear functions of the step, F_0 + F_1 (2 t/h - 1), as the contact force is.
Then force is limited at both ends of the step.
"""

from typing import NamedTuple

from hertzloop.common.jit import kernel
from hertzloop.plant.state_kernels import ACTUATOR_F, ACTUATOR_RATE

# A command beyond this (N) acts as this: a loop that runs away stays finite for as long as it runs.
MOST_N = 1e12
# Below this (N) an actuator without command is at rest: 1e-20 of a newton moves nothing, and a
# number that decays for ever ends in denormal ones, which are slow.
_REST_N = 1e-20


class ActuatorModel(NamedTuple):
    """An actuator from step to step.

    `at_once`: it follows a command at once; else coefficients by y = (F - c, F'/w) at the start of
    a step: y at its end, mean and slope of F - c over it. `limit_n`: largest force, may be
    infinite.
    """

    at_once: bool
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
def force(actuator, body, command):
    """Force on the plate over a step, F_0 and F_1 (N), under a command (N). What remains from step
    to step is in ACTUATOR_F and ACTUATOR_RATE of the body."""
    limit = actuator.limit_n
    command = max(-MOST_N, min(MOST_N, command))
    if actuator.at_once:
        return max(-limit, min(limit, command)), 0.0
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
    if abs(mean) + abs(slope) > limit:
        start = max(-limit, min(limit, mean - slope))
        end = max(-limit, min(limit, mean + slope))
        mean = 0.5 * (start + end)
        slope = 0.5 * (end - start)
    return mean, slope
