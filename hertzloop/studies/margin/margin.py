"""The margin of a scene's sampled loop in flight: stability, growth, latency limit, gain margin."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.plant.schemes.registry import SCHEMES, supporting
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, resolve
from hertzloop.studies.margin.identify import INSIDE, LawFilter, NotLinearError, law_filter
from hertzloop.studies.margin.linear import PoleForm, plant_in_flight
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import NyquistTable, make_table

_SCANNED = 1 << 16  # largest latency, steps, that is looked at for the limit
_WINDOWS = 2000  # latencies, steps, up to which stable windows are listed
_NEWTON = 60
_MOST_STATES = 6000  # up to which all closed-loop poles are computed, in a second or less
_NO_GAIN = 1e-4  # a gain margin below it depends on the damping that `damped` adds
_ON_CIRCLE = 1e-13  # distance from the unit circle that is rounding


@dataclass(frozen=True)
class Margin:
    """What linear theory says about a loop. None where a number does not exist.

    Attributes:
        applicable: whether the loop is linear; `reason` says why not, or is empty.
        stable: at the scene's latency; None if it could not be decided.
        unstable_poles: closed-loop poles outside the unit circle there; None as above.
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

    @property
    def growth(self) -> "Growth":
        """How the loop grows at the latency of the scene."""
        return Growth(
            self.unstable_poles, self.growth_per_s, self.growth_frequency_hz, self.e_folds
        )


@dataclass(frozen=True)
class Loop:
    """The loop gain of one remainder of the latency by the sampling interval."""

    plant: PoleForm
    law: LawFilter
    table: NyquistTable

    def gain(self, z: np.ndarray) -> np.ndarray:
        """Return L without the whole samples of delay at complex `z`."""
        return -self.law.at(z) * self.plant.at(z)


def loop_of(plant: PoleForm, law: LawFilter, every: int, remainder: int) -> Loop:
    """Return the loop and its table for a remainder of steps, 0 to `every` - 1."""
    held = plant.held(every, remainder)
    return Loop(held, law, make_table(held, law))


@dataclass(frozen=True)
class PolyphaseLoop:
    """The linear loop of a setup in flight: one `Loop` for each remainder of the latency by the
    sampling interval."""

    plant: PoleForm
    every: tuple[Loop, ...]
    lead: int  # steps from a sample to its force at latency 0: one, and dead time

    def at(self, latency: int) -> tuple[Loop, int]:
        """Return the loop for a latency in steps, and its delay in samples."""
        delay, rest = divmod(latency + self.lead, len(self.every))
        return self.every[rest], delay

    def unstable(self, latency: np.ndarray) -> np.ndarray:
        """Return the number of closed-loop poles outside the unit circle, by latency in steps."""
        whole, rest = np.divmod(np.asarray(latency) + self.lead, len(self.every))
        found = np.empty(len(whole), int)
        for r, loop in enumerate(self.every):
            found[rest == r] = loop.table.unstable(whole[rest == r])
        return found


@dataclass(frozen=True)
class Growth:
    """How the loop of a setup grows in flight at the latency of its scene.

    Attributes:
        unstable_poles: closed-loop poles outside the unit circle; None if two methods disagree.
        per_s: fastest growth, 1/s; 0 if stable, None if undecided.
        frequency_hz: of the fastest growing pole, Hz; None if stable or undecided.
        e_folds: growth times the length of the run; None if undecided.
    """

    unstable_poles: int | None
    per_s: float | None
    frequency_hz: float | None
    e_folds: float | None


def growth_of(setup: Setup) -> Growth | None:
    """Return how the loop grows in flight; None for a setup without a linear loop, or for which
    none can be formed; undecided where the numbers fail. It follows a run or a sweep, and must not
    cost their results.

    Setups that differ in nothing that the loop depends on share one calculation, and those that
    differ in the latency alone share its largest part.
    """
    if why_no_loop(setup):
        return None
    try:
        found = _growth(_of_loop(setup), _digest(setup))
    except SceneError:
        return None
    except (ArithmeticError, np.linalg.LinAlgError):
        return Growth(None, None, None, None)
    if isinstance(found, NotLinearError):
        return None
    if found.per_s is None:
        return found
    return replace(found, e_folds=found.per_s * setup.duration_s)


