"""Analogue filters of a measuring chain: their poles, and what a step makes of their state."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

LOW_PASSES, HIGHEST_ORDER = ("butterworth", "bessel"), 8


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

    @property
    def low_pass_delay_s(self) -> float:
        """Group delay of the low-pass at low frequencies, s."""
        return sum((-1.0 / p).real * (2.0 if p.imag else 1.0) for p in self.low_pass_poles())

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
