"""The grant: how far the plant may run without the controller.

After each sample the controller grants the steps before `known_until`: their forces are final. If
no force acts or is on its way, and the law stays at zero while samples stay above a
`trigger_level`, the force is zero until a sample falls to that level. The force of that sample acts
`loop_delay_steps` later, so until then it stays zero too.

Example: loop_delay_steps is 3. After the sample of step 10 forces are known until step 13. With a
trigger level of 1 mm the plant runs on until a sample, of step 200, is 1 mm or less; then its force
is known until step 203.

The controller calls `known_until` and `trigger_level`, which asks the law. The plant calls
`extend`, `renew` and `check_trigger`, and asks `is_known` before every step.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.kernels import EMITTED

# Indices into Grant.counts. ZERO_UNTIL_TRIGGER: 1 while it holds. TRIGGERED: samples taken when one
# last fell to the level.
KNOWN_UNTIL, ZERO_UNTIL_TRIGGER, TRIGGERED = range(3)


class Grant(NamedTuple):
    """What the controller has granted, as the plant keeps it.

    Attributes:
        counts: By the indices above.
        trigger_level: Shape (1,), in the unit of the samples.
        loop_delay_steps: Steps from a sample to the first step in which its force acts.
    """

    counts: np.ndarray
    trigger_level: np.ndarray
    loop_delay_steps: int


def no_grant(loop_delay_steps: int) -> Grant:
    """Return the grant before the first answer. Any sample would trigger."""
    return Grant(np.zeros(3, np.int64), np.full(1, math.inf), loop_delay_steps)


@kernel(copied=True)
def known_until(controller):
    """Return the first step whose force the controller does not know."""
    return controller.path_state.counts[EMITTED]


@kernel(part=True)
def trigger_level(controller):
    """Return the level above which samples leave the force at zero; inf without one."""
    if not controller_kernels.is_quiet(controller.path_state):
        return math.inf
    return laws.trigger_level(controller.law, controller.law_state)


@kernel(copied=True)
def is_known(grant, step):
    """Return whether the plant may take a step."""
    return grant.counts[ZERO_UNTIL_TRIGGER] == 1 or step < grant.counts[KNOWN_UNTIL]


@kernel(copied=True)
def extend(grant, until):
    """Accept that forces are known until a step."""
    grant.counts[KNOWN_UNTIL] = max(grant.counts[KNOWN_UNTIL], until)


@kernel(copied=True)
def renew(grant, level, answered, taken):
    """Accept the trigger level (inf: none) of the answer to `answered` of `taken` samples.

    The samples after those answered may have triggered already. The level counts if none of them
    has: there is none, or all of them were compared with the same level and stayed above it.
    """
    counts, zero = grant.counts, level < math.inf
    compared = answered >= counts[TRIGGERED] and (not zero or level == grant.trigger_level[0])
    if answered == taken or compared:
        counts[ZERO_UNTIL_TRIGGER] = 1 if zero else 0
        if zero:
            grant.trigger_level[0] = level


@kernel(copied=True)
def check_trigger(grant, step, value, taken):
    """End the zero force if the sample of `step`, the last of those taken, falls to the level."""
    counts = grant.counts
    if value <= grant.trigger_level[0]:
        counts[TRIGGERED] = taken
        if counts[ZERO_UNTIL_TRIGGER] == 1:
            counts[ZERO_UNTIL_TRIGGER] = 0
            extend(grant, step + grant.loop_delay_steps)
