"""Where the loop takes the force of a step from, in five kinds.

`KNOWN`: all forces are known before the run. `HELD`: one force, and of what is produced the last
row is kept. `DIRECT`: law and signal path are in the loop. `LOCK_STEP`: the controller is
elsewhere; the plant waits in the ring of shared memory until it grants the step, or, without a
ring, returns to Python until the bus has brought the answer. `CLOCK`: it waits for the clock, and
takes the newest force.

The kind is a number, so that the loop is compiled once for all of them.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hertzloop.bus import ring_kernels
from hertzloop.bus.ring_kernels import OPEN, Ring, now_ns
from hertzloop.closed_loop import clock as clocks
from hertzloop.closed_loop import grant as grants
from hertzloop.closed_loop.clock import Clock
from hertzloop.closed_loop.grant import Grant
from hertzloop.common.jit import kernel
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.kernels import SignalPathModel, SignalPathState
from hertzloop.controller.law_kernels import LawModel, LawState
from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import BACK, OVER, ImpactFollower
from hertzloop.plant.state_kernels import ACTUATOR_F, ACTUATOR_RATE, F_A, F_C, XI
from hertzloop.sensors import kernels as sensor_kernels

KNOWN, HELD, DIRECT, LOCK_STEP, CLOCK = range(5)


class Status(IntEnum):
    """How far the loop has come, or what is wrong with an answer in the ring."""

    GO = 0  # the step may be taken
    REACHED = 1  # as far as asked, or exchanges are slow and Python should look at the bus
    IMPACT_OVER = 2
    MUST_WAIT = 3  # all samples are answered, and no force is granted
    SILENT = 4  # nothing has come for a while
    FULL = 5  # no room for another unanswered sample
    GAP = 6
    WRONG_COUNT = 7
    BEYOND_END = 8
    NO_NUMBER = 9
    NOT_ZERO = 10


GO, REACHED, IMPACT_OVER, MUST_WAIT, SILENT, FULL = (int(status) for status in tuple(Status)[:6])
GAP, WRONG_COUNT, BEYOND_END, NO_NUMBER, NOT_ZERO = (int(status) for status in tuple(Status)[6:])

# Indices into Exchange.counts: steps whose force was received; samples answered; how often the
# plant waited for a force; when this call of the loop began, whether it is to end early, and how
# many samples are to be answered before it ends; steps of the plant before the first command.
FORCES_END, ANSWERED, EXCHANGES, BEGAN_NS, EARLY, ANSWERS_NEEDED, STEPS_BEFORE = range(7)
EXCHANGE_COUNTS = 7
_LOOK_EVERY = 8  # exchanges between two looks at the clock
# No int: Numba would compile `_take_answers` once for this value, and once for all others.
_NO_STEP = np.int64(-1)

# Indices into Unsent.counts.
TRUTH_FIRST, TRUTH_END, SAMPLES_FIRST, SAMPLES_END, OBSERVED = range(5)
UNSENT_COUNTS = 5


class Unsent(NamedTuple):
    """Time series and samples that were not sent yet. Position 0 is step or sample *_FIRST.

    Attributes:
        truth: Time series of the plant, (columns of hertzloop.plant.time_series, steps).
        codes, values, clipped: Of each sample.
        modes, delays: What the law notes after each sample, if it is in the loop.
        counts: By the indices above. OBSERVED: steps that the sensor has seen.
    """

    truth: np.ndarray
    codes: np.ndarray
    values: np.ndarray
    clipped: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    counts: np.ndarray


class ControllerSide(NamedTuple):
    """Law, signal path, and the commanded force of each step, N."""

    law: LawModel
    law_state: LawState
    path: SignalPathModel
    path_state: SignalPathState
    forces: np.ndarray


class Exchange(NamedTuple):
    """An exchange of any kind; what its kind does not need is empty.

    Attributes:
        kind: KNOWN, HELD, DIRECT, LOCK_STEP or CLOCK.
        controller: Law and signal path; elsewhere only its forces, as far as received.
        commands: Force that acts in each step, N; the last one holds.
        grant: What the controller has granted.
        ring: The plant's end of the shared memory.
        clock: When steps are due.
        impact: The first impact, if the loop ends with it.
        counts: By the indices above.
    """

    kind: int
    controller: ControllerSide
    commands: np.ndarray
    grant: Grant
    ring: Ring
    clock: Clock
    impact: ImpactFollower
    counts: np.ndarray


@kernel(copied=True)
def await_step(exchange, unsent, step, end):
    """Return GO if a step may be observed, else why the loop ends here."""
    if exchange.kind == HELD:  # the sensor sees the state at the end, too
        unsent.counts[TRUTH_FIRST] = unsent.counts[TRUTH_END]
        unsent.counts[SAMPLES_FIRST] = unsent.counts[SAMPLES_END]
        return GO
    if exchange.kind < LOCK_STEP:
        return GO if step < end else REACHED
    counts, in_ring = exchange.counts, exchange.ring.own[OPEN] != 0
    if exchange.kind == CLOCK:
        return _await_due(exchange, unsent, step, end)
    if step < end and counts[EARLY] == 0:
        return GO
    if not in_ring:
        return REACHED
    counts[EARLY] = 0
    return _take_answers(exchange, unsent, step, counts[ANSWERS_NEEDED], _NO_STEP)


@kernel(copied=True)
def put(exchange, unsent, step, value):
    """Pass on the sample of a step, just taken."""
    index = unsent.counts[SAMPLES_END] - 1
    if exchange.kind == DIRECT:
        controller, at = exchange.controller, index - unsent.counts[SAMPLES_FIRST]
        controller_kernels.control_sample(
            controller.law,
            controller.law_state,
            controller.path,
            controller.path_state,
            value,
            controller.forces,
        )
        unsent.modes[at] = controller.law_state.record[laws.MODE]
        unsent.delays[at] = controller.law_state.record[laws.DELAY]
    elif exchange.kind >= LOCK_STEP:
        if exchange.kind == CLOCK:
            clocks.keep_sample(exchange.clock, index, value, now_ns())
            if exchange.ring.own[OPEN] != 0:
                _put_kept(exchange, unsent)
        elif exchange.ring.own[OPEN] != 0:
            ring_kernels.put_sample(exchange.ring, index, value)
        grants.check_trigger(exchange.grant, step, value, index + 1)


@kernel(copied=True)
def force_for(exchange, unsent, step, end):
    """Return the force that acts in a step, N, and GO; or 0 and why the loop ends here."""
    # Steps before the run; at a pace, by how many steps the force is late.
    steps_back = exchange.counts[STEPS_BEFORE]
    if exchange.kind == HELD and step >= end:
        return 0.0, REACHED
    if exchange.kind >= LOCK_STEP:
        grant, counts, ring = exchange.grant, exchange.counts, exchange.ring
        known = grants.is_known(grant, step)
        if exchange.kind == CLOCK:
            if not known:
                steps_back = step + 1 - grant.counts[grants.KNOWN_UNTIL]
            exchange.clock.held_steps[step] = steps_back
        elif ring.own[OPEN] == 0:
            if not known:
                return 0.0, MUST_WAIT
        elif not known or unsent.counts[SAMPLES_END] - counts[ANSWERED] >= ring.slots:
            room = unsent.counts[SAMPLES_END] - ring.slots + 1
            status = _take_answers(exchange, unsent, step, room, step)
            if status != REACHED:
                return 0.0, status
            counts[EXCHANGES] += 0 if known else 1
            if counts[EXCHANGES] % _LOOK_EVERY == 0 and now_ns() - counts[BEGAN_NS] > ring.wait_ns:
                counts[EARLY] = 1  # exchanges are slow, though none takes as long as a silence
    return exchange.commands[min(step - steps_back, exchange.commands.size - 1)], GO


@kernel(copied=True)
def _await_due(exchange, unsent, step, end):
    """Wait until a step is due; meanwhile take answers, and put samples into the ring."""
    clock, ring, counts = exchange.clock, exchange.ring, exchange.counts
    in_ring = ring.own[OPEN] != 0
    while True:
        now = now_ns()
        if in_ring:
            status = _take_answers(exchange, unsent, step, counts[ANSWERS_NEEDED], _NO_STEP)
            if status != REACHED:
                return status
            _put_kept(exchange, unsent)
        clocks.note_answers(clock, now, counts[ANSWERED], counts[FORCES_END])
        if step >= end:
            return REACHED
        unanswered = unsent.counts[SAMPLES_END] - counts[ANSWERED]
        behind = now - clocks.due_ns(clock, step)
        if behind >= 0:
            clock.counts[clocks.BEHIND_MAX_NS] = max(clock.counts[clocks.BEHIND_MAX_NS], behind)
            return FULL if unanswered >= clock.values.size else GO
        if not in_ring or now - counts[BEGAN_NS] > ring.wait_ns:
            return SILENT
        clocks.wait_until_due(clock, ring, -behind, unanswered == 0, now)


@kernel(part=True)
def _put_kept(exchange, unsent):
    """Put samples into the ring, as far as there is room."""
    clock, ring = exchange.clock, exchange.ring
    end = min(unsent.counts[SAMPLES_END], exchange.counts[ANSWERED] + ring.slots)
    for i in range(clock.counts[clocks.PUT], end):
        ring_kernels.put_sample(ring, i, clock.values[i & (clock.values.size - 1)])
        clock.counts[clocks.PUT] = i + 1


@kernel(part=True)
def _take_answers(exchange, unsent, step, answers, needed_step):
    """Take answers from the ring: wait until `answers` samples are answered and the force of
    `needed_step` is known, or, if that is below zero, take all that are there."""
    ring, counts = exchange.ring, exchange.counts
    while True:
        known = needed_step < 0 or grants.is_known(exchange.grant, needed_step)
        if known and counts[ANSWERED] >= answers:
            if needed_step >= 0 or not ring_kernels.answer_is_there(ring):
                return REACHED
        elif counts[ANSWERED] == unsent.counts[SAMPLES_END]:
            return MUST_WAIT
        elif not ring_kernels.wait_for_answer(ring):
            return SILENT
        excess, answered, force, level = ring_kernels.receive_force(ring)
        status = (
            GAP if excess != 0 else accept_record(exchange, unsent, step, answered, force, level)
        )
        if status != GO:
            return status


@kernel(copied=True)
def accept_record(exchange, unsent, step, answered, force, level):
    """Accept one record of an answer from the ring before a step is taken. A block from the bus is
    accepted by `loop.plant_exchange.accept_block`.

    `force` is NaN in a record without a force, `level` in one without a trigger level.
    """
    counts, forces = exchange.counts, exchange.controller.forces
    taken = unsent.counts[SAMPLES_END]
    if not counts[ANSWERED] <= answered <= taken:
        return WRONG_COUNT
    if not math.isnan(force):
        at = counts[FORCES_END]
        if at >= forces.size:
            return BEYOND_END
        if math.isinf(force):
            return NO_NUMBER
        # A step that went without its force was not granted.
        late = exchange.kind == CLOCK and exchange.clock.held_steps[at] > 0
        if at < step and not late and forces[at] != force:
            return NOT_ZERO
        forces[at] = force
        counts[FORCES_END] = at + 1
        grants.extend(exchange.grant, at + 1)
    if answered == counts[ANSWERED]:
        return GO  # more of this answer follows
    counts[ANSWERED] = answered
    if level == math.inf:
        return NO_NUMBER
    grants.renew(exchange.grant, math.inf if math.isnan(level) else level, answered, taken)
    return GO


@kernel(copied=True)
def is_over(exchange, side, unsent, gap):
    """Follow the impact through a step that began with a gap (m); return whether no later step can
    belong to it.

    Nothing pushes or is on its way, and the sphere has come back; or the law stays at zero while
    samples stay above a level, and the sensor can show none below it until the sphere has come
    back.
    """
    impact = exchange.impact
    if impact.quiet_steps < 0:
        return False
    body, controller = side.plant_state.body, exchange.controller
    impact_kernels.follow(impact, body[F_C], body[F_A], gap)
    if impact.counts[OVER] == 1:
        return True
    path_state = controller.path_state
    if not impact_kernels.is_silent(impact) or not controller_kernels.is_quiet(path_state):
        return False
    if body[ACTUATOR_F] != 0.0 or body[ACTUATOR_RATE] != 0.0:
        return False  # the actuator still answers
    if impact.counts[BACK] != 1 and not _stays_quiet(exchange, side, unsent):
        return False
    # The signal path says what comes from the emitted forces on, which latency puts ahead.
    for step in range(unsent.counts[OBSERVED], grants.known_until(controller)):
        if controller.forces[step] != 0.0:
            return False
    return True


@kernel(copied=True)
def _stays_quiet(exchange, side, unsent):
    """Return whether the sensor cannot trigger the law before the sphere has come back."""
    law_state, impact, sensor = exchange.controller.law_state, exchange.impact, side.sensor
    level = grants.trigger_level(exchange.controller)
    value = law_state.history[law_state.counts[laws.SAMPLES] - 1]
    if not value > level:
        return False
    if level == -math.inf:
        return True
    least, since = impact_kernels.least_gap(impact)
    if sensor.of_state != XI:
        least = -math.inf  # the gap says nothing of other quantities
    taken = unsent.counts[SAMPLES_END]
    least = sensor_kernels.least_sample(sensor, side.sensor_state, taken, least, since)
    return least > level
