"""The quantities whose limits a budget searches: scene keys, values from harmless to harsh."""

import math
from collections.abc import Sequence

from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.results.cases import uncontrolled
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.limits import BudgetQuantity

_NOISE_DECADES, _PLACES_A_DECADE = 6, 25
_BANDWIDTHS_HZ = (1e3, 1e7)  # the largest acts within a tenth of a step: it stands for ideal
_MASSES = (1e-3, 1e2)  # of the mass of the sphere
_MOST_BITS, _COARSE_BITS = 24, 12  # above 12 bits the scan takes every fourth value
_FEW = 64  # sampling periods that are all scanned: a law may miss its goal at every other one


def contact_us(setup: Setup) -> float:
    """Return the contact time on a rigid plate, us: the time scale of a scene."""
    return 1e6 * rigid_impact(setup.mechanics.sphere, setup.mechanics.contact).contact_s


QUANTITIES = ("latency_us", "jitter_us", "bits", "noise", "sampling_us", "bandwidth_hz", "mass_kg")


def quantities_of(setup: Setup) -> list[BudgetQuantity]:
    """Return the quantities of a scene with the values to search, in the order of `QUANTITIES`.

    Latency and jitter go to twice the contact time on a rigid plate in whole steps, the sampling
    period to the contact time itself; bits from 24 to 1 after an ideal converter; noise over six
    decades up to the range of a converter; bandwidth from 10 MHz to 1 kHz; mass from 1e-3 to 100
    times that of the sphere. The last three have 25 values a decade. Times go on to the contact
    time without control, and the bandwidth to the inverse of that, where they do not reach it.
    """
    free_us = 1e6 * uncontrolled(setup, "impact").contact_time_s
    found = [*_times(setup, free_us), *_of_converter(setup), *_of_actuator(setup, free_us)]
    return sorted(found, key=lambda quantity: QUANTITIES.index(quantity.name))


def _times(setup: Setup, free_us: float) -> list[BudgetQuantity]:
    """Return latency, jitter and sampling period, given the contact time without control, us."""
    step_us, rigid_us, control = (
        setup.run.step_ns / 1000.0,
        contact_us(setup),
        setup.scene.controller,
    )
    # A latency as long as the run is refused.
    most = min(2.0 * rigid_us, 0.45e6 * (setup.run.duration_s - setup.run.lead_in_s))
    usual, used = (max(2, math.ceil(x / step_us)) for x in (most, rigid_us))
    longest = math.ceil(min(free_us, 1e6 * setup.run.duration_s - step_us) / step_us)
    times = tuple(i * step_us for i in range(max(usual, longest) + 1))
    periods = tuple(range(1, max(used, longest) + 1))
    return [
        BudgetQuantity(
            "latency_us",
            "controller.latency_us",
            "us",
            times,
            "the latency is as long as the contact",
            usual,
            _place(times, control.latency_us),
            finer=2,
        ),
        BudgetQuantity(
            "jitter_us",
            "controller.jitter_us",
            "us",
            times,
            "the jitter is as long as the contact",
            usual,
            _place(times, control.jitter_us),
            by_chance=True,
            finer=2,
        ),
        BudgetQuantity(
            "sampling_us",
            "sensors.every_steps",
            "us",
            periods,
            "the contact has one sample",
            used - 1,
            _place(periods, setup.scene.sensors.every_steps),
            scale=step_us,
            finer=4,
            scan=tuple(range(used)) if used <= _FEW else (),
        ),
    ]


def _of_converter(setup: Setup) -> list[BudgetQuantity]:
    """Return bits and noise."""
    sensors = setup.scene.sensors
    bits = ("ideal", *range(_MOST_BITS, 0, -1))
    fine = range(1, _MOST_BITS - _COARSE_BITS, 4)
    width = converter_width(setup)
    noises = (0.0, *(() if width is None else _spread(width * 10.0**-_NOISE_DECADES, width)))
    return [
        BudgetQuantity(
            "bits",
            "sensors.bits",
            "bits",
            bits,
            "the converter only tells two values apart",
            None,
            bits.index(sensors.bits),
            scan=(0, *fine, *range(_MOST_BITS - _COARSE_BITS + 1, len(bits))),
        ),
        BudgetQuantity(
            "noise",
            "sensors.noise_rms",
            f"{SENSED[setup.scene.sensors.quantity].unit} rms",
            noises,
            "the noise is as large as the range of the converter",
            None,
            _place(noises, sensors.noise_rms),
            by_chance=True,
            finer=4,
        ),
    ]


def _of_actuator(setup: Setup, free_us: float) -> list[BudgetQuantity]:
    """Return bandwidth and mass, given the contact time without control, us."""
    actuator, (low_hz, high_hz) = setup.scene.actuator, _BANDWIDTHS_HZ
    slow_hz = max(1.0, 1e6 / (2.0 * math.pi * free_us))
    slower = _spread(slow_hz, low_hz)[-2::-1] if slow_hz < low_hz else ()
    bandwidths = (*reversed(_spread(low_hz, high_hz)), *slower)
    own_hz = math.inf if actuator.bandwidth_hz is None else actuator.bandwidth_hz
    least_kg, most_kg = (share * setup.mechanics.sphere.mass_kg for share in _MASSES)
    masses = (0.0, *_spread(max(least_kg, 1e-6), min(most_kg, 1e3)))
    return [
        BudgetQuantity(
            "bandwidth_hz",
            "actuator.bandwidth_hz",
            "Hz",
            bandwidths,
            "the actuator is slower than the contact",
            len(bandwidths) - len(slower) - 1,
            max(0, sum(hz >= own_hz for hz in bandwidths) - 1),
        ),
        BudgetQuantity(
            "mass_kg",
            "actuator.mass_kg",
            "kg",
            masses,
            "the actuator is too heavy for the sphere to move",
            None,
            _place(masses, actuator.mass_kg or 0.0),
        ),
    ]


def converter_width(setup: Setup) -> float | None:
    """Return the range of a converter for what the scene samples, in the unit of that quantity;
    None where the scene allows none."""
    try:
        found = setup.vary({"sensors.bits": 16}).sensor.full_scale
    except SceneError:
        return None
    return None if found is None else found[1] - found[0]


def _spread(low: float, high: float) -> tuple[float, ...]:
    """Values evenly spread on a logarithmic scale, both ends included, in four digits."""
    count = max(1, round(math.log10(high / low) * _PLACES_A_DECADE))
    return tuple(float(f"{low * (high / low) ** (i / count):.4g}") for i in range(count + 1))


def _place(values: Sequence[float], own: float) -> int:
    """Place of the last value that is not beyond the scene's own."""
    return max(0, sum(value <= own for value in values) - 1)
