"""Metrics of the first impact or of the whole run, and their change in dB."""

import math
from dataclasses import dataclass, fields

from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.results.impacts import ImpactMetrics
from hertzloop.results.metric_fields import described, fields_of, metric


@described
@dataclass(frozen=True)
class SpanMetrics:
    """Metrics of the first impact, or of the whole run.

    `plant.metrics.impact_kernels` defines the first impact. The whole run lasts from the first
    touch to its end. Radiated energies are nan unless the structure is a simply supported plate.
    """

    # fmt: off
    contacts: int = metric("number of contacts", "contacts", difference=True)
    contact_time_s: float = metric("duration of the first contact, s", "contact time", "us", 1e6)
    impact_speed_m_s: float = metric("speed of the sphere before the first contact, m/s",
                                     "impact speed", "m/s")
    rebound_speed_m_s: float = metric("speed of the sphere after the last contact, m/s",
                                      "rebound speed", "m/s", difference=True)
    rebound_height_m: float = metric("height of a sphere after the last contact, by energy, m",
                                     "rebound height", "mm", 1e3, less_is_better=True)
    peak_force_n: float = metric("largest contact force, N", "peak contact force", "N",
                                 less_is_better=True)
    plate_energy_j: float = metric("work of contact force and actuator force on the plate, J",
                                   "plate energy", "uJ", 1e6, db=10.0, less_is_better=True)
    plate_speed_max_m_s: float = metric("largest plate speed at the contact point, m/s",
                                        "largest plate speed", "m/s", db=20.0,
                                        less_is_better=True)
    radiated_j: float = metric("radiated energy by the study, sum of sigma E up to 20 kHz, J",
                               "radiated energy to 20 kHz", "uJ", 1e6, db=10.0,
                               less_is_better=True)
    sound_j: float = metric("energy that the plate radiates until rest, up to 20 kHz, J",
                            "sound energy to 20 kHz, eq. 3.12", "uJ", 1e6, db=10.0)
    longhorn_j: float = metric("acceleration noise energy (Longhorn 1952), J",
                               "acceleration noise, Longhorn", "uJ", 1e6, db=10.0)
    holmes_j: float = metric("acceleration noise energy (Holmes 1974), J",
                             "acceleration noise, Holmes", "uJ", 1e6, db=10.0)
    peak_pressure_pa: float = metric("bound of the sound pressure at 1 m, Pa",
                                     "pressure bound at 1 m", "Pa", db=20.0,
                                     less_is_better=True)


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

SPAN_METRICS = fields_of(SpanMetrics)

# Factor of the logarithm of a ratio: of energies, and of amplitudes.
DECIBELS = {name: row.db for name, row in SPAN_METRICS.items() if row.db}

_SHARED = {f.name for f in fields(ImpactNoise)} & {*SPAN_METRICS}


def of_impact(found: ImpactMetrics) -> SpanMetrics:
    """Metrics of one impact."""
    return span_metrics(1, found.impact.peak_force_n, found.noise)


def span_metrics(contacts: int, peak_force_n: float, noise: ImpactNoise) -> SpanMetrics:
    return SpanMetrics(
        contacts=contacts,
        rebound_speed_m_s=noise.next_impact_speed_m_s,
        peak_force_n=peak_force_n,
        plate_energy_j=noise.transmitted_j,
        **{name: value for name, value in vars(noise).items() if name in _SHARED},
    )


def decibels(value: float, reference: float, factor: float = 10.0) -> float:
    """`factor` times lg of a ratio; nan where it has no logarithm."""
    ratio = value / reference if reference else math.nan
    return factor * math.log10(ratio) if ratio > 0.0 else math.nan


def changes_db(value: SpanMetrics, reference: SpanMetrics) -> dict[str, float]:
    """By how many dB energies (10 lg) and amplitudes (20 lg) differ, by the metrics' names."""
    ours, theirs = vars(value), vars(reference)
    return {name: decibels(ours[name], theirs[name], by) for name, by in DECIBELS.items()}


def change_db(
    value: float,
    reference: float,
    factor: float = 10.0,
    error: float = 0.0,
    reference_error: float = 0.0,
) -> tuple[float, float]:
    """A ratio in dB, nan where there is none, and its error by those of both numbers."""
    change = decibels(value, reference, factor)
    if math.isnan(change):
        return math.nan, math.nan
    wrong = error / abs(value) + reference_error / abs(reference)
    return change, factor / math.log(10.0) * wrong
