"""The parameters of a fit: logarithms of the free keys, nuisances of every channel, priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hertzloop.fitting.fit.channel import Channel
from hertzloop.fitting.fit.free_keys import FreeKey
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator

SHIFT_UNIT_S = 1e-6  # unit of a shift among the parameters, s
_PHASE_SD = math.sqrt(1.0 / 12.0)  # standard deviation of a phase, uniform over a period


class NuisanceIndices(NamedTuple):
    """Places of the nuisances of a channel among the parameters; no phase without a law."""

    shift: int
    clock: int
    gain: int
    offset: int
    phase: int | None = None

    @property
    def all(self) -> list[int]:
        """Those that the channel has."""
        return [index for index in self if index is not None]


@dataclass(kw_only=True)
class FitParameters:
    """Keys and channels of a fit, and where their unknowns stand in the vector of parameters.

    Attributes:
        free: the free keys.
        channels: the records, made ready.
        simulators: of each channel; channels of one setup share one.
        fixed: keys that are held at a value.
    """

    free: Sequence[FreeKey]
    channels: Sequence[Channel]
    simulators: Sequence[ImpactSimulator]
    fixed: dict[str, float] = field(default_factory=dict)

    @property
    def varied_keys(self) -> list[FreeKey]:
        """The free keys that are not held at a value."""
        return [f for f in self.free if f.key not in self.fixed]

    @property
    def discrete_key(self) -> FreeKey | None:
        """The free key in whole steps, if there is one; it is held at a value all the time."""
        return next((f for f in self.free if f.resolution is not None), None)

    @property
    def nuisance_indices(self) -> list[NuisanceIndices]:
        """Places of the nuisances of every channel. Channels of one clock share shift, clock and
        phase."""
        known: dict[tuple[str, object], int] = {}
        found: list[NuisanceIndices] = []
        for index, (c, simulator) in enumerate(zip(self.channels, self.simulators, strict=True)):
            clock = c.record.clock or index
            of = {"shift": clock, "clock": clock, "gain": index, "offset": index}
            of |= {"phase": clock} if simulator.looped else {}
            keys = len(self.varied_keys)
            at = [known.setdefault(one, keys + len(known)) for one in of.items()]
            found.append(NuisanceIndices(*at))
        return found

    @property
    def phase_periods(self) -> dict[int, int]:
        """Where the phases stand, and the period of each in steps."""
        return {
            at.phase: simulator.phase_period
            for at, simulator in zip(self.nuisance_indices, self.simulators, strict=True)
            if at.phase is not None
        }

    def start_vector(self) -> np.ndarray:
        """Return the starting parameters."""
        indices = self.nuisance_indices
        found = np.zeros(max((max(at.all) for at in indices), default=-1) + 1)
        found[: len(self.varied_keys)] = [math.log(f.start) for f in self.varied_keys]
        for c, at in zip(self.channels, indices, strict=True):
            found[[at.gain, at.offset]] = c.gain, c.offset / c.peak
        return found

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and upper bounds of all parameters, (parameters,) each."""
        high = np.full(len(self.start_vector()), np.inf)
        low = -high
        for j, f in enumerate(self.varied_keys):
            low[j], high[j] = math.log(f.low), math.log(f.high)
        return low, high

    def key_values(self, x: np.ndarray) -> dict[str, float]:
        """Return the scene keys at parameters `x`."""
        found = dict(self.fixed)
        for f, value in zip(self.varied_keys, x, strict=False):
            found[f.key] = float(np.clip(math.exp(value), f.low, f.high))
        return found

    def nuisances(self, x: np.ndarray, index: int) -> tuple[float, float, float, float]:
        """Return touch (s), clock error (ppm), gain and offset of a channel."""
        c = self.channels[index]
        shift, ppm, gain, offset = (float(x[i]) for i in self.nuisance_indices[index][:4])
        return c.touch_s + shift * SHIFT_UNIT_S, ppm, gain, offset * c.peak

    def phase(self, x: np.ndarray, index: int) -> float:
        """Return the phase of a channel, in steps; without a law it has no effect."""
        at = self.nuisance_indices[index].phase
        return 0.5 if at is None else float(x[at])


class Prior(NamedTuple):
    """The prior of a parameter: its name, its place, its centre and its standard deviation."""

    name: str
    place: int
    centre: float
    sd: float


def priors(parameters: FitParameters, early: bool = False) -> list[Prior]:
    """Return the priors of keys, clocks and gains; channels of one clock share its prior.

    Args:
        parameters: of the fit.
        early: whether weak priors hold the keys near their start.
    """
    found = [
        Prior(f.key, j, math.log(f.start), f.prior or f.early_sd)
        for j, f in enumerate(parameters.varied_keys)
        if f.prior or early
    ]
    clocks: set[int] = set()
    for c, at in zip(parameters.channels, parameters.nuisance_indices, strict=True):
        gain_sd, clock_sd = c.prior_sds()
        if at.clock not in clocks:
            found.append(Prior(f"{c.record.name}: clock_ppm", at.clock, 0.0, clock_sd))
            clocks.add(at.clock)
        found.append(Prior(f"{c.record.name}: gain", at.gain, 1.0, gain_sd))
    return found


def prior_rows(
    parameters: FitParameters, x: np.ndarray, early: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of the priors and their derivatives, (rows,) and (rows, parameters)."""
    found = priors(parameters, early)
    for phase, period in parameters.phase_periods.items():
        # All phases are as likely, so nothing is pulled; but none is more than a period off.
        found.append(Prior("", phase, float(x[phase]), _PHASE_SD * period))
    by = np.zeros((len(found), len(x)))
    for line, prior in zip(by, found, strict=True):
        line[prior.place] = 1.0 / prior.sd
    return np.array([(x[p.place] - p.centre) / p.sd for p in found]), by


def prior_pulls(parameters: FitParameters, x: np.ndarray) -> dict[str, float]:
    """Return how far each prior is pulled, in standard deviations, by name."""
    return {p.name: (float(x[p.place]) - p.centre) / p.sd for p in priors(parameters)}
