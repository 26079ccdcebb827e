"""Description of a data-acquisition channel with its analogue filters, and its compiled form."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from hertzloop.sensors import kernels as sensor_kernels
from hertzloop.sensors.kernels import ADDED, HELD, LIMITED, OF_SECTIONS

LOW_PASSES, HIGHEST_ORDER = ("butterworth", "bessel"), 8
NOISE_STREAM, _FAULT_STREAM = 1, 7  # random streams; the controller has others


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


@lru_cache(maxsize=64)
def _poles(kind: str, order: int, omega: float) -> tuple[complex, ...]:
    if order == 1:
        return (complex(-omega),)
    if kind == "bessel":
        _, poles, _ = scipy.signal.bessel(order, omega, analog=True, output="zpk", norm="mag")
    else:
        _, poles, _ = scipy.signal.butter(order, omega, analog=True, output="zpk")
    upper = [complex(p) for p in poles if p.imag > 1e-9 * abs(p)]
    real = [complex(p.real) for p in poles if abs(p.imag) <= 1e-9 * abs(p)]
    return (*real, *upper)


def _section(pole: complex, step_s: float) -> tuple[float, ...]:
    """Coefficients of one low-pass of unit static gain, with a real pole or a conjugate pair.

    With w = |pole| and d = -Re(pole)/w, output less input e = x - u and r = x'/w obey
    e' = w r - u', r' = -w (e + 2 d r), or e' = -w e - u' with a real pole. The step is exact for an
    input u that is linear over it.
    """
    w = abs(pole) * step_s
    if pole.imag == 0.0:
        return math.exp(-w), 0.0, 0.0, 0.0, math.expm1(-w) / w, 0.0, 1.0
    d, decay = -pole.real / abs(pole), math.exp(pole.real * step_s)
    turn = pole.imag * step_s
    sine = decay * math.sin(turn) * abs(pole) / pole.imag
    cosine = decay * math.cos(turn)
    # cosine + d sine - 1, whose terms of first order cancel.
    less = math.expm1(-d * w) * math.cos(turn) - 2.0 * math.sin(0.5 * turn) ** 2 + d * sine
    ramp = (2.0 * d * less - sine) / w, -less / w
    return cosine + d * sine, sine, -sine, cosine - d * sine, *ramp, 1.0


@dataclass(frozen=True)
class Fault:
    """A fault of a channel, of the samples from `start` on and `lasts` samples long (None: to the
    end of the run).

    `kind`: "stuck" repeats the reading before; "offset" adds `size`; "spikes" adds `size` to
    samples with a `probability`; "drop_outs" repeats a reading for `lasts` samples (None: one),
    each sample beginning a burst with the `probability`; "saturation" limits readings to `size`
    either way. `size` is in the unit of the quantity.
    """

    kind: str
    start: int = 0
    lasts: int | None = None
    size: float = 0.0
    probability: float = 0.01


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
    end = samples if fault.lasts is None or bursts else fault.start + fault.lasts
    wrong = np.zeros(samples, np.bool_)
    wrong[fault.start : end] = True
    if fault.kind in ("spikes", "drop_outs"):
        generator = np.random.Generator(np.random.Philox(key=[seed, _FAULT_STREAM]))
        wrong &= generator.random(samples) < fault.probability
    if bursts and fault.lasts:
        for first in np.flatnonzero(wrong):
            wrong[first : first + fault.lasts] = True
    found[wrong] = _KINDS[fault.kind]
    return found
