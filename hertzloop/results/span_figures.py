"""Figures of the first impact or of the whole run, and their change in dB."""

import math
from dataclasses import dataclass, fields

from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.results.figure_rows import described, figure, rows_of
from hertzloop.results.impacts import RowsOfImpact


@described
@dataclass(frozen=True)
class SpanFigures:
    """Figures of the first impact, or of the whole run.

    `plant.figures.rows_kernels` defines the first impact. The whole run lasts from the first touch
    to its end. Radiated energies are nan unless the structure is a simply supported plate.
    """

    # fmt: off
    contacts: int = figure("number of contacts", "contacts")
    contact_time_s: float = figure("duration of the first contact, s",
                                   "contact time, first contact", "us", 1e6)
    impact_speed_m_s: float = figure("speed of the striker before the first contact, m/s",
                                     "impact speed", "m/s")
    rebound_speed_m_s: float = figure("speed of the striker after the last contact, m/s",
                                      "rebound speed", "m/s")
    rebound_height_m: float = figure("height of a sphere after the last contact, by energy, m",
                                     "rebound height", "mm", 1e3)
    peak_force_n: float = figure("largest contact force, N", "peak force", "N", db=20.0)
    plate_energy_j: float = figure("work of contact force and actuator force on the plate, J",
                                   "plate energy", "uJ", 1e6, db=10.0)
    plate_speed_max_m_s: float = figure("largest plate speed at the contact point, m/s",
                                        "largest plate speed", "m/s", db=20.0)
    radiated_j: float = figure("figure of the study, sum of sigma E up to 20 kHz, J",
                               "sigma E to 20 kHz, eq. 3.12 (study)", "uJ", 1e6, db=10.0)
    sound_j: float = figure("energy that the plate radiates up to 20 kHz, J",
                            "radiated to 20 kHz, eq. 3.12", "uJ", 1e6, db=10.0)
    longhorn_j: float = figure("acceleration noise energy (Longhorn 1952), J",
                               "acceleration noise, Longhorn", "uJ", 1e6, db=10.0)
    holmes_j: float = figure("acceleration noise energy (Holmes 1974), J",
                             "acceleration noise, Holmes", "uJ", 1e6, db=10.0)
    peak_pressure_pa: float = figure("bound of the sound pressure at 1 m, Pa",
                                     "peak pressure bound at 1 m", "Pa", db=20.0)


@dataclass(frozen=True)
class RunFigures:
    """Figures of a run.

    Attributes:
        first_impact: figures of the first impact; None without a contact.
        whole_run: figures of all contacts; None without a contact and for the published scheme.
    """

    first_impact: SpanFigures | None
    whole_run: SpanFigures | None


MUCH_DB = 0.5  # between the change in the first impact and that over all contacts

SPAN_ROWS = rows_of(SpanFigures)

# Factor of the logarithm of a ratio: of energies, and of amplitudes.
DECIBELS = {name: row.db for name, row in SPAN_ROWS.items() if row.db}

_SHARED = {f.name for f in fields(ImpactNoise)} & {*SPAN_ROWS}


def of_impact(found: RowsOfImpact) -> SpanFigures:
    """Figures of one impact."""
    return span_figures(1, found.impact.peak_force_n, found.noise)


def span_figures(contacts: int, peak_force_n: float, noise: ImpactNoise) -> SpanFigures:
    return SpanFigures(
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


def changes_db(value: SpanFigures, reference: SpanFigures) -> dict[str, float]:
    """By how many dB energies (10 lg) and amplitudes (20 lg) differ, by the figures' names."""
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
