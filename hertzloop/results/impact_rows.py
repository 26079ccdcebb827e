"""Impacts cut out of a run's rows of truth, with their noise figures."""

import math
from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np

from hertzloop.loop.compiled import answer_of
from hertzloop.results.impact_windows import (
    F_A,
    F_A1,
    F_C,
    F_C1,
    V_P,
    XI,
    XI_A,
    XI_P,
    XI_S,
    Block,
    ConsistentWindow,
    RowsOfImpact,
    Window,
    cut,
    impacts_in,
    modal_displacement,
    starting_speed,
)
from hertzloop.setup import Setup
from plant.contact.hertz import GRAVITY_M_S2
from plant.figures.impacts import Impact
from plant.figures.noise import published_noise
from plant.plant import PlantSpec, modes_of
from plant.schemes.registry import SCHEMES
from plant.schemes.thesis2008 import relative_speed_m_s, sampled
from plant.structures.modes import Oscillators
from plant.time_series import COLUMNS

__all__ = [
    "F_A", "F_A1", "F_C", "F_C1", "V_P", "XI", "XI_A", "XI_P", "XI_S", "Block", "RowsOfImpact",
    "consistent_impacts", "first_impact", "impacts_of_blocks", "impacts_of_rows",
    "modal_displacement", "modes_of", "starting_speed", "through_first_contact",
]  # fmt: skip

_GREEN_STEPS = 1 << 17  # Green's functions of longer runs are sampled as far as a contact needs


def first_impact(setup: Setup, rows: np.ndarray) -> RowsOfImpact | None:
    """First impact of a run; None without contact."""
    found = impacts_of_rows(setup, rows, most=1)
    return found[0] if found else None


def impacts_of_rows(
    setup: Setup, rows: np.ndarray, most: int | None = None, modes: Oscillators | None = None
) -> list[RowsOfImpact]:
    """Impacts of a run, at most `most`, from its rows of truth, shape (10, steps).

    A contact that the run's end cuts off has the figures of its part.
    """
    return list(islice(impacts_of_blocks(setup, [(0, rows)], modes), most))


def impacts_of_blocks(
    setup: Setup, blocks: Iterable[Block], modes: Oscillators | None = None
) -> Iterator[RowsOfImpact]:
    """The same from rows that come in blocks, in the order of their steps; each impact as soon as
    the next one starts. Where steps are missing, a run ends and another begins. `modes`: those
    among which the energy is divided, if not all of the plate."""
    if not SCHEMES[setup.scheme].conserves:
        return _published(setup, blocks)
    spec = setup.plant

    def opened(start: int, before: np.ndarray | None) -> Window:
        return ConsistentWindow(spec, modes or modes_of(spec), answer_of(setup), start, before)

    return cut(blocks, lambda rows: rows[F_C], opened)


def through_first_contact(blocks: Iterable[Block]) -> np.ndarray:
    """Rows of truth, shape (10, steps), from the start of a run without holes to some steps after
    its first contact."""
    taken = [np.zeros((COLUMNS, 0))]
    touched = over = False
    for _, rows in blocks:
        taken.append(rows)
        if over:
            break
        touched = touched or bool(np.any(rows[F_C]))
        over = touched and rows[F_C, -1] == 0.0
    return np.concatenate(taken, axis=1)


def consistent_impacts(
    setup: Setup, rows: np.ndarray, spec: PlantSpec | None = None
) -> list[Impact]:
    """Contact figures of every impact from the rows of truth alone, each to the start of the next
    one or the end of the rows; `spec` if the plant was another one than the scene's."""
    spec = spec or setup.plant
    return impacts_in(spec, rows, modal_displacement(spec, rows), starting_speed(spec, rows))


def _published(setup: Setup, blocks: Iterable[Block]) -> Iterator[RowsOfImpact]:
    speeds = [setup.plant.sphere.impact_speed_m_s]
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    return cut(
        blocks,
        lambda rows: (rows[XI] <= 0.0).astype(float),
        lambda start, _: _PublishedWindow(setup, speeds, start),
    )


class _PublishedWindow:
    """The study's figures: over the samples of the contact and the first one after.

    The last of `speeds` is the impact speed; the next one is appended.
    """

    def __init__(self, setup: Setup, speeds: list[float], start: int) -> None:
        self.setup, self.speeds, self.start = setup, speeds, start
        self._parts: list[np.ndarray] = []
        self._ended = False

    def feed(self, rows: np.ndarray) -> None:
        """Keep what belongs to the contact."""
        if self._ended:
            return
        apart = np.flatnonzero(rows[XI] > 0.0)
        self._ended = bool(len(apart))
        self._parts.append(rows[[XI, F_A, F_C], : apart[0] + 1 if len(apart) else None])

    def close(self, following: np.ndarray | None) -> RowsOfImpact:
        """See Window."""
        setup, v0 = self.setup, self.speeds[-1]
        spec, h = setup.plant, setup.step_s
        xi, f_a, f_c = np.concatenate(self._parts, axis=1)
        touched = len(xi) - self._ended
        known = setup.steps if setup.steps <= _GREEN_STEPS else len(xi)
        modes, (_, green_v, _) = sampled(
            spec.simply_supported, spec.contact_point_m, h, max(known, len(xi)) + 2
        )
        elastic = spec.contact.stiffness * np.maximum(-xi, 0.0) ** 1.5
        noise = published_noise(
            spec.sphere, spec.simply_supported, modes, spec.contact_point_m, green_v, elastic, f_a,
            h, impact_speed_m_s=v0, relative_speed_m_s=relative_speed_m_s(xi, v0, h),
        )  # fmt: skip
        impact = Impact(
            start_s=self.start * h,
            duration_s=noise.contact_time_s,
            impact_speed_m_s=v0,
            rebound_speed_m_s=noise.next_impact_speed_m_s,
            peak_force_n=float(f_c[:touched].max()),
            plate_energy_j=noise.transmitted_j,
            plate_speed_max_m_s=noise.plate_speed_max_m_s,
        )
        fall = 2.0 * GRAVITY_M_S2 * max(float(xi[-1]), 0.0)
        speed = noise.next_impact_speed_m_s  # of a loop that explodes its square may be infinite
        self.speeds.append(math.sqrt(speed * speed + fall))
        end = self.start + touched
        return RowsOfImpact(self.start, end, end, elastic[:touched], self._ended, impact, noise)
