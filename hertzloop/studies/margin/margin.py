"""The margin of a scene's sampled loop in flight: stability, growth, latency limit, gain margin."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.setup.setup import Setup
from hertzloop.studies.margin.identify import LawFilter, NotLinearError, law_filter
from hertzloop.studies.margin.linear import PoleForm, plant_in_flight
from hertzloop.studies.margin.sums import Sums
from hertzloop.studies.margin.table import Table, cubic, make_table, root_between

_SCANNED = 1 << 16  # largest latency, steps, that is looked at for the limit
_WINDOWS = 2000  # latencies, steps, up to which stable windows are listed
_NEWTON = 60
_DENSE = 1600  # states up to which eigenvalues are computed, about 5 s
_SUBDIVIDED = 9  # places in an interval where a cubic shows how close L comes to -1
_CANDIDATES = 200  # intervals that are searched for the peak of the sensitivity
_NOTHING = 1e-300  # in place of a gain of zero, which has no logarithm
_GOLDEN = 0.3819660112501051


@dataclass(frozen=True)
class Margin:
    """What linear theory says about a loop. None where a number does not exist.

    Attributes:
        applicable: whether the loop is linear; `reason` says why not, or is empty.
        stable: at the scene's latency.
        unstable_poles: closed-loop poles outside the unit circle there.
        growth_per_s: fastest growth of an unstable pole, 1/s; 0 if stable, None if undecided.
        e_folds: growth times the length of the run.
        latency_limit_steps: largest latency up to which the loop is stable at every latency from 0
            on; -1 if at none, None without limit.
        latency_limit_us: where stability ends between two steps, us; -1 and None as above.
        stable_windows_us: stable stretches of latency, (first, last), us; the last may be None.
        gain_margin: factor on the gain at which stability ends; None without limit.
        peak_sensitivity: largest |1/(1 + L)|; None if unstable.
        disk_margin: 1/max|S - 1/2|; None if unstable.
        binding_frequency_hz: where the loop becomes unstable at the limit, or grows fastest, Hz.
    """

    applicable: bool
    reason: str
    stable: bool | None = None
    unstable_poles: int | None = None
    growth_per_s: float | None = None
    growth_frequency_hz: float | None = None
    e_folds: float | None = None
    latency_us: float | None = None
    latency_limit_steps: int | None = None
    latency_limit_us: float | None = None
    stable_windows_us: list[list[float | None]] | None = None
    gain_margin: float | None = None
    peak_sensitivity: float | None = None
    disk_margin: float | None = None
    binding_frequency_hz: float | None = None
    modes: int | None = None
    step_ns: int | None = None


@dataclass(frozen=True)
class Loop:
    """The loop gain of one remainder of the latency by the sampling interval."""

    sums: Sums
    law: LawFilter
    table: Table

    @property
    def plant(self) -> PoleForm:
        """The plant from sample to sample."""
        return self.sums.form

    def log_gain(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return log L without the whole samples of delay, and its slope by the angle."""
        return log_gain(self.sums, self.law, theta)

    def log_delayed(self, theta: np.ndarray, delay: int) -> tuple[np.ndarray, np.ndarray]:
        """Return log L with so many samples of delay, and its slope by the angle."""
        value, slope = self.log_gain(theta)
        return value - 1j * delay * theta, slope - 1j * delay


