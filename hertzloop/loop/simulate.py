"""A scene simulated in memory, without bus or recording."""

from dataclasses import dataclass

import numpy as np

from hertzloop.closed_loop import loop
from hertzloop.closed_loop.exchange import (
    DIRECT,
    IMPACT_OVER,
    SAMPLES_END,
    TRUTH_END,
)
from hertzloop.closed_loop.parts import controller_side, empty_unsent, exchange, plant_side
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop.impact_end import impact_follower
from hertzloop.loop.stuck_law import watching
from hertzloop.plant.metrics.impact_kernels import NEVER
from hertzloop.plant.plant import Balance, Plant
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.controller import build_controller
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup


class LawStopped(SceneError):
    """The law has failed in a simulated run.

    Attributes:
        truth: Time series until then, shape (10, steps).
    """

    def __init__(self, message: str, truth: np.ndarray) -> None:
        super().__init__(message)
        self.truth = truth


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run in memory.

    Attributes:
        truth: Time series of the plant, shape (10, steps), ordered as `plant.time_series.TRUTH`.
        samples: Samples as they would be sent: values, or codes of the converter.
        values: Values of the samples, in the unit of the sensed quantity.
        forces: Commanded forces, N, shape (steps,).
        modes: Mode of the law after each sample.
        delays: Latched delay of the law after each sample, in samples.
        balance: Energy and momentum balance.
        over: Whether the run ended early because its first impact was over.
    """

    truth: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    forces: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    balance: Balance
    over: bool


def simulate(
    setup: Setup,
    impact_only: bool = False,
    own_plant: Plant | None = None,
    steps: int | None = None,
    parts_of_step: int = 1,
) -> SimulatedRun:
    """Run a scene without bus and recording.

    Args:
        setup: Setup of the run.
        impact_only: End as soon as no later step can belong to the first impact.
        own_plant: A plant at its start, in place of that of the scene.
        steps: End after this many steps; by default those of the scene.
        parts_of_step: Steps of the plant in each step of the scene. Samples, forces and random
            numbers belong to the steps of the scene; a force is held over one.

    Raises:
        LawStopped: The law has failed.
    """
    most = steps or setup.run.steps
    plant = own_plant or build_plant(setup, steps=most)
    sensor = build_sensor(setup, most)
    controller = build_controller(setup, ahead=impact_only, steps=most)
    samples = len(controller.law_state.history)
    unsent = empty_unsent(most * parts_of_step, samples)
    over_step = parts_of_step > 1 and SENSED[setup.scene.sensors.quantity].over_step
    side = plant_side(plant, sensor)._replace(parts_of_step=parts_of_step, sensed_mean=over_step)
    impact = impact_follower(setup) if impact_only else NEVER
    direct = exchange(DIRECT, controller_side(controller), impact=impact)
    with watching(setup, lambda: int(controller.law_state.counts[laws.SAMPLES])):
        status = loop.run(side, direct, unsent, most)
    try:
        controller.check()
    except LawFault as error:
        before = (controller.failed_at * setup.sensor.every_steps + 1) * parts_of_step
        raise LawStopped(str(error), unsent.truth[:, :before]) from error
    ran, taken = int(unsent.counts[TRUTH_END]), int(unsent.counts[SAMPLES_END])
    sent = unsent.values if sensor.model.ideal else unsent.codes
    return SimulatedRun(
        unsent.truth[:, :ran],
        sent[:taken],
        unsent.values[:taken],
        controller.forces[: ran // parts_of_step],
        unsent.modes[:taken],
        unsent.delays[:taken],
        plant.close_balance(),
        status == IMPACT_OVER,
    )