def stable_in_flight(setup: Setup) -> bool | None:
    """Return whether the loop is stable in flight at the latency of the scene; None for a setup
    without a linear loop, or for which none can be formed.

    It costs one table at any sampling interval, but is not checked by a second method: see
    `growth_of`.
    """
    if why_no_loop(setup):
        return None
    setup, every = _of_loop(setup), setup.every_steps
    delay, rest = divmod(1 + setup.line.dead_steps + setup.line.latency_steps, every)
    try:
        loop = loop_of(damped(plant_in_flight(setup)), law_filter(setup), every, rest)
    except (NotLinearError, SceneError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return not loop.table.unstable(np.array([delay]))[0]


def why_no_loop(setup: Setup) -> str:
    """Return why a setup cannot have a linear loop in flight, before its law is looked at; empty if
    it may have one."""
    if not setup.has_law:
        return "the scene has no law, so there is no loop"
    if not SCHEMES[setup.scheme].has_linear_model:
        return (
            f"run.scheme = '{setup.scheme}' has no linear model; use "
            f"{supporting('has_linear_model')}"
        )
    if setup.quantity == "contact_force":
        return "the contact force is zero in flight, so the loop is closed in contact only"
    return ""


def _of_loop(setup: Setup, **control: Any) -> Setup:
    """Return the setup that stands for all setups with the same loop."""
    scene = setup.scene
    run = scene.run.replaced(
        seed=0, touch_phase=0.0, plate_model="modal", duration_s=scene.run.lead_in_s + 1e-3
    )
    controller = scene.controller.replaced(**control)
    return resolve(scene.replaced(name="loop", shows="", run=run, controller=controller))


def _digest(setup: Setup) -> str:
    """Return what tells two versions of a user's law apart."""
    return "" if setup.law_is_shipped else loaded_law(setup).digest


@lru_cache(maxsize=16)
def _loops(setup: Setup, digest: str) -> PolyphaseLoop | NotLinearError:
    """Return the loops of a setup, or why it has none; `digest` belongs to the key."""
    try:
        law = law_filter(setup)
    except NotLinearError as error:
        return error
    plant, every = damped(plant_in_flight(setup)), setup.every_steps
    lead = 1 + setup.line.dead_steps
    return PolyphaseLoop(plant, tuple(loop_of(plant, law, every, r) for r in range(every)), lead)


def damped(plant: PoleForm) -> PoleForm:
    """Return a plant whose poles on the unit circle, those of modes without damping, are just
    inside it.

    The loop gain has no value at a pole on the circle. This is the limit of vanishing damping, and
    changes growths by less than 1e-3 1/s at a step of 1 us.
    """
    size = np.abs(plant.poles)
    inside = np.where(size > 1.0 - INSIDE, plant.poles * (1.0 - INSIDE) / size, plant.poles)
    return replace(plant, poles=inside)


def loops_of(setup: Setup) -> PolyphaseLoop | NotLinearError:
    """Return the linear loop of a setup, or why it has none.

    That of a shipped law serves all latencies; only a user's law may know its own.

    Raises:
        SceneError: the scene is invalid.
    """
    digest = _digest(setup)
    shares = setup.law_is_shipped and not setup.line.trace
    return _loops(_of_loop(setup, latency_us=0.0) if shares else _of_loop(setup), digest)


@lru_cache(maxsize=4096)
def _growth(setup: Setup, digest: str) -> Growth | NotLinearError:
    """Return the growth of a loop, without e-folds, or why it is not linear."""
    loops = loops_of(setup)
    if isinstance(loops, NotLinearError):
        return loops
    latency = setup.line.latency_steps
    count = int(loops.unstable(np.array([latency]))[0])
    loop, delay = loops.at(latency)
    poles = outside_poles(loop, delay, count)
    if poles is None:
        return Growth(None, None, None, None)
    if not count:
        return Growth(0, 0.0, None, 0.0)
    sample_s = setup.every_steps * setup.step_s
    per_s = math.log(float(np.abs(poles).max())) / sample_s
    return Growth(count, per_s, _fastest_hz(poles, sample_s), None)


def outside_poles(loop: Loop, delay: int, count: int) -> np.ndarray | None:
    """Return the closed-loop poles outside the unit circle; None if their number is not `count`,
    so that two independent methods disagree."""
    if 2 * len(loop.plant.poles) + delay > _MOST_STATES:
        if not count:
            return np.empty(0, complex)
        poles = unstable_poles(loop, delay)
        if sum(1 if abs(p.imag) < 1e-12 else 2 for p in poles) == count:
            return poles
    found = closed_loop_poles(loop.plant, loop.law, delay)
    if found is None:
        return None
    size = np.abs(found)
    if not np.sum(size > 1.0 + _ON_CIRCLE) <= count <= np.sum(size > 1.0 - _ON_CIRCLE):
        return None
    return found[np.argsort(-size)[:count]]


def margin_of(setup: Setup) -> Margin:
    """Return the margin of a setup's loop in flight. Raises SceneError for an invalid scene."""
    if why := why_no_loop(setup):
        return Margin(False, why)
    loops = loops_of(setup)
    growth = growth_of(setup)
    if isinstance(loops, NotLinearError):
        return Margin(False, f"not a linear loop ({loops})")
    assert growth is not None
    step_us, latency, every = 1e6 * setup.step_s, setup.line.latency_steps, len(loops.every)
    loop, delay = loops.at(latency)
    limit = _limit(loops)
    sample_s = every * setup.step_s
    stable = None if growth.unstable_poles is None else growth.unstable_poles == 0
    if limit is None or limit < 0:
        limit_us = None if limit is None else -1.0
        binding = growth.frequency_hz
    elif every == 1:
        d, angle = _between(loops, limit)
        limit_us, binding = d * step_us, angle / (2.0 * math.pi * sample_s)
    else:
        limit_us = limit * step_us
        beyond, late = loops.at(limit + 1)
        poles = outside_poles(beyond, late, int(loops.unstable(np.array([limit + 1]))[0]))
        binding = None if poles is None else _fastest_hz(poles, sample_s)
    peak, disk = _sensitivity(loop, delay) if stable else (None, None)
    return Margin(
        applicable=True,
        reason="",
        stable=stable,
        unstable_poles=growth.unstable_poles,
        growth_per_s=growth.per_s,
        growth_frequency_hz=growth.frequency_hz,
        e_folds=growth.e_folds,
        latency_us=latency * step_us,
        latency_limit_steps=limit,
        latency_limit_us=limit_us,
        stable_windows_us=_windows(loops, limit, step_us),
        gain_margin=gain_margin(loop, delay),
        peak_sensitivity=peak,
        disk_margin=disk,
        binding_frequency_hz=binding,
        modes=len(loops.plant.poles),
        step_ns=setup.step_ns,
    )


def _fastest_hz(poles: np.ndarray, sample_s: float) -> float:
    """Return the frequency of the pole that is farthest outside the unit circle, Hz."""
    fastest = poles[int(np.argmax(np.abs(poles)))]
    return abs(float(np.angle(fastest))) / (2.0 * math.pi * sample_s)


def _limit(loops: PolyphaseLoop) -> int | None:
    if not any(loop.table.arcs or loop.table.outside for loop in loops.every):
        return None
    first, size = 0, 256
    while first < _SCANNED:
        bad = np.flatnonzero(loops.unstable(np.arange(first, first + size)))
        if len(bad):
            return first + int(bad[0]) - 1
        first += size
        size *= 2
    return None


def _ends(table: NyquistTable) -> tuple[np.ndarray, np.ndarray]:
    angles, phases = [], []
    for arc in table.arcs:
        for angle, phase in ((arc.start, arc.phase_start), (arc.end, arc.phase_end)):
            if 0.0 < angle < math.pi:
                angles.append(angle)
                phases.append(phase)
    return np.array(angles), np.array(phases)


def _between(loops: PolyphaseLoop, latency: int, back: bool = False) -> tuple[float, float]:
    """Latency (steps) between `latency` and its neighbour where stability ends, and the angle."""
    table, lead = loops.every[0].table, loops.lead
    angles, phases = _ends(table)
    if not len(angles):
        return float(latency), math.pi
    low = latency - 1 if back else latency
    # A crossing lies where phase - D angle is an odd multiple of pi.
    first = np.ceil((phases - (low + 1 + lead) * angles + math.pi) / (2.0 * math.pi))
    last = np.floor((phases - (low + lead) * angles + math.pi) / (2.0 * math.pi))
    found = []
    for i in np.flatnonzero(last >= first):
        for turn in np.arange(first[i], last[i] + 1):
            d = (phases[i] + math.pi - 2.0 * math.pi * turn) / angles[i] - lead
            found.append((float(d), float(angles[i])))
    if not found:
        return float(latency), math.pi
    found.sort(reverse=back)
    for d, angle in found:
        beyond = d - 1e-9 if back else d + 1e-9
        if table.unstable(np.array([beyond + lead]))[0] > 0:
            return d, angle
    return found[-1]


def _windows(loops: PolyphaseLoop, limit: int | None, step_us: float) -> list[list[float | None]]:
    if limit is None:
        return [[0.0, None]]
    stable = loops.unstable(np.arange(max(_WINDOWS, 2 * limit + 200))) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stable.astype(int), [0]])))
    found: list[list[float | None]] = []
    for first, end in edges.reshape(-1, 2):
        low, high = float(first), float(end - 1)
        if len(loops.every) == 1:
            low = 0.0 if first == 0 else _between(loops, int(first), back=True)[0]
            high = _between(loops, int(end - 1))[0]
        found.append([low * step_us, high * step_us])
    return found