def log_gain(sums: Sums, law: LawFilter, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return log L of a loop without delay, and its slope by the angle; shapes of `theta`."""
    value, steep = sums.at(theta)
    z = np.exp(1j * theta)
    control, turn = law.at(z), law.slope(z)
    gain = -control * value
    # The response of a real system is real at both ends, and no rounding may say otherwise.
    gain = np.where((theta == 0.0) | (theta == math.pi), gain.real, gain)
    gain = np.where(gain == 0.0, _NOTHING, gain)
    with np.errstate(all="ignore"):
        slope = 1j * (steep / value + turn / control)
    return np.log(gain.astype(complex)), np.where(np.isfinite(slope), slope, 0.0)


def loop_of(plant: PoleForm, law: LawFilter, every: int, remainder: int) -> Loop:
    """Return the loop and its table for a remainder of steps, 0 to `every` - 1."""
    sums = Sums(plant.held(every, remainder))
    own = law.poles[law.poles.imag >= -1e-14]
    poles = np.concatenate([sums.form.poles, own])
    table = make_table(lambda theta: log_gain(sums, law, theta), poles)
    return Loop(sums, law, table)


@dataclass(frozen=True)
class Loops:
    """The loops of all remainders of the latency; `fixed`: steps that a command takes without
    latency, the unavoidable one and an actuator's dead time."""

    each: tuple[Loop, ...]
    fixed: int

    def split(self, latency: int) -> tuple[Loop, int]:
        """Return the loop at a latency (steps), and its whole samples of delay."""
        whole, rest = divmod(latency + self.fixed, len(self.each))
        return self.each[rest], whole

    def unstable(self, latency: np.ndarray) -> np.ndarray:
        """Return the number of unstable poles at latencies (steps), same shape."""
        whole, rest = np.divmod(np.asarray(latency) + self.fixed, len(self.each))
        found = np.empty(len(whole), int)
        for r, loop in enumerate(self.each):
            found[rest == r] = loop.table.unstable(whole[rest == r])
        return found

    def limit(self) -> int | None:
        """Return the largest latency (steps) up to which all are stable; None without."""
        if not any(loop.table.arcs or loop.table.outside for loop in self.each):
            return None
        first, size = 0, 256
        while first < _SCANNED:
            bad = np.flatnonzero(self.unstable(np.arange(first, first + size)))
            if len(bad):
                return first + int(bad[0]) - 1
            first += size
            size *= 2
        return None

    def between(self, latency: int, back: bool = False) -> tuple[float, float]:
        """Return where stability ends between `latency` and the next (or the one before, `back`),
        in steps, and the angle at which it does."""
        table = self.each[0].table
        angles, phases = _ends(table)
        if not len(angles):
            return float(latency), math.pi
        low = latency - 1 if back else latency
        # A crossing lies where phase - D angle is an odd multiple of pi.
        first = np.ceil((phases - (low + 1 + self.fixed) * angles + math.pi) / (2.0 * math.pi))
        last = np.floor((phases - (low + self.fixed) * angles + math.pi) / (2.0 * math.pi))
        found = []
        for i in np.flatnonzero(last >= first):
            for turn in np.arange(first[i], last[i] + 1):
                d = (phases[i] + math.pi - 2.0 * math.pi * turn) / angles[i] - self.fixed
                found.append((float(d), float(angles[i])))
        if not found:
            return float(latency), math.pi
        found.sort(reverse=back)
        for d, angle in found:
            beyond = d - 1e-9 if back else d + 1e-9
            if table.unstable(np.array([beyond + self.fixed]))[0] > 0:
                return d, angle
        return found[-1]

    def windows(self, limit: int | None) -> list[list[float | None]]:
        """Return all stable stretches of latency, first and last, steps."""
        if limit is None:
            return [[0.0, None]]
        stable = self.unstable(np.arange(max(_WINDOWS, 2 * limit + 200))) == 0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], stable.astype(int), [0]])))
        found: list[list[float | None]] = []
        for first, end in edges.reshape(-1, 2):
            low, high = float(first), float(end - 1)
            if len(self.each) == 1:
                low = 0.0 if first == 0 else self.between(int(first), back=True)[0]
                high = self.between(int(end - 1))[0]
            found.append([low, high])
        return found


def why_no_loop(setup: Setup) -> str:
    """Return why a setup has no linear loop in flight, as far as its keys say; else ""."""
    if not setup.has_law:
        return "the scene has no law, so there is no loop"
    if setup.scheme != "modal":
        return f"run.scheme = '{setup.scheme}' has no linear model; use 'modal'"
    if setup.quantity == "contact_force":
        return "the contact force is zero in flight, so the loop is closed in contact only"
    return ""


def loops_of(setup: Setup) -> Loops:
    """Return the loops of a setup in flight.

    Raises:
        NotLinearError: the law, or the line behind it, is not linear.
        SceneError: the plant has no linear response.
    """
    law, every = law_filter(setup), setup.every_steps
    plant = plant_in_flight(setup)
    each = tuple(loop_of(plant, law, every, r) for r in range(every))
    return Loops(each, 1 + setup.line.dead_steps)


def margin_of(setup: Setup) -> Margin:
    """Return the margin of a setup's loop in flight. Raises SceneError for an invalid scene."""
    reason = why_no_loop(setup)
    if reason:
        return Margin(False, reason)
    try:
        loops = loops_of(setup)
    except NotLinearError as error:
        return Margin(False, f"no margin: not a linear loop ({error})")
    return margin_from(setup, loops)


