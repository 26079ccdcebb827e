"""Description of a data-acquisition channel, and its compiled form."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hertzloop.sensors import kernels as sensor_k
from hertzloop.sensors.filters import Filters

NOISE_STREAM, _FAULT_STREAM = 1, 7  # random streams; the controller has others


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
    converter_step: float = field(init=False, repr=False, compare=False)
    """distance of two levels of the converter; zero of an ideal one"""

    def __post_init__(self) -> None:
        for problem in _problems(self):
            raise ValueError(problem)
        step = 0.0
        if self.bits is not None and self.full_scale is not None:
            step = (self.full_scale[1] - self.full_scale[0]) / (2**self.bits - 1)
        object.__setattr__(self, "converter_step", step)


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


def converter_codes(bits: int, full_scale: tuple[float, float]) -> tuple[float, float, int, int]:
    """Scale, offset, first and last code of a mid-tread converter over `full_scale`.

    2^bits levels, both ends of the range included, so no value in range is further than
    half a step from its level. Value = offset + scale * code; codes are centred on zero.
    """
    low, high = full_scale
    levels = 2**bits
    scale = (high - low) / (levels - 1)
    first = -(levels // 2)
    return scale, low - scale * first, first, first + levels - 1


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
        self.model = sensor_k.SensorModel(
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
        self.state = np.zeros(sensor_k.OF_SECTIONS + 3 * len(self.model.sections))


_KINDS = {
    "stuck": sensor_k.HELD, "drop_outs": sensor_k.HELD, "offset": sensor_k.ADDED,
    "spikes": sensor_k.ADDED, "saturation": sensor_k.LIMITED,
}  # fmt: skip


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
