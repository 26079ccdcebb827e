"""The parts that the loop takes, and the plant alone: the loop under commands known before."""

import math

import numpy as np

from hertzloop.bus import shared_memory
from hertzloop.bus.ring_kernels import Ring
from hertzloop.closed_loop import loop
from hertzloop.closed_loop.clock import Clock, new_clock
from hertzloop.closed_loop.exchange import (
    EXCHANGE_COUNTS,
    KNOWN,
    STEPS_BEFORE,
    UNSENT_COUNTS,
    ControllerSide,
    Exchange,
    Unsent,
)
from hertzloop.closed_loop.grant import no_grant
from hertzloop.closed_loop.loop import PlantSide
from hertzloop.controller.controller import Controller
from hertzloop.controller.kernels import SIGNAL_PATH_COUNTS, SignalPathModel, SignalPathState
from hertzloop.controller.law_kernels import LawModel, first_state
from hertzloop.plant.metrics.impact_kernels import NEVER, ImpactFollower
from hertzloop.plant.plant import Plant
from hertzloop.plant.state_kernels import STEP
from hertzloop.plant.time_series import COLUMNS
from hertzloop.sensors.acquisition import Sensor, SensorSpec

_NO_SENSOR = Sensor(SensorSpec(every_steps=1 << 62), 1e-6, 1, 0)
NO_CLOCK, NO_RING = new_clock(0, 1, 0.0), shared_memory.closed()


def empty_unsent(steps: int, samples: int) -> Unsent:
    """Return room for the time series of `steps` steps and for `samples` samples."""
    truth, codes, values = (
        np.zeros((COLUMNS, steps)),
        np.zeros(samples, np.int64),
        np.zeros(samples),
    )
    clipped, modes, delays = (np.zeros(samples, np.int64) for _ in range(3))
    return Unsent(truth, codes, values, clipped, modes, delays, np.zeros(UNSENT_COUNTS, np.int64))


def plant_side(plant: Plant, sensor: Sensor = _NO_SENSOR) -> PlantSide:
    """Return plant and sensor as the loop takes them."""
    return PlantSide(plant.model, plant.state, sensor.model, sensor.state)


def controller_side(controller: Controller) -> ControllerSide:
    """Return a controller as the loop takes it."""
    law, path = controller.law, controller.path
    return ControllerSide(law, controller.law_state, path, controller.path_state, controller.forces)


def elsewhere(forces: np.ndarray) -> ControllerSide:
    """Return a controller of which the loop knows only the forces (N, one a step)."""
    none, converter = np.zeros(0, np.int64), (True, False, 0.0, 1.0, 0, math.inf)
    return ControllerSide(
        LawModel(0, 0, 0, 0, np.zeros(0, np.uint8)),
        first_state(none, 0),
        SignalPathModel(1, 0, none, np.zeros(0, np.bool_), *converter),
        SignalPathState(np.zeros(0), np.zeros(SIGNAL_PATH_COUNTS, np.int64), np.zeros(2)),
        forces,
    )


def exchange(
    kind: int,
    controller: ControllerSide,
    *,
    commands: np.ndarray | None = None,
    loop_delay_steps: int = 1,
    ring: Ring = NO_RING,
    clock: Clock = NO_CLOCK,
    impact: ImpactFollower = NEVER,
) -> Exchange:
    """Return an exchange at the start of a run. `commands` act, if not the controller's forces."""
    commands = controller.forces if commands is None else commands
    counts = np.zeros(EXCHANGE_COUNTS, np.int64)
    grant = no_grant(loop_delay_steps)
    return Exchange(kind, controller, commands, grant, ring, clock, impact, counts)


def series_under(plant: Plant, commands: np.ndarray, steps: int | None = None) -> np.ndarray:
    """Step a plant without sensor and controller.

    Args:
        plant: The plant, at its present step.
        commands: Force of the actuator in each step, N; the last one holds.
        steps: Number of steps; by default one for each command.

    Returns:
        Time series, shape (10, steps).
    """
    steps = len(commands) if steps is None else steps
    begun, known = int(plant.state.counts[STEP]), exchange(KNOWN, elsewhere(commands))
    known.counts[STEPS_BEFORE] = begun
    unsent = empty_unsent(steps, 1)
    loop.run(plant_side(plant), known, unsent, begun + steps)
    return unsent.truth