def margin_from(setup: Setup, loops: Loops) -> Margin:
    """Return the margin of a setup from its loops."""
    step_us, sample_s = 1e6 * setup.step_s, setup.every_steps * setup.step_s
    latency = setup.line.latency_steps
    count = int(loops.unstable(np.array([latency]))[0])
    loop, delay = loops.split(latency)
    limit = loops.limit()
    growth, at_hz = 0.0 if count == 0 else None, None
    if count:
        poles = unstable_poles(loop, delay, count)
        if counted(poles) == count:
            fastest = poles[int(np.argmax(np.abs(poles)))]
            growth = math.log(abs(fastest)) / sample_s
            at_hz = abs(float(np.angle(fastest))) / (2.0 * math.pi * sample_s)
    limit_us: float | None
    if limit is None or limit < 0:
        limit_us = None if limit is None else -1.0
        binding = at_hz
    elif setup.every_steps == 1:
        d, angle = loops.between(limit)
        limit_us, binding = d * step_us, angle / (2.0 * math.pi * sample_s)
    else:
        beyond, late = loops.split(limit + 1)
        there = unstable_poles(beyond, late, int(loops.unstable(np.array([limit + 1]))[0]))
        limit_us, binding = limit * step_us, None
        if len(there):
            fastest = there[int(np.argmax(np.abs(there)))]
            binding = abs(float(np.angle(fastest))) / (2.0 * math.pi * sample_s)
    peak, disk = _sensitivity(loop, delay) if count == 0 else (None, None)
    windows = [[None if x is None else x * step_us for x in w] for w in loops.windows(limit)]
    return Margin(
        applicable=True, reason="", stable=count == 0, unstable_poles=count, growth_per_s=growth,
        growth_frequency_hz=at_hz,
        e_folds=None if growth is None else growth * setup.duration_s, latency_us=latency * step_us,
        latency_limit_steps=limit, latency_limit_us=limit_us, stable_windows_us=windows,
        gain_margin=_gain_margin(loop, delay), peak_sensitivity=peak, disk_margin=disk,
        binding_frequency_hz=binding, modes=len(loop.plant.poles), step_ns=setup.step_ns,
    )  # fmt: skip


def counted(poles: np.ndarray) -> int:
    """Return how many poles these are with the conjugates of those that are not real."""
    return sum(1 if abs(p.imag) < 1e-12 else 2 for p in poles)


def _ends(table: Table) -> tuple[np.ndarray, np.ndarray]:
    angles, phases = [], []
    for arc in table.arcs:
        for angle, phase in ((arc.start, arc.phase_start), (arc.end, arc.phase_end)):
            if 0.0 < angle < math.pi:
                angles.append(angle)
                phases.append(phase)
    return np.array(angles), np.array(phases)


