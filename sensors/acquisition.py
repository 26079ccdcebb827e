"""Description of a data-acquisition channel with its analogue filters, and its compiled form."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from hertzloop.common import elementary_kernels
from hertzloop.common.changed_fields import changed_fields
from hertzloop.common.uncompiled import plain
from hertzloop.sensors import kernels as sensor_kernels
from hertzloop.sensors.kernels import ADDED, HELD, LIMITED, OF_SECTIONS

LOW_PASSES, HIGHEST_ORDER = ("butterworth", "bessel"), 8
NOISE_STREAM, _FAULT_STREAM = 1, 7  # random streams; the controller has others
_SIGMAS = 8.0  # no noise is larger
_FORGOTTEN = 37.0  # time constants after which a filter has forgotten its past, to rounding
_NEVER = 2**62  # a sample that no run has


_exp, _expm1 = plain(elementary_kernels.exp), plain(elementary_kernels.expm1)
_sine_and_cosine = plain(elementary_kernels.sine_and_cosine)


@dataclass(frozen=True)
class Filters:
    """Filters of a chain, in their order: resonance, high-pass, low-pass. None is no filter.

    `resonance_hz`, `resonance_damping`: natural frequency and damping (of critical) of the sensor's
    own second-order response. `ac_coupling_hz`: corner of a first-order high-pass, such as that of
    a charge amplifier. `low_pass_hz`: where the low-pass is 3 dB down; `low_pass`: its kind, of
    `LOW_PASSES`; `low_pass_order`: 1 to `HIGHEST_ORDER`.
    """

    resonance_hz: float | None = None
    resonance_damping: float = 0.02
    ac_coupling_hz: float | None = None
    low_pass_hz: float | None = None
    low_pass: str = "butterworth"
    low_pass_order: int = 1

    @property
    def ideal(self) -> bool:
        """Whether there is no filter at all."""
        return self.resonance_hz is self.ac_coupling_hz is self.low_pass_hz is None

    def low_pass_poles(self) -> tuple[complex, ...]:
        """Poles of the low-pass, 1/s; of each conjugate pair that in the upper half-plane."""
        if self.low_pass_hz is None:
            return ()
        return _poles(self.low_pass, self.low_pass_order, 2.0 * math.pi * self.low_pass_hz)

    def sections(self, step_s: float) -> np.ndarray:
        """Return the coefficients of `kernels.follow` for a step, shape (filters, 7)."""
        found = []
        if self.resonance_hz is not None:
            d = self.resonance_damping
            pole = complex(-d, math.sqrt(1.0 - d * d))
            found.append(_section(2.0 * math.pi * self.resonance_hz * pole, step_s))
        if self.ac_coupling_hz is not None:
            pole = complex(-2.0 * math.pi * self.ac_coupling_hz)
            found.append((*_section(pole, step_s)[:-1], 0.0))
        found += [_section(pole, step_s) for pole in self.low_pass_poles()]
        return np.array(found).reshape(-1, 7)

    def problems(self) -> Iterator[str]:
        """Sentences on what is wrong with the filters; comparisons are false for a nan."""
        for name in ("low_pass_hz", "ac_coupling_hz", "resonance_hz"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                yield f"{name} is {value:g}; must be above 0 Hz, or None for no filter"
        if not 0.0 < self.resonance_damping < 1.0:
            yield f"resonance_damping is {self.resonance_damping:g}; must be between 0 and 1"
        if self.low_pass not in LOW_PASSES:
            yield f"low_pass is {self.low_pass}; must be one of {', '.join(LOW_PASSES)}"
        if not 1 <= self.low_pass_order <= HIGHEST_ORDER:
            yield f"low_pass_order is {self.low_pass_order}; must be 1 to {HIGHEST_ORDER}"


def _poles(kind: str, order: int, omega: float) -> tuple[complex, ...]:
    return tuple(complex(omega * p.real, omega * p.imag) for p in _unit_poles(kind, order))


@lru_cache(maxsize=16)
def _unit_poles(kind: str, order: int) -> tuple[complex, ...]:
    """Poles of a low-pass with a corner of 1 rad/s; to 13 digits, since the last ones of SciPy's
    depend on the processor."""
    if order == 1:
        return (complex(-1.0),)
    if kind == "bessel":
        _, poles, _ = scipy.signal.bessel(order, 1.0, analog=True, output="zpk", norm="mag")
    else:
        _, poles, _ = scipy.signal.butter(order, 1.0, analog=True, output="zpk")
    known = [complex(round(p.real, 13), round(p.imag, 13)) for p in poles.tolist()]
    upper = [p for p in known if p.imag > 1e-9 * abs(p)]
    real = [complex(p.real) for p in known if abs(p.imag) <= 1e-9 * abs(p)]
    return (*real, *upper)


def _section(pole: complex, step_s: float) -> tuple[float, ...]:
    """Coefficients of one low-pass of unit static gain, with a real pole or a conjugate pair.

    With w = |pole| and d = -Re(pole)/w, output less input e = x - u and r = x'/w obey
    e' = w r - u', r' = -w (e + 2 d r), or e' = -w e - u' with a real pole. The step is exact for an
    input u that is linear over it.
    """
    w = abs(pole) * step_s
    if pole.imag == 0.0:
        return _exp(-w), 0.0, 0.0, 0.0, _expm1(-w) / w, 0.0, 1.0
    d, decay = -pole.real / abs(pole), _exp(pole.real * step_s)
    sin, cos = _sine_and_cosine(pole.imag * step_s)
    half = _sine_and_cosine(0.5 * pole.imag * step_s)[0]
    sine, cosine = decay * sin * abs(pole) / pole.imag, decay * cos
    # cosine + d sine - 1, whose terms of first order cancel.
    less = _expm1(-d * w) * cos - 2.0 * half * half + d * sine
    ramp = (2.0 * d * less - sine) / w, -less / w
    return cosine + d * sine, sine, -sine, cosine - d * sine, *ramp, 1.0


@dataclass(frozen=True)
class Fault:
    """A fault of a channel, of the samples from `start` on and `lasts` samples long (None: to the
    end of the run).

    `kind`: "stuck" repeats the reading before, and from the first sample on that sample's own;
    "offset" adds `size`; "spikes" adds `size` to samples with a `probability`; "drop_outs" repeats
    a reading for `lasts` samples (None: one), each sample beginning a burst with the
    `probability`; "saturation" limits readings to `size` either way. `size` is in the unit of the
    quantity.
    """

    kind: str
    start: int = 0
    lasts: int | None = None
    size: float = 0.0
    probability: float = 0.01

    @property
    def end(self) -> int:
        """The first sample after the fault; that of no run if it lasts to the end."""
        if self.lasts is None or self.kind == "drop_outs":
            return _NEVER
        return self.start + self.lasts


@dataclass(frozen=True)
class SensorSpec(Filters):
    """One channel, in SI units of its quantity: filters, then a converter.

    `of_state`: index of the quantity in the plant's state. `every_steps`: steps between samples.
    `full_scale`: lowest and highest value, or None for no limit. `bits`: 1 to 24, or None for an
    ideal converter. `noise_rms`: standard deviation of white noise per sample. Raises ValueError
    for values that no channel can have.
    """

    of_state: int = 0
    every_steps: int = 1
    full_scale: tuple[float, float] | None = None
    bits: int | None = None
    noise_rms: float = 0.0
    fault: Fault | None = None

    def __post_init__(self) -> None:
        for problem in _problems(self):
            raise ValueError(problem)

    @cached_property
    def converter_step(self) -> float:
        """Distance of two levels of the converter; zero of an ideal one."""
        if self.bits is None or self.full_scale is None:
            return 0.0
        return converter_step(self.bits, self.full_scale)

    @cached_property
    def low_pass_delay_s(self) -> float:
        """Group delay of the low-pass at low frequencies, s."""
        poles = self.low_pass_poles()
        return sum((-1.0 / p).real * (2.0 if p.imag else 1.0) for p in poles)


def _problems(spec: SensorSpec) -> Iterator[str]:
    """Sentences on what is wrong with a channel; comparisons are false for a nan."""
    if spec.every_steps < 1:
        yield f"every_steps is {spec.every_steps}; must be 1 or more"
    yield from spec.problems()
    if not 0.0 <= spec.noise_rms < math.inf:
        yield f"noise_rms is {spec.noise_rms:g}; must be 0 or more"
    low, high = spec.full_scale or (0.0, 1.0)
    if not -math.inf < low < high < math.inf:
        yield f"full_scale is {spec.full_scale}; must be the lowest, then the highest value"
    if spec.bits is not None:
        if not 1 <= spec.bits <= 24:
            yield f"bits is {spec.bits}; must be 1 to 24, or None for an ideal converter"
        if spec.full_scale is None:
            yield "a converter with bits needs a full_scale range"


def converter_step(bits: int, full_scale: tuple[float, float]) -> float:
    """Distance of two levels of a converter over `full_scale`."""
    low, high = full_scale
    return (high - low) / 2**bits


def converter_codes(bits: int, full_scale: tuple[float, float]) -> tuple[float, float, int, int]:
    """Scale, offset, first and last code of a converter over `full_scale`, in two's complement.

    Value = offset + scale * code. As in a real converter, the range has 2^bits steps and the
    highest level lies one step below its upper end: -10 to 10 V with 12 bits is -10 to 9.99512 V.
    If zero is in the range, it is a level, and the lowest level lies up to a step above the lower
    end.
    """
    low, high = full_scale
    levels, scale = 2**bits, converter_step(bits, full_scale)
    first = -(levels // 2)
    offset = low - scale * first
    if low <= 0.0 <= high:
        offset = scale * (max(math.ceil(low / scale), 1 - levels) - first)
    return scale, offset, first, first + levels - 1


# Fields of a channel whose part in the least sample `LeastSample` states. A field that is missing
# here makes the least sample unknown wherever a channel sets it.
STATED_FIELDS = frozenset(
    {
        "of_state",
        "every_steps",
        "low_pass_hz",
        "low_pass",
        "low_pass_order",
        "noise_rms",
        "fault",
        "full_scale",
        "bits",
    }
)
# Fields of a channel that leave a linear loop linear, noise and a fine converter apart. `margin`
# refuses a channel that sets another one.
LINEAR_FIELDS = frozenset(
    {
        "of_state",
        "every_steps",
        "low_pass_hz",
        "low_pass",
        "low_pass_order",
        "ac_coupling_hz",
        "resonance_hz",
        "resonance_damping",
        "noise_rms",
        "full_scale",
        "bits",
    }
)
# Fields of a channel that make no steps in a smooth quantity. Where a channel sets another one, an
# infinite plate expects a force with steps.
SMOOTH_FIELDS = frozenset(
    {
        "of_state",
        "low_pass_hz",
        "low_pass",
        "low_pass_order",
        "ac_coupling_hz",
        "resonance_hz",
        "resonance_damping",
        "full_scale",
    }
)


@dataclass(frozen=True)
class LeastSample:
    """What `kernels.least_sample` needs to know of a channel.

    The quantity stays above a value, and a low-pass with overshoot shows the share `gap_share` of
    that value at least, once it has forgotten what was before, after `settling_s`. A resonance, or
    a high-pass, may show any value: the share is -inf. `largest_noise`: in units of the quantity.
    Faults of `fault_kind` end before sample `fault_end`. Range and converter need nothing here.
    """

    gap_share: float
    settling_s: float
    largest_noise: float
    fault_kind: int
    fault_end: int

    @classmethod
    def of(cls, spec: SensorSpec) -> "LeastSample":
        """What a channel can show at least."""
        known = not changed_fields(spec, but=STATED_FIELDS)
        share, settling_s = 1.0, 0.0
        if spec.low_pass_hz is not None and spec.low_pass_order > 1:
            share, settling = _share_and_settling(spec.low_pass, spec.low_pass_order)
            settling_s = settling / (2.0 * math.pi * spec.low_pass_hz)
        kind, end = 0, 0
        if spec.fault is not None:
            kind, end = _KINDS[spec.fault.kind], spec.fault.end
        return cls(share if known else -math.inf, settling_s, _SIGMAS * spec.noise_rms, kind, end)


@lru_cache(maxsize=16)
def _share_and_settling(kind: str, order: int) -> tuple[float, float]:
    """Return the share of a low-pass with a corner of 1 rad/s, and its settling time, s.

    Output = integral of g u, with g the impulse response, whose integral is 1, and its negative
    part n. The input u is at least L now, and never below half of what it was before. So wherever g
    is negative, twice as large a positive part that is more recent makes up for it (the running
    integral of max(g, 0) - 2 n is positive), and the rest is 1 - integral of n: output >= L times
    that.
    """
    upper = np.array(_poles(kind, order, 1.0))
    poles = np.concatenate([upper, upper[upper.imag > 0.0].conj()])
    apart = poles[:, None] - poles
    np.fill_diagonal(apart, 1.0)
    residues = np.prod(-poles) / np.prod(apart, axis=1)
    settling = _FORGOTTEN / float(np.min(-poles.real))
    width = settling / 20_000
    times = width * (np.arange(20_000) + 0.5)
    response = width * np.sum(residues[:, None] * np.exp(np.outer(poles, times)), axis=0).real
    negative = np.maximum(-response, 0.0)
    paired = np.cumsum(np.maximum(response, 0.0) - 2.0 * negative)
    share = 0.999 - float(np.sum(negative))  # the sum has an error of 1e-5
    return (share if paired.min() > -1e-9 else -math.inf), settling


class Sensor:
    """Compiled form of a channel for a run of `steps` steps."""

    def __init__(self, spec: SensorSpec, step_s: float, steps: int, seed: int) -> None:
        self.spec = spec
        samples = -(-steps // spec.every_steps)
        noise = np.empty(0)
        if spec.noise_rms > 0.0:
            generator = np.random.Generator(np.random.Philox(key=[seed, NOISE_STREAM]))
            noise = spec.noise_rms * generator.standard_normal(samples)
        fault = np.empty(0, np.int64)
        if spec.fault is not None:
            fault = _faulty(spec.fault, samples, seed)
        low, high = spec.full_scale or (0.0, 0.0)
        scale, offset, first, last = 1.0, 0.0, 0, 0
        if spec.bits is not None:
            scale, offset, first, last = converter_codes(spec.bits, (low, high))
        least = LeastSample.of(spec)
        self.model = sensor_kernels.SensorModel(
            of_state=spec.of_state,
            every_steps=spec.every_steps,
            sections=spec.sections(step_s),
            ideal=spec.bits is None,
            limited=spec.full_scale is not None,
            low=low,
            high=high,
            scale=scale,
            offset=offset,
            first_code=first,
            last_code=last,
            noise=noise,
            fault=fault,
            fault_size=0.0 if spec.fault is None else spec.fault.size,
            gap_share=least.gap_share,
            settling_steps=math.ceil(least.settling_s / step_s),
            largest_noise=least.largest_noise,
            fault_kind=least.fault_kind,
            fault_end=least.fault_end,
        )
        self.state = np.zeros(OF_SECTIONS + 3 * len(self.model.sections))


_KINDS = {
    "stuck": HELD,
    "drop_outs": HELD,
    "offset": ADDED,
    "spikes": ADDED,
    "saturation": LIMITED,
}


def _faulty(fault: Fault, samples: int, seed: int) -> np.ndarray:
    """What is wrong with each sample: a function of seed and number alone."""
    found = np.zeros(samples, np.int64)
    bursts = fault.kind == "drop_outs"
    wrong = np.zeros(samples, np.bool_)
    wrong[fault.start : fault.end] = True
    if fault.kind in ("spikes", "drop_outs"):
        generator = np.random.Generator(np.random.Philox(key=[seed, _FAULT_STREAM]))
        wrong &= generator.random(samples) < fault.probability
    if bursts and fault.lasts:
        for first in np.flatnonzero(wrong):
            wrong[first : first + fault.lasts] = True
    found[wrong] = _KINDS[fault.kind]
    return found