def _phase_crossings(loop: Loop, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles where L with its delay is real and negative, and |L| there."""
    theta, full = loop.table.theta, np.exp(loop.table.log_gain)
    full = full * np.exp(-1j * delay * theta)
    if len(theta) < 4 * delay:  # the delay alone turns faster than the grid
        more = np.linspace(0.0, math.pi, 8 * delay)
        theta = np.concatenate([theta, more])
        full = np.concatenate([full, loop.table.gain(more, delay)])
        order = np.argsort(theta)
        theta, full = theta[order], full[order]
    change = np.flatnonzero((full.imag[1:] > 0) != (full.imag[:-1] > 0))
    low, high, up = theta[change], theta[change + 1], full.imag[change] > 0
    for _ in range(45):
        middle = 0.5 * (low + high)
        same = (loop.table.gain(middle, delay).imag > 0) == up
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    at = np.concatenate([0.5 * (low + high), [0.0, math.pi]])
    there = loop.table.gain(at, delay).real
    return at[there < 0.0], -there[there < 0.0]


def gain_margin(loop: Loop, delay: int) -> float | None:
    """Factor up to which every smaller gain is stable too; None without limit."""
    if loop.table.outside:
        return None
    size = _phase_crossings(loop, delay)[1]
    if not len(size) or not size.max() > 0.0:
        return None
    found = 1.0 / float(size.max())
    # A mode without damping tolerates no gain of the wrong sign; `damped` gave it a little.
    return 0.0 if found < _NO_GAIN else found


def unstable_poles(loop: Loop, delay: int) -> np.ndarray:
    """Return closed-loop poles outside the unit circle in the upper half plane, by Newton's method
    from every place where L passes the negative axis beyond -1; some may be missed."""
    angle, size = _phase_crossings(loop, delay)
    s = 1j * angle[size > 1.0]
    if not len(s):
        return np.empty(0, complex)

    def error(at: np.ndarray) -> np.ndarray:
        return np.log(-loop.gain(np.exp(at)) * np.exp(-delay * at))

    for _ in range(_NEWTON):
        step = 1e-7 * np.maximum(np.abs(error(s)), 1e-3) * 1e-1
        value = error(s)
        slope = (error(s + step) - value) / step
        change = value / slope
        limit = 0.3 * np.maximum(np.abs(s.real), 1e-3)
        change *= np.minimum(1.0, limit / np.maximum(np.abs(change), 1e-300))
        s = s - change
        if np.all(np.abs(change) < 1e-12):
            break
    done = (np.abs(error(s)) < 1e-5) & (s.real > 0.0)
    s = s[done]
    s = np.where(s.imag < 0.0, s.conj(), s)
    kept: list[complex] = []
    for one in s[np.argsort(-s.real)]:
        if all(abs(one - other) > 1e-7 for other in kept):
            kept.append(complex(one))
    return np.exp(np.array(kept, complex))


def needle_angles(loop: Loop, delay: int) -> np.ndarray:
    """Return angles from 0 to pi, rising, with one at every narrow peak of the closed loop."""
    parts = [loop.table.theta, _phase_crossings(loop, delay)[0]]
    if 2 * len(loop.plant.poles) + delay <= _MOST_STATES:
        poles = closed_loop_poles(loop.plant, loop.law, delay)
        if poles is not None:  # a needle of the sensitivity stands at every pole
            parts.append(np.abs(np.angle(poles)))
    theta = np.concatenate(parts)
    return np.unique(np.concatenate([theta, np.linspace(0.0, math.pi, 8 * delay + 2)]))


def _sensitivity(loop: Loop, delay: int) -> tuple[float, float]:
    """Largest |S| and 1/max|S - 1/2|, from the grid, phase crossings, and a local search."""
    theta = needle_angles(loop, delay)

    def both(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = 1.0 / (1.0 + loop.table.gain(at, delay))
        return np.abs(s), np.abs(s - 0.5)

    found = []
    values = both(theta)
    for kind in (0, 1):
        best = np.argsort(-values[kind])[:30]
        low = theta[np.maximum(best - 1, 0)]
        high = theta[np.minimum(best + 1, len(theta) - 1)]
        for _ in range(60):
            a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
            left = both(a)[kind] > both(b)[kind]
            low, high = np.where(left, low, a), np.where(left, b, high)
        found.append(max(float(values[kind].max()), float(both(0.5 * (low + high))[kind].max())))
    return found[0], 1.0 / found[1]