def _delayed_grid(loop: Loop, delay: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles with log L and its slope, both with a delay, close enough to follow its phase."""
    t = loop.table
    theta, value, slope = t.theta, t.log_gain, t.slope
    if math.pi / 400.0 * delay > 0.5:  # the delay alone turns faster than the grid follows
        more = np.setdiff1d(np.linspace(0.0, math.pi, 8 * delay), theta)
        found, steep = loop.log_gain(more)
        theta = np.concatenate([theta, more])
        order = np.argsort(theta, kind="stable")
        theta = theta[order]
        value = np.concatenate([value, found])[order]
        slope = np.concatenate([slope, steep])[order]
    return theta, value - 1j * delay * theta, slope - 1j * delay


def _phase_crossings(loop: Loop, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles where L with its delay is real and negative, and |L| there."""
    theta, value, _ = _delayed_grid(loop, delay)
    side = np.sin(value.imag) > 0.0
    # Only near the negative axis: there the angle from it is small on both sides.
    change = np.flatnonzero(
        (side[1:] != side[:-1]) & (np.cos(value.imag[1:]) + np.cos(value.imag[:-1]) < 0.0)
    )

    def from_axis(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, steep = loop.log_delayed(x, delay)
        return np.remainder(found.imag, 2.0 * math.pi) - math.pi, steep.imag

    # Above the axis the phase is below pi: the function is negative there.
    at = root_between(from_axis, theta[change], theta[change + 1], side[change])
    at = np.concatenate([[0.0], at, [math.pi]])
    there = loop.log_delayed(at, delay)[0]
    negative = np.cos(there.imag) < -0.5
    return at[negative], np.exp(there.real[negative])


def _gain_margin(loop: Loop, delay: int) -> float | None:
    """Factor up to which every smaller gain is stable too; None without limit."""
    if loop.table.outside:
        return None
    size = _phase_crossings(loop, delay)[1]
    return 1.0 / float(size.max()) if len(size) and size.max() > 0.0 else None


def unstable_poles(loop: Loop, delay: int, count: int) -> np.ndarray:
    """Return closed-loop poles outside the unit circle in the upper half plane.

    Newton's method starts from every place where L passes the negative axis beyond -1. Where it
    finds another number than `count`, all poles follow as eigenvalues, up to 1600 states. Compare
    `counted` with `count`: some poles may be missing.
    """
    angle, size = _phase_crossings(loop, delay)
    found = _newton(loop, delay, 1j * angle[size > 1.0])
    if counted(found) != count:
        found = _dense_poles(loop, delay)
        found = found[found.imag >= -1e-13]
    return found


def _newton(loop: Loop, delay: int, s: np.ndarray) -> np.ndarray:
    if not len(s):
        return np.empty(0, complex)
    plant, law = loop.plant, loop.law
    value, open_ = np.full(len(s), np.inf, complex), np.arange(len(s))
    for _ in range(_NEWTON):
        z = np.exp(s[open_])
        at, steep = plant.with_slope(z)
        control, turn = law.at(z), law.slope(z)
        with np.errstate(all="ignore"):
            value[open_] = np.log(control * at * np.exp(-delay * s[open_]))
            change = value[open_] / (steep / at + turn / control - delay)
        limit = 0.3 * np.maximum(np.abs(s[open_].real), 1e-3)
        change *= np.minimum(1.0, limit / np.maximum(np.abs(change), 1e-300))
        change = np.where(np.isfinite(change), change, 0.0)
        s[open_] -= change
        open_ = open_[np.abs(change) > 1e-13]
        if not len(open_):
            break
    s = s[(np.abs(value) < 1e-6) & (s.real > 0.0)]
    s = np.where(s.imag < 0.0, s.conj(), s)
    kept: list[complex] = []
    for one in s[np.argsort(-s.real)]:
        if all(abs(one - other) > 1e-9 for other in kept):
            kept.append(complex(one))
    return np.exp(np.array(kept, complex))


def _dense_poles(loop: Loop, delay: int) -> np.ndarray:
    """Return all closed-loop poles outside the unit circle as eigenvalues; none if too many."""
    plant, law = loop.plant, loop.law
    p = np.concatenate([plant.poles, plant.poles.conj()])
    residues = np.concatenate([plant.residues, plant.residues.conj()])
    n, m, late = len(p), len(law.poles), delay + 2
    total = n + m + late
    if total > _DENSE:
        return np.empty(0, complex)
    # State: plant, law, commands of the last `late` samples, the newest first.
    a = np.zeros((total, total), complex)
    a[np.arange(n), np.arange(n)] = p
    first = n + m
    a[:n, first + delay - 1 if delay else first] = residues
    seen = np.zeros(total, complex)
    seen[:n] = 1.0
    seen[first + delay] += plant.fir[0]
    seen[first + delay + 1] += plant.fir[1]
    a[n : n + m] = law.residues[:, None] * seen
    a[np.arange(n, n + m), np.arange(n, n + m)] += law.poles
    command = law.direct * seen
    command[n : n + m] += 1.0
    if not delay:
        a[:n] = residues[:, None] * command
        a[np.arange(n), np.arange(n)] += p
    a[first] = command
    a[np.arange(first + 1, total), np.arange(first, total - 1)] = 1.0
    found = np.linalg.eigvals(a)
    return np.asarray(found[np.abs(found) > 1.0 + 1e-13])


def _sensitivity(loop: Loop, delay: int) -> tuple[float, float]:
    """Largest |S| and 1/max|S - 1/2|. Cubics through log L show where L comes closest to -1, and
    these intervals are searched."""
    theta, value, slope = _delayed_grid(loop, delay)
    h, expected = np.diff(theta), 0.5 * np.diff(theta) * (slope[:-1] + slope[1:]).imag
    turn = np.remainder(np.diff(value.imag) - expected + math.pi, 2 * math.pi) - math.pi
    change = np.diff(value.real) + 1j * (expected + turn)
    part = np.linspace(0.0, 1.0, _SUBDIVIDED)[:, None]
    course = value[:-1] + cubic(part, h, change, slope[:-1], slope[1:])

    def both(log_l: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            s = 1.0 / (1.0 + np.exp(log_l))
        return np.stack([np.abs(s), np.abs(s - 0.5)])

    best = both(course)
    found = []
    for kind in (0, 1):
        place = best[kind].argmax(axis=0)
        which = np.argsort(-best[kind].max(axis=0))[:_CANDIDATES]
        step = h[which] / (_SUBDIVIDED - 1)
        low = np.maximum(theta[which] + (place[which] - 1) * step, 0.0)
        high = np.minimum(theta[which] + (place[which] + 1) * step, math.pi)
        a, b = low + _GOLDEN * (high - low), high - _GOLDEN * (high - low)
        for _ in range(45):
            left = (
                both(loop.log_delayed(a, delay)[0])[kind]
                > both(loop.log_delayed(b, delay)[0])[kind]
            )
            low, high = np.where(left, low, a), np.where(left, b, high)
            a, b = low + _GOLDEN * (high - low), high - _GOLDEN * (high - low)
        ends = both(value)[kind].max()
        found.append(max(float(both(loop.log_delayed(a, delay)[0])[kind].max()), float(ends)))
    return found[0], 1.0 / found[1]
