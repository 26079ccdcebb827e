"""A made-up record of a scene, for a check before an experiment."""

import math
import re

import numpy as np

from hertzloop.fitting.fit.channels.sample_selection import LASTING_S
from hertzloop.fitting.fit.errors import FitError
from hertzloop.fitting.fit.problem.controlled_records import (
    refuse_incomparable,
    refuse_unknown_loop,
)
from hertzloop.fitting.fit.simulation.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.simulation.loop_simulator import LoopSimulator
from hertzloop.fitting.fit.simulation.measuring_chain import MeasuringChain
from hertzloop.fitting.fit.simulation.observed_signal import observe
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_MOST_EXPECTED = 10_000_000  # samples of an expected record
_NUMBER = r"((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
_EXPECTED = re.compile(rf"([a-z_]+):{_NUMBER}us:{_NUMBER}%(?::{_NUMBER}MHz)?")


def expected_record(
    setup: Setup, text: str, name: str = "expected record", control: bool | None = None
) -> Record:
    """Return a made-up record of the scene as it is, for a check before an experiment.

    Args:
        setup: the scene.
        text: `QUANTITY:DURATIONus:NOISE%[:RATEMHz]`, as `contact_force:70us:0.3%:2MHz`; the noise
            is a share of the peak.
        name: of the record.
        control: whether the law is on; by default for the force of the actuator alone.

    Raises:
        FitError: the text is not of this form.
    """
    match = _EXPECTED.fullmatch(text.strip())
    numbers = [float(number) for number in match.groups("2")[1:]] if match else []
    if match is None or match[1] not in QUANTITIES or not all(0.0 < x < math.inf for x in numbers):
        raise FitError(
            f"--expect {text}: is not QUANTITY:DURATIONus:NOISE%[:RATEMHz] with positive numbers, "
            f"such as contact_force:70us:0.3%:2MHz. Known quantities: {', '.join(QUANTITIES)}."
        )
    quantity, (duration_us, percent, rate_mhz) = match[1], numbers
    duration_s, step_s = 1e-6 * duration_us, 1e-6 / rate_mhz
    quiet_s = max(250 * step_s, 0.2e-3)
    samples = (duration_s + quiet_s) / step_s
    if duration_s > LASTING_S or samples > _MOST_EXPECTED:
        raise FitError(
            f"--expect {text}: is a record of {1e3 * duration_s:.3g} ms with {samples:.3g} "
            f"samples. Suppose at most {1e3 * LASTING_S:g} ms and {_MOST_EXPECTED:g} samples."
        )
    under = quantity == "actuator_force" if control is None else control
    table = Measurement(quantity=quantity, control=under)
    simulator: ImpactSimulator
    if under:
        refuse_unknown_loop(setup)
        plain = Record(name, np.arange(8.0), np.ones(8), quantity, measurement=table)
        refuse_incomparable(plain, setup)
        simulator = LoopSimulator(setup, duration_s, 1e-4)
    else:
        simulator = ImpactSimulator(setup, duration_s, 1e-4)
    time_s = np.arange(-quiet_s, duration_s, step_s)
    clean = observe(simulator.run({}, duration_s), quantity, MeasuringChain(), False).value(time_s)
    noise = 0.01 * percent * float(np.max(np.abs(clean)))
    # The noise has a known size and no influence on the answer; its seed makes it repeatable.
    noisy = clean + noise * np.random.default_rng(1).standard_normal(len(clean))
    return Record(name, time_s, noisy, quantity, measurement=table)
