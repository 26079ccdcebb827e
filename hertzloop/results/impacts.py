"""Impacts cut out of a run's truth as they come, with their noise metrics.

The metrics of an impact reach as far as `plant.metrics.impact_kernels` says; they are summed over
pieces of at most `PIECE` steps, counted from the impact's start, so that neither how a run comes in
blocks nor what follows the impact counts.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hertzloop.loop.impact_end import impact_follower
from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import END, OVER
from hertzloop.plant.metrics.impacts import (
    Impact,
    ImpactPart,
    contacts,
    part_of,
    peak_force_n,
    peak_speed_m_s,
)
from hertzloop.plant.metrics.noise import ImpactNoise, impact_noise, published_noise, turned
from hertzloop.plant.plant import PlantSpec, modes_of
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import COLUMNS, F_A, F_C, F_C1, V_P, XI
from hertzloop.scene.setup import Setup

# Truth, shape (10, steps).
PIECE = 1 << 19  # steps; 32 MB of steps
_BEHIND = 2  # steps after an impact, in which the rebound is seen
Block = tuple[int, np.ndarray]  # first step, truth from there on, shape (10, steps)


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


def cut(
    blocks: Iterable[Block],
    touching: Callable[[np.ndarray], np.ndarray],
    opened: Callable[[int, np.ndarray | None], ImpactWindow],
) -> Iterator[ImpactMetrics]:
    """Impacts of a run from its truth in blocks; where steps are missing, it begins anew.

    `touching` makes of steps (10, steps) values that are zero where there is no contact; `opened`
    makes the window of an impact from its first step and the row before, shape (10, 1), None at
    the beginning.
    """
    window: ImpactWindow | None = None
    before: np.ndarray | None = None
    expected = 0
    for first, truth in blocks:
        if not truth.shape[1]:
            continue
        if first != expected:
            yield from _closed(window, None)
            window = before = None
        at, starts = 0, contacts(touching(truth))[0]
        if starts[:1] == [0] and before is not None and touching(before)[0]:
            del starts[0]
        for start in starts:
            if window:
                window.feed(truth[:, at:start])
                yield from _closed(window, truth[:, start : start + 1])
            window = opened(first + start, truth[:, start - 1 : start] if start else before)
            at = start
        if window:
            window.feed(truth[:, at:])
        before, expected = truth[:, -1:].copy(), first + truth.shape[1]
    yield from _closed(window, None)


def _closed(window: ImpactWindow | None, following: np.ndarray | None) -> Iterator[ImpactMetrics]:
    found = window.close(following) if window else None
    if found:
        yield found


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
        noise = impact_noise(
            self.spec,
            self.modes,
            np.asarray(self._drive),
            impact.plate_energy_j,
            self._speed_max,
            impact.duration_s,
            impact.impact_speed_m_s,
            impact.rebound_speed_m_s,
        )
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
        own = piece[:, : count + _BEHIND]
        parts = [self._before, own, following[:, : count + _BEHIND - own.shape[1]]]
        room = np.empty((COLUMNS, sum(part.shape[1] for part in parts)))
        truth = np.concatenate(parts, axis=1, out=room)
        part = part_of(
            spec, self.modes, truth, lead, count, continued, 0 if continued else self.start - lead
        )
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


_GREEN_STEPS = 1 << 17  # Green's functions of longer runs are sampled as far as a contact needs


def first_impact(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> ImpactMetrics | None:
    """The first of `impacts_of_truth`, to the bit, in a fraction of the time; None without one."""
    if not SCHEMES[setup.scheme].conserves:
        return next(_published(setup, [(0, truth)]), None)
    lasts = impact_follower(setup)
    start = impact_kernels.follow_steps(lasts, truth[F_C], truth[F_A], truth[XI])
    count = int(lasts.counts[END])
    if start < 0:
        return None
    if count > PIECE:
        return next(impacts_of_blocks(setup, [(0, truth)], modes), None)
    spec, lead = setup.plant, min(start, 1)
    modes = modes or modes_of(spec)
    truth = truth[:, start - lead : start + count + _BEHIND]
    part = part_of(spec, modes, truth, lead, count, first_step=start - lead)
    if not part.known:
        return None
    impact, end = part.impact(spec.step_s), lead + part.touching
    noise = impact_noise(
        spec,
        modes,
        part.drive,
        impact.plate_energy_j,
        part.speed_max_m_s,
        impact.duration_s,
        impact.impact_speed_m_s,
        impact.rebound_speed_m_s,
    )
    return ImpactMetrics(
        start,
        start + part.touching,
        start + count,
        truth[F_C, lead:end],
        end < truth.shape[1],
        impact,
        noise,
    )


def impacts_of_truth(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> list[ImpactMetrics]:
    """Impacts of a run from its truth, shape (10, steps).

    A contact that the run's end cuts off has the metrics of its part.
    """
    return list(impacts_of_blocks(setup, [(0, truth)], modes))


def impacts_of_blocks(
    setup: Setup, blocks: Iterable[Block], modes: Oscillators | None = None
) -> Iterator[ImpactMetrics]:
    """The same from steps that come in blocks, in the order of their steps; each impact as soon as
    the next one starts. Where steps are missing, a run ends and another begins. `modes`: those
    among which the energy is divided, if not all of the plate."""
    if not SCHEMES[setup.scheme].conserves:
        return _published(setup, blocks)
    spec = setup.plant

    def opened(start: int, before: np.ndarray | None) -> ImpactWindow:
        return ConsistentWindow(
            spec, modes or modes_of(spec), impact_follower(setup), start, before
        )

    return cut(blocks, lambda truth: truth[F_C], opened)


def through_first_contact(blocks: Iterable[Block]) -> np.ndarray:
    """Truth, shape (10, steps), from the start of a run without holes to some steps after
    its first contact."""
    taken = [np.zeros((COLUMNS, 0))]
    touched = over = False
    for _, truth in blocks:
        taken.append(truth)
        if over:
            break
        touched = touched or bool(np.any(truth[F_C]))
        over = touched and truth[F_C, -1] == 0.0
    return np.concatenate(taken, axis=1)


def _published(setup: Setup, blocks: Iterable[Block]) -> Iterator[ImpactMetrics]:
    speeds = [setup.plant.sphere.impact_speed_m_s]
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    return cut(
        blocks,
        lambda truth: (truth[XI] <= 0.0).astype(float),
        lambda start, _: _PublishedWindow(setup, speeds, start),
    )


class _PublishedWindow:
    """The study's metrics: over the samples of the contact and the first one after.

    The last of `speeds` is the impact speed; the next one is appended.
    """

    def __init__(self, setup: Setup, speeds: list[float], start: int) -> None:
        self.setup, self.speeds, self.start = setup, speeds, start
        self._parts: list[np.ndarray] = []
        self._ended = False

    def feed(self, truth: np.ndarray) -> None:
        """Keep what belongs to the contact."""
        if self._ended:
            return
        apart = np.flatnonzero(truth[XI] > 0.0)
        self._ended = bool(len(apart))
        self._parts.append(truth[[XI, F_A, F_C], : apart[0] + 1 if len(apart) else None])

    def close(self, following: np.ndarray | None) -> ImpactMetrics:
        """See ImpactWindow."""
        from hertzloop.plant.schemes.thesis2008 import relative_speed_m_s, sampled  # seldom: 1 ms

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
            spec.sphere,
            spec.simply_supported,
            modes,
            spec.contact_point_m,
            green_v,
            elastic,
            f_a,
            h,
            impact_speed_m_s=v0,
            relative_speed_m_s=relative_speed_m_s(xi, v0, h),
        )
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
        return ImpactMetrics(self.start, end, end, elastic[:touched], self._ended, impact, noise)
