"""Metrics of the first impact or of the whole run, and their change in dB."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal, NamedTuple

from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.plant.plant import PlantSpec
from hertzloop.results.facts import (
    Fact,
    Level,
    described,
    exact,
    fact,
    facts_of,
    of_height,
    of_speed,
)
from hertzloop.results.impacts import ImpactMetrics

BRIEF, DETAILS = Level.BRIEF, Level.DETAILS


@described
@dataclass(frozen=True)
class SpanMetrics:
    """Metrics of the first impact, or of the whole run.

    `plant.metrics.impact_kernels` defines the first impact. The whole run lasts from the first
    touch to its end. Radiated energies are nan unless the structure is a simply supported plate.
    """

    # fmt: off
    contact_time_s: float = fact("duration of the first contact, s", "contact time", "s",
                                 level=BRIEF, impacts="first")
    peak_force_n: float = fact("largest contact force, N", "peak contact force", "N",
                               of=lambda span: max(one.peak_force_n for one in span.impacts),
                               level=BRIEF, impacts="largest", less_is_better=True)
    impact_speed_m_s: float = fact("speed of the sphere before the first contact, m/s",
                                   "impact speed", "m/s", level=DETAILS, error=exact,
                                   impacts="first")
    rebound_speed_m_s: float = fact("speed of the sphere after the last contact, m/s",
                                    "rebound speed", "m/s",
                                    of=attrgetter("noise.next_impact_speed_m_s"), level=BRIEF,
                                    error=of_speed, impacts="last", difference=True)
    rebound_height_m: float = fact("height of a sphere after the last contact, by energy, m",
                                   "rebound height", "m", level=BRIEF, error=of_height,
                                   impacts="last", less_is_better=True)
    plate_energy_j: float = fact("work of contact force and actuator force on the plate, J",
                                 "plate energy", "J", 10.0, of=attrgetter("noise.transmitted_j"),
                                 level=BRIEF, whole_run=BRIEF, less_is_better=True)
    radiated_j: float = fact("radiated energy by the study, sum of sigma E up to 20 kHz, J",
                             "radiated energy to 20 kHz", "J", 10.0, level=BRIEF,
                             less_is_better=True)
    plate_speed_max_m_s: float = fact("largest plate speed at the contact point, m/s",
                                      "largest plate speed", "m/s", 20.0, level=BRIEF,
                                      impacts="largest", less_is_better=True)
    peak_pressure_pa: float = fact("bound of the sound pressure at 1 m, Pa",
                                   "pressure bound at 1 m", "Pa", 20.0, level=BRIEF,
                                   impacts="largest", less_is_better=True)
    sound_j: float = fact("energy that the plate radiates until rest, up to 20 kHz, J",
                          "sound energy to 20 kHz, eq. 3.12", "J", 10.0, level=DETAILS)
    longhorn_j: float = fact("acceleration noise energy (Longhorn 1952), J",
                             "acceleration noise, Longhorn", "J", 10.0, level=DETAILS,
                             impacts="last")
    holmes_j: float = fact("acceleration noise energy (Holmes 1974), J",
                           "acceleration noise, Holmes", "J", 10.0, level=DETAILS,
                           impacts="first")
    contacts: int = fact("number of contacts", "contacts", of=lambda span: len(span.impacts),
                         whole_run=BRIEF, error=exact, difference=True)
    # fmt: on


@dataclass(frozen=True)
class RunMetrics:
    """Metrics of a run.

    Attributes:
        first_impact: metrics of the first impact; None without a contact.
        whole_run: metrics of all contacts; None without a contact and for the published scheme.
    """

    first_impact: SpanMetrics | None
    whole_run: SpanMetrics | None


MUCH_DB = 0.5  # between the change in the first impact and that over all contacts

SPAN_FACTS = facts_of(SpanMetrics)
# Of the noise of the first impact alone.
_NOISE_FACTS = {
    name: Fact("", label, "J", 10.0, level=DETAILS)
    for name, label in {
        "transmitted_spectrum_j": "plate energy, by spectrum",
        "radiated_maidanik_j": "radiated energy to 20 kHz, eq. 3.13",
        "sound_maidanik_j": "sound energy to 20 kHz, eq. 3.13",
    }.items()
}
SpanName = Literal["first_impact", "whole_run"]
FACTS: dict[SpanName, dict[str, Fact]] = {
    "first_impact": SPAN_FACTS | _NOISE_FACTS,
    "whole_run": SPAN_FACTS,
}

_TAKEN = [one.of or attrgetter(f"noise.{name}") for name, one in SPAN_FACTS.items()]


Values = dict[str, float]
ValuesBySpan = dict[SpanName, Values]


def by_span(
    first: SpanMetrics | None, noise: ImpactNoise | None, whole: SpanMetrics | None
) -> ValuesBySpan:
    """Return the metrics of a run by span and name; `noise`: of the first impact."""
    found, sound, run = (vars(one) if one else {} for one in (first, noise, whole))
    return {"first_impact": sound | found, "whole_run": run}


def values_of(impacts: Sequence[Impact], noise: Sequence[ImpactNoise] = ()) -> list[Values]:
    """Return the metrics of impacts by name; where both kinds have one, that of the noise, which
    is over the whole impact and not over its contact alone."""
    sounds = map(vars, noise) if noise else [{}] * len(impacts)
    return [vars(impact) | sound for impact, sound in zip(impacts, sounds, strict=True)]


class SpanParts(NamedTuple):
    """What the metrics of a span are computed from: the plant, the impacts of the span, and its
    noise metrics."""

    spec: PlantSpec
    impacts: Sequence[Impact]
    noise: ImpactNoise


def of_impact(spec: PlantSpec, found: ImpactMetrics) -> SpanMetrics:
    """Metrics of one impact."""
    return span_metrics(SpanParts(spec, [found.impact], found.noise))


def span_metrics(parts: SpanParts) -> SpanMetrics:
    """Metrics of a span: by the row of each, or the noise metric of its name."""
    return SpanMetrics(*(take(parts) for take in _TAKEN))


def decibels(value: float, reference: float, factor: float = 10.0) -> float:
    """`factor` times lg of a ratio; nan where it has no logarithm."""
    ratio = value / reference if reference else math.nan
    return factor * math.log10(ratio) if ratio > 0.0 else math.nan
