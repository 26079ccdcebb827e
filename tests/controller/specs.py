"""Shipped laws with constants of a test's choice, a sample a second or whatever it asks for."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.controller.laws import (
    acceleration_feedback,
    fade_out,
    force_feedback,
    predicted,
    profile,
    slope_threshold,
)
from hertzloop.controller.laws._threshold import slope_weights
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.registry import find
from hertzloop.law import LawContext


@dataclass(frozen=True)
class LawSpec:
    """A shipped law and what its constants are made of; those it has not are ignored."""

    law: str
    stiffness: float
    kappa: float = 0.0
    v_thr_m_s: float = 0.0
    profile_n: tuple[float, ...] = ()
    contact_level: float = 0.0
    lead_samples: int = 0
    window: int = 2
    fade_samples: int = 0
    watch_level: float = 0.0
    mass_kg: float = math.inf
    impedance_n_s_m: float = math.inf
    gain: float = 0.0
    leak_hz: float = 0.0

    def constants(self, sample_s: float) -> Any:
        """What the law sees as `p`."""
        if self.law == "off":
            return find("off").constants(find("off").keys(), LawContext())
        kind = {
            "fade_out": fade_out,
            "predicted": predicted,
            "profile": profile,
            "constant": profile,
            "force_feedback": force_feedback,
            "acceleration_feedback": acceleration_feedback,
        }.get(self.law, slope_threshold)
        values = {
            **vars(self),
            "sample_s": sample_s,
            "slope_weights": slope_weights(self.window, sample_s),
            "profile": np.array(self.profile_n, dtype=float),
            "watch_level": max(self.watch_level, self.contact_level),
            "keep": math.exp(-2.0 * math.pi * self.leak_hz * sample_s),
        }
        constants: Any = kind.Constants
        return constants(**{name: values[name] for name in constants._fields})

    def bound(self, sample_s: float) -> BoundLaw:
        """The law for samples so far apart (s)."""
        return find(self.law).bound_to(self.constants(sample_s))
