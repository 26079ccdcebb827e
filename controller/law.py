"""What a law file needs: the base of its scene keys, what is known of the run, modes of a law.

See docs/how-to/laws.md; `hertzloop law new mine.py` writes a commented start.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from hertzloop.jit import kernel as compiled

IDLE, WATCHING, ACTING, SPENT = range(4)  # `s.mode` of a law; `bus/events.py` names them
NO_PROMISE = math.inf  # a quiet level that no sample stays above
WHOLE_STEPS = "whole steps"  # marks a key that has to be a whole number of steps

# A time (us) that has to be a whole number of steps.
StepsUs = Annotated[float, Field(ge=0.0, le=1e6), WHOLE_STEPS]
Gain = Annotated[float, Field(ge=-100.0, le=100.0)]
Force = Annotated[float, Field(ge=-1e6, le=1e6)]  # N, far beyond what a laboratory has


def kernel(function: Callable[..., Any]) -> Any:
    """Marks a function that a law's functions call: they are compiled, and so it has to be.

    It is kept on disk as part of these only, which go by the digest of the law and all it
    imports. As a call it would count references to the samples; as part of them it costs nothing.
    """
    code = getattr(function, "__code__", None)
    calls_itself = code is not None and code.co_name in code.co_names
    return compiled(function, inline=True, kept=False, spliced=not calls_itself)


class LawError(ValueError):
    """There is no such law, or it cannot run; the sentence names the key and the remedy."""


class Keys(BaseModel):
    """Base of a law's scene keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _nothing() -> np.ndarray:
    return np.empty(0)


@dataclass(frozen=True)
class About:
    """What is known of a run before it starts; SI units.

    `horizon_steps`: from a sample to its force; `converter_step`: of the samples, 0 if they are
    not quantised; `limit_n`: the actuator's largest force, `yield_depth_m`: the
    penetration at which the contact begins to yield. `impedance_n_s_m` is nan where what is
    struck is no plate: a law whose constants follow from it is refused then.
    `uncontrolled_force_n`, shape (steps in contact,), is the contact force of the first impact
    without control (it simulates that).
    """

    step_ns: int = 1000
    every_steps: int = 1
    horizon_steps: int = 1
    stiffness: float = 1.0  # of the contact, N/m^1.5
    sphere_mass_kg: float = math.inf
    impact_speed_m_s: float = 0.0
    impedance_n_s_m: float = math.inf  # of the plate at the struck point, as if infinite
    rigid_contact_s: float = 0.0  # on a rigid plate
    rigid_peak_n: float = 0.0
    converter_step: float = 0.0
    limit_n: float = math.inf
    yield_depth_m: float = math.inf
    uncontrolled_force_n: Callable[[], np.ndarray] = field(default=_nothing, compare=False)

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.step_ns * 1e-9

    @property
    def sample_s(self) -> float:
        """Time from one sample to the next, s."""
        return self.every_steps * self.step_s

    @property
    def horizon_s(self) -> float:
        """Time from a sample to the first step on which its force acts, s."""
        return self.horizon_steps * self.step_s

    def samples(self, time_us: float) -> int:
        """A time in samples."""
        return round(round(time_us * 1000 / self.step_ns) / self.every_steps)


@dataclass(frozen=True)
class Reach:
    """How far a law's force can go: at most `force_n` (N), or `share` of the contact's own force;
    `copies`: it follows that force as smoothly as it is itself."""

    force_n: float = math.inf
    share: float = math.inf
    copies: bool = False
