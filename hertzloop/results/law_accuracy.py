"""Whether a law lets a run keep its accuracy: what twice the modes change under the law."""

from dataclasses import dataclass, replace
from enum import StrEnum

from hertzloop.loop.simulate import LawStopped, simulate
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results.cases import latched_us
from hertzloop.results.metrics import Metrics
from hertzloop.results.verification import (
    Verification,
    changes,
    finer_spec,
    past_first_impact,
    started_as,
)
from hertzloop.scene import model_error
from hertzloop.scene.setup import Setup

_MOST_STEPS = 2_000_000  # that are simulated in memory


class SensitiveMetric(StrEnum):
    """Metrics of the first impact that a finer model moves, as `Verification` names them."""

    PENETRATION = "penetration"
    REBOUND_SPEED = "rebound_speed"
    PLATE_ENERGY = "plate_energy"


# How many modes a plate needs is estimated from what they do to an impact. A law that waits for a
# threshold may meet it so near to a sample that the modes left out decide at which: what it latches
# then differs by a whole sample, and the impact by far more than the modes themselves would do.
@dataclass(frozen=True)
class LawAccuracy:
    """What twice the modes change in the first impact, with the loop closed.

    Attributes:
        by_modes: the changes.
        asked: requested error of the run, relative.
        expected: expected error of the run, relative.
        delay_us: delay that the law latches in the run, us; nan for a law that latches none.
        finer_delay_us: the same with twice the modes.
    """

    by_modes: Verification
    asked: float
    expected: float
    delay_us: float
    finer_delay_us: float

    @property
    def kept(self) -> bool:
        """Whether the changes are as small as the run expects."""
        return self.by_modes.largest <= max(self.asked, self.expected)

    @property
    def most_moved(self) -> SensitiveMetric:
        """The metric that twice the modes change most."""
        return max(SensitiveMetric, key=lambda metric: getattr(self.by_modes, metric))

    @property
    def latches_otherwise(self) -> bool:
        """Whether the law latches another delay with twice the modes."""
        return self.delay_us != self.finer_delay_us and self.delay_us + self.finer_delay_us > 0.0


def simulated_law_accuracy(setup: Setup, until_s: float) -> LawAccuracy | None:
    """Simulate the first impact of a scene, over with the push it causes by `until_s`, with its
    modes and with twice as many, as far as the step carries them.

    None without a law, where the step carries no more modes, where more are not known or take long
    to find (a file, edges that are not simply supported, an infinite plate, the published scheme),
    without an impact that ends by then, and where the law stops.
    """
    steps = min(round(until_s / setup.run.step_s) + 3, setup.run.steps)
    converges = SCHEMES[setup.run.scheme].converges
    if not setup.scene.controller.has_law or not converges or steps > _MOST_STEPS:
        return None
    finer = _twice_the_modes(setup)
    if finer is None:
        return None
    # How long a run lasts may decide about the model of its plate.
    short = setup.with_plate_model(setup.plate_model).with_steps(steps)
    try:
        run = simulate(short)
        until = past_first_impact(short, run.truth)
        if until is None:
            return None
        other = simulate(short.with_steps(until), own_plant=started_as(short, finer))
    except LawStopped:
        return None
    found = changes(short, run.truth[:, :until], other.truth, finer)
    if found is None:
        return None
    return LawAccuracy(
        found,
        setup.run.accuracy,
        model_error.expected_error(short),
        latched_us(short, run),
        latched_us(short, other),
    )


def stated_error(expected: float | None, found: LawAccuracy | None) -> float | None:
    """The error that a run states: the `expected` one, or what twice the modes change under the law
    where that is more than the run expects."""
    if expected is None or found is None or found.kept:
        return expected
    return max(expected, found.by_modes.largest)


def _twice_the_modes(setup: Setup) -> PlantSpec | None:
    spec = setup.plant
    if spec.infinite_plate or spec.plate.simply_supported is None:
        return None
    # Beyond 1/(2 step) is what the steps of a held force put in, which no sample carries.
    limit_hz = min(finer_spec(setup).frequency_limit_hz, 0.5 / setup.run.step_s)
    if limit_hz <= spec.frequency_limit_hz:
        return None
    return replace(spec, frequency_limit_hz=limit_hz)


def law_accuracy(setup: Setup, metrics: Metrics) -> LawAccuracy | None:
    """Whether the accuracy asked for is kept under the law of a run."""
    if not metrics.impacts or metrics.stability.unstable:
        return None
    first = metrics.impacts[0]
    return simulated_law_accuracy(setup, first.start_s + 2.0 * first.duration_s)
