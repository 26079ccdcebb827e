"""What a law file needs: the base of its scene keys, what is known of the run, modes of a law.

See docs/how-to/laws.md; `hertzloop law new mine.py` writes a commented start.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from hertzloop.common.errors import SceneError
from hertzloop.common.jit import kernel as compiled_function
from hertzloop.common.number_fields import refuse_no_numbers

IDLE, WATCHING, ACTING, SPENT = range(4)  # `s.mode` of a law; `bus/events.py` names them
NO_TRIGGER = math.inf  # a quiet level that no sample stays above
WHOLE_STEPS = "whole steps"  # marks a key that has to be a whole number of steps

# A time (us) that has to be a whole number of steps.
StepsUs = Annotated[float, Field(ge=0.0, le=1e6), WHOLE_STEPS]
Gain = Annotated[float, Field(ge=-100.0, le=100.0)]
Force = Annotated[float, Field(ge=-1e6, le=1e6)]  # N, far beyond what a laboratory has


def kernel(function: Callable[..., Any]) -> Any:
    """Mark a helper function that the functions of a law call, so that Numba compiles it.

    It becomes part of its callers, whose kept code goes by the digest of the law and of all files
    that it imports.

    Args:
        function: a function of numbers and arrays.

    Returns:
        The compiled function.
    """
    return compiled_function(function, inline=True, allocates=True, checked=True)


class LawError(SceneError):
    """There is no such law, or it cannot run; the sentence names the key and the remedy."""


class Keys(BaseModel):
    """Base class of the scene keys of a law: one pydantic field per key, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    _numbers = field_validator("*", mode="wrap")(refuse_no_numbers)


def _nothing() -> np.ndarray:
    return np.empty(0)


@dataclass(frozen=True)
class LawContext:
    """Facts on a run that a law may use before the run starts.

    Attributes:
        step_ns: length of a step, ns.
        every_steps: steps from one sample to the next.
        loop_delay_steps: steps from a sample to the first step on which its force acts.
        stiffness: contact stiffness s, N/m^1.5.
        sphere_mass_kg: mass of the sphere, kg.
        impact_speed_m_s: speed of the sphere at the first touch, m/s.
        impedance_n_s_m: impedance of an infinite plate at the contact point, N s/m; nan, and a law
            that uses it is refused, if the structure is not a plate.
        rigid_contact_s: contact time on a rigid plate, s.
        rigid_peak_n: peak contact force on a rigid plate, N.
        converter_step: step of the converter, in the unit of the samples; 0 for an ideal one.
        limit_n: largest force of the actuator, N.
        yield_depth_m: penetration at which the contact begins to yield, m.
        uncontrolled_force_n: function that returns the contact force of the first impact without
            control, N, shape (steps in contact,).
    """

    step_ns: int = 1000
    every_steps: int = 1
    loop_delay_steps: int = 1
    stiffness: float = 1.0
    sphere_mass_kg: float = math.inf
    impact_speed_m_s: float = 0.0
    impedance_n_s_m: float = math.inf
    rigid_contact_s: float = 0.0
    rigid_peak_n: float = 0.0
    converter_step: float = 0.0
    limit_n: float = math.inf
    yield_depth_m: float = math.inf
    uncontrolled_force_n: Callable[[], np.ndarray] = field(default=_nothing, compare=False)

    @cached_property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.step_ns * 1e-9

    @cached_property
    def sample_s(self) -> float:
        """Time from one sample to the next, s."""
        return self.every_steps * self.step_s

    @cached_property
    def loop_delay_s(self) -> float:
        """Time from a sample to the first step on which its force acts, s."""
        return self.loop_delay_steps * self.step_s

    def samples(self, time_us: float) -> int:
        """Return a time (us) in samples, rounded to whole steps."""
        return round(round(time_us * 1000 / self.step_ns) / self.every_steps)


@dataclass(frozen=True)
class Response:
    """Transfer function of a linear law, from a sample to the command of that sample.

    It is `gain` + sum of residues/(z - pole), or `gain` times the product of `stages`.

    Attributes:
        gain: N per unit of the samples.
        poles: distinct, both of each conjugate pair.
        residues: of these.
        stages: numerator and denominator of each, coefficients of 1, 1/z, 1/z^2, ...
    """

    gain: float
    poles: tuple[complex, ...] = ()
    residues: tuple[complex, ...] = ()
    stages: tuple[tuple[np.ndarray, np.ndarray], ...] = ()


@dataclass(frozen=True)
class ForceBound:
    """Bound of the force of a law, which may allow a cheaper plate model.

    Attributes:
        force_n: largest force, N.
        share: largest force over the contact force.
        copies: whether the force is as smooth as the contact force.
    """

    force_n: float = math.inf
    share: float = math.inf
    copies: bool = False
