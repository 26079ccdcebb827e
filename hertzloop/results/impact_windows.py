"""The steps of one impact as they come, and its metrics.

The metrics of an impact reach as far as `plant.metrics.impact_kernels` says; they are summed over
pieces of at most `PIECE` steps, counted from the impact's start, so that neither how a run comes in
blocks nor what follows the impact counts.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import END, OVER
from hertzloop.plant.metrics.impacts import (
    Impact,
    ImpactPart,
    noise_inputs,
    part_of,
    peak_force_n,
    peak_speed_m_s,
)
from hertzloop.plant.metrics.noise import ImpactNoise, impact_noise, turned
from hertzloop.plant.metrics.truth_kernels import ImpactSteps
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import COLUMNS, F_A, F_C, F_C1, V_P, XI

PIECE = 1 << 19  # steps; 32 MB of steps
BEHIND = 2  # steps after an impact, in which the rebound is seen


@dataclass(frozen=True)
class ImpactMetrics:
    """One impact: first step in contact, first step after it, first step after the impact, contact
    force until `end` (N, its elastic part in the published scheme), whether the contact ended
    within the run, and metrics; those of the published scheme are the study's: contact time by
    samples, plate energy as summed."""

    start: int
    end: int
    over: int
    contact_n: np.ndarray
    ended: bool
    impact: Impact
    noise: ImpactNoise


class ImpactWindow(Protocol):
    """Takes the steps from the start of one impact to that of the next; its metrics are of as many
    of them as belong to the impact."""

    def feed(self, truth: np.ndarray) -> None:
        """The steps that follow, shape (10, steps)."""

    def close(self, following: np.ndarray | None) -> ImpactMetrics | None:
        """Its metrics, with the first row of the next impact, shape (10, 1), or None at the end of
        the run; None if there is too little of it."""


class ConsistentWindow:
    """Metrics of one impact of a consistent scheme, from its start until it is over."""

    def __init__(
        self,
        spec: PlantSpec,
        modes: Oscillators,
        lasts: impact_kernels.ImpactFollower,
        start: int,
        before: np.ndarray | None,
    ) -> None:
        self.spec, self.modes, self.start, self._lasts = spec, modes, start, lasts
        self._before = np.zeros((COLUMNS, 0)) if before is None else before
        self._parts: list[np.ndarray] = []
        self._held = self._done = 0
        self._impact: Impact | None = None
        self._contact_n: list[np.ndarray] = []
        self._peak, self._fastest = _Highest(3), _Highest(1)
        self._ended = False
        self._drive: np.ndarray | float = 0.0
        # The largest speed of the plate until now, and since the last step that belongs here.
        self._speed_max = self._silent_max = 0.0

    def feed(self, truth: np.ndarray) -> None:
        """The steps that follow, shape (10, steps)."""
        self._parts.append(truth)
        self._held += truth.shape[1]
        while self._held > PIECE + 2:  # never leave less than a step with both its ends
            truth = _joined(self._parts)
            # The rebound is seen in the step after a contact: it must be in the same piece.
            ends_here = truth[F_C, PIECE - 1] != 0.0 and truth[F_C, PIECE] == 0.0
            count = PIECE + int(ends_here)
            self._take(truth[:, :count], truth[:, count : count + 1])
            self._parts, self._held = [truth[:, count:]], truth.shape[1] - count

    def close(self, following: np.ndarray | None) -> ImpactMetrics | None:
        """See ImpactWindow."""
        last = _joined(self._parts)
        self._take(last, np.zeros((COLUMNS, 0)) if following is None else following)
        impact = self._impact
        if impact is None:
            return None
        contact_n = _joined(self._contact_n)
        if len(self._contact_n) > 1:
            impact = replace(
                impact,
                peak_force_n=peak_force_n(*self._peak.around),
                plate_speed_max_m_s=peak_speed_m_s(self._fastest.around[0]),
            )
        given = noise_inputs(impact, np.asarray(self._drive), self._speed_max)
        noise = impact_noise(self.spec, self.modes, given)
        end, over = self.start + len(contact_n), self.start + int(self._lasts.counts[END])
        return ImpactMetrics(self.start, end, over, contact_n, self._ended, impact, noise)

    def _take(self, piece: np.ndarray, following: np.ndarray) -> None:
        """Add a piece, shape (10, steps), and the row behind it, if there is one."""
        impact_kernels.follow_steps(self._lasts, piece[F_C], piece[F_A], piece[XI])
        count = max(int(self._lasts.counts[END]) - self._done, 0)
        if count:
            self._add(piece, following, count)
        if not self._lasts.counts[OVER]:
            self._silent_max = max(
                self._silent_max, float(np.abs(piece[V_P, count:]).max(initial=0.0))
            )
        self._before = piece[:, -1:].copy()
        self._done += piece.shape[1]

    def _add(self, piece: np.ndarray, following: np.ndarray, count: int) -> None:
        """Add the first steps of a piece, as many as belong to the impact."""
        spec, lead, continued = self.spec, self._before.shape[1], self._done > 0
        own = piece[:, : count + BEHIND]
        parts = [self._before, own, following[:, : count + BEHIND - own.shape[1]]]
        room = np.empty((COLUMNS, sum(part.shape[1] for part in parts)))
        truth = np.concatenate(parts, axis=1, out=room)
        first_step = 0 if continued else self.start - lead
        part = part_of(spec, self.modes, truth, ImpactSteps(lead, count, continued, first_step))
        if continued:
            self._continue(part, float(part.work_j[lead:].sum()))
        elif part.known:
            self._impact = part.impact(spec.step_s)
        if not self._ended:
            self._ended = part.touching < piece.shape[1]
            touched = piece[:, : part.touching]
            self._contact_n.append(touched[F_C].copy())
            self._peak.follow(touched[F_C], touched[[F_C, F_C1]])
            # The speed to the step after the contact.
            speed = piece[V_P, : part.touching + 1]
            self._fastest.follow(np.abs(speed), speed[np.newaxis])
        self._drive = self._drive + turned(self.modes, part.drive, self._done * spec.step_s)
        self._speed_max = max(self._speed_max, self._silent_max, part.speed_max_m_s)
        self._silent_max = 0.0

    def _continue(self, part: ImpactPart, work_j: float) -> None:
        """Carry the impact on over further steps, which take `work_j` in all, J."""
        impact = self._impact
        if impact is None:
            return
        if self._ended or not part.touching:
            self._impact = replace(impact, plate_energy_j=impact.plate_energy_j + work_j)
            return
        more = part.impact(self.spec.step_s)
        self._impact = Impact(
            start_s=impact.start_s,
            duration_s=impact.duration_s + more.duration_s,
            impact_speed_m_s=impact.impact_speed_m_s,
            rebound_speed_m_s=more.rebound_speed_m_s,
            peak_force_n=max(impact.peak_force_n, more.peak_force_n),
            plate_energy_j=impact.plate_energy_j + more.plate_energy_j,
            plate_speed_max_m_s=max(impact.plate_speed_max_m_s, more.plate_speed_max_m_s),
        )


class _Highest:
    """The columns around the largest value of a series that comes in parts: `beside` to each
    side."""

    def __init__(self, beside: int) -> None:
        self._beside, self._most, self._at, self._done = beside, -math.inf, -1, 0
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self.around = np.zeros((2, 0))

    def follow(self, value: np.ndarray, columns: np.ndarray) -> None:
        """Take the next values, shape (steps,), and their columns, shape (columns, steps)."""
        kept = 0
        if self._last is not None:
            kept = self._last[0].size
            value = np.concatenate([self._last[0], value])
            columns = np.concatenate([self._last[1], columns], axis=1)
        at = int(np.argmax(value)) if value.size else 0
        place = self._done - kept + at
        # A larger one, or the one from before with what had not come behind it.
        cut = place == self._at and place >= self._done - self._beside
        if value.size and (value[at] > self._most or cut or np.isnan(value[at])):
            self._most, self._at = float(value[at]), place
            low = max(at - self._beside, 0)
            self.around = columns[:, low : at + self._beside + 1].copy()
        self._done += value.size - kept
        tail = 2 * self._beside
        self._last = value[-tail:].copy(), columns[:, -tail:].copy()


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Parts that follow each other along the last axis, as one array; one part as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=-1)
