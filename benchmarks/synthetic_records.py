"""Synthetic records for tests, benchmarks and examples, made with other steps and more modes than a
fit uses."""

from dataclasses import dataclass

import numpy as np
import scipy

from hertzloop.fitting.fit.impact_simulator import ImpactSimulator, LoopSimulator
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, ObservedSignal, observe
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_PLANT_NS = 100  # under a law
_OTHER_STEP_NS = {"short": 125, "long": 400}
_LONG_S = 4e-3
_MORE_MODES = 1e-5  # accuracy; a fit takes 3e-5 at the finest


def truth(
    setup: Setup,
    quantity: str,
    duration_s: float,
    chain: MeasuringChain | None = None,
    accuracy: float = _MORE_MODES,
    phase: float | None = None,
) -> ObservedSignal:
    """Return the noiseless quantity of a scene over the time after the first touch.

    Args:
        setup: the true scene.
        quantity: a key of `records.QUANTITIES`.
        duration_s: how long, s.
        chain: filters; none if left out.
        accuracy: that the number of modes follows from.
        phase: of a drop under the law of the scene, steps from a sample to the touch; without one
            the law is off.
    """
    if phase is not None:
        looped = LoopSimulator(setup, duration_s, accuracy, _PLANT_NS)
        return observe(
            looped.run({}, duration_s, phase), quantity, chain or MeasuringChain(), False
        )
    step_ns = _OTHER_STEP_NS["long" if duration_s > _LONG_S else "short"]
    simulator = ImpactSimulator(setup, duration_s, accuracy, step_ns=step_ns)
    return observe(simulator.run({}, duration_s), quantity, chain or MeasuringChain(), False)


@dataclass(frozen=True)
class Spoilt:
    """What a measurement adds: noise over the peak, gain, offset over the peak, clock error, noise
    with memory `ar`, converter bits over 2.5 peaks, a share of spikes of 20 deviations."""

    noise: float = 0.003
    gain: float = 1.0
    offset: float = 0.0
    clock_ppm: float = 0.0
    ar: float = 0.0
    bits: int | None = None
    spikes: float = 0.0


def measured(
    seen: ObservedSignal,
    spoilt: Spoilt,
    seed: int,
    *,
    rate_hz: float = 2e6,
    quiet_s: float = 250e-6,
    name: str = "synthetic",
    table: Measurement | None = None,
    zero_s: float | None = None,
    clock: str = "",
) -> Record:
    """Return a record of a noiseless quantity.

    Args:
        seen: the quantity, of `truth`.
        spoilt: what the measurement adds.
        seed: of noise, phase of the samples and time zero.
        rate_hz: samples per second.
        quiet_s: length before the touch, s; below zero the record begins after it.
        name: of the record.
        table: what the record says of itself.
        zero_s: the record's time of the touch; by the seed if left out.
        clock: a name that the records of one clock share.
    """
    generator = np.random.default_rng(seed)
    duration_s = float(seen.simulated.time_s[-1]) - 2e-6
    tau = np.arange(-quiet_s + generator.uniform() / rate_hz, duration_s, 1.0 / rate_hz)
    clean = seen.value(tau)
    peak = float(np.max(np.abs(clean)))
    noise = generator.standard_normal(len(tau))
    if spoilt.ar:
        first = np.sqrt(1.0 - spoilt.ar**2)
        noise = scipy.signal.lfilter([first], [1.0, -spoilt.ar], noise)
    value = spoilt.gain * clean + spoilt.offset * peak + spoilt.noise * peak * noise
    if spoilt.spikes:
        hit = generator.uniform(size=len(tau)) < spoilt.spikes
        sign = generator.choice([-1.0, 1.0], size=len(tau))
        value = value + hit * sign * 20.0 * spoilt.noise * peak
    if spoilt.bits:
        step = 2.5 * peak / 2**spoilt.bits
        value = np.round(value / step) * step
    zero_s = generator.uniform(0.0, 0.01) if zero_s is None else zero_s
    time_s = zero_s + tau * (1.0 + 1e-6 * spoilt.clock_ppm)
    found = table or Measurement(quantity=seen.quantity)
    return Record(name, time_s, value, seen.quantity, measurement=found, clock=clock)
