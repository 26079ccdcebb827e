"""The margin of a scene's sampled loop in flight: stability, growth, latency limit, gain margin."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.gain import gain_margin, sensitivity
from hertzloop.studies.margin.growth import Growth, fastest_pole, frequency_hz, growth_of
from hertzloop.studies.margin.identify import NotLinearError
from hertzloop.studies.margin.latency import crossing_after, latency_limit, stable_windows
from hertzloop.studies.margin.linear import linear_plant
from hertzloop.studies.margin.loop import loops_of, why_no_loop


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

    @property
    def growth(self) -> Growth:
        """How the loop grows at the latency of the scene."""
        return Growth(
            self.unstable_poles, self.growth_per_s, self.growth_frequency_hz, self.e_folds
        )


def margin_of(setup: Setup) -> Margin:
    """Return the margin of a setup's loop in flight. Raises SceneError for an invalid scene, or for
    a loop whose numbers are not finite."""
    try:
        return _margin_of(setup)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise SceneError(
            f"the linear loop of {setup.scene.name} cannot be calculated: {error}. Use a smaller "
            "gain of the law, or more damping of the plate"
        ) from error


def _margin_of(setup: Setup) -> Margin:
    if why := why_no_loop(setup):
        return Margin(False, why)
    loops = loops_of(setup)
    growth = growth_of(setup)
    if isinstance(loops, NotLinearError):
        return Margin(False, f"not a linear loop ({loops})")
    assert growth is not None
    step_us, latency, every = (
        1e6 * setup.run.step_s,
        setup.signal_path.latency_steps,
        len(loops.every),
    )
    loop, delay = loops.at(latency)
    limit = latency_limit(loops)
    sample_s = every * setup.run.step_s
    stable = growth.unstable_poles == 0
    if limit is None or limit < 0:
        limit_us = None if limit is None else -1.0
        binding = growth.frequency_hz
    elif every == 1:
        d, angle = crossing_after(loops, limit)
        limit_us, binding = d * step_us, angle / (2.0 * math.pi * sample_s)
    else:
        limit_us = limit * step_us
        fastest = fastest_pole(*loops.at(limit + 1))
        binding = None if fastest is None else frequency_hz(fastest, sample_s)
    peak, disk = sensitivity(loop, delay) if stable else (None, None)
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
        stable_windows_us=stable_windows(loops, limit, step_us),
        gain_margin=gain_margin(loop, delay),
        peak_sensitivity=peak,
        disk_margin=disk,
        binding_frequency_hz=binding,
        modes=len(linear_plant(setup).modes.omega),
        step_ns=setup.run.step_ns,
    )
