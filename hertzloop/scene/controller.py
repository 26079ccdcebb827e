"""The controller of a run: its law with constants, and the path of its force."""

import math
from collections.abc import Hashable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.controller.controller import (
    Controller,
    latency_steps,
    mean_latency_steps,
)
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.law import Law
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.mechanics import Mechanics
from hertzloop.scene.setup import Setup
from hertzloop.scene.uncontrolled import uncontrolled_force_n


def check_buildable(setup: Setup) -> None:
    """Build all parts of the run once. Raises SceneError."""
    build_sensor(setup)
    build_plant(setup)
    build_controller(setup)


def build_controller(setup: Setup, ahead: bool = True, steps: int | None = None) -> Controller:
    """Law and signal path at the start of the run; `ahead` as of `bound_law`, `steps` as of
    `build_sensor`. Raises SceneError.

    A law that is not shipped has its promises compared with its commands, whoever asks for them.
    """
    bound = bound_law(setup, ahead or not setup.scene.controller.law_is_shipped)
    steps = steps or setup.run.steps
    return Controller(
        bound, setup.signal_path, setup.run.step_s, steps, setup.sensor.every_steps, setup.run.seed
    )


def mean_latency_us(setup: Setup) -> float:
    """Mean latency of the force that acts, us; see `mean_latency_steps`."""
    steps = mean_latency_steps(
        setup.signal_path, setup.run.steps, setup.sensor.every_steps, setup.run.seed
    )
    return 1e6 * setup.run.step_s * steps


def latencies_us(setup: Setup) -> np.ndarray:
    """Return the latency of each command, us, shape (samples,); see `latency_steps`."""
    steps = latency_steps(
        setup.signal_path, setup.run.steps, setup.sensor.every_steps, setup.run.seed
    )
    return steps * (setup.run.step_ns / 1000)


def law_context(setup: Setup) -> LawContext:
    """Return what a law may know of the run.

    A law that is computed beforehand asks for the contact force without control, which is a
    simulation of the plant alone.
    """
    return replace(setup.law_context, uncontrolled_force_n=lambda: uncontrolled_force_n(setup))


def bound_law(setup: Setup, ahead: bool = True) -> BoundLaw:
    """Return the law with its constants; without `ahead` its commands alone. Raises SceneError."""
    # All that the contact force without control follows from, which `about` does not show.
    free = setup.scene.plate.tail, setup.run.replaced(seed=0, touch_phase=setup.run.phase)
    table = setup.scene.controller
    return _bound(loaded_law(setup), table, law_context(setup), setup.mechanics, free, ahead)


def law_constants(setup: Setup) -> Any:
    """Return what the functions of the law know. Raises SceneError."""
    keys = setup.scene.controller.keys
    return _constants(loaded_law(setup), keys, law_context(setup), setup.mechanics)


def loaded_law(setup: Setup) -> Law:
    """Return the law as it was found, without constants. Raises SceneError where a recording has
    outlived its law."""
    return setup.scene.controller.loaded_law


def law_flight_m(setup: Setup) -> float:
    """Return how far above the plate the law has to see the sphere, m: what it flies in the latency
    and the law's window; zero of a law that waits for the contact, or is not shipped. Raises
    SceneError."""
    if not setup.scene.controller.law_is_shipped:  # a recording must not have others called
        return 0.0
    level = bound_law(setup).waits_above
    if not 0.0 < level < math.inf:
        return 0.0
    known = setup.law_context
    window = getattr(setup.scene.controller.keys, "window_samples", 1) * known.sample_s
    return min(level, known.impact_speed_m_s * (known.loop_delay_s + window))


@lru_cache(maxsize=16)
def _bound(
    law: Law,
    table: ControllerTable,
    about: LawContext,
    mechanics: Mechanics,
    free: Hashable,
    ahead: bool,
) -> BoundLaw:
    """Bind the law to its constants.

    Args:
        law: the law of the table as it was loaded last: it may prepare other constants each time.
        free: what the contact force without control depends on, for which a law may ask `about`.
        ahead: whether anybody asks what the law knows of samples to come.

    Raises:
        SceneError: the law cannot be prepared for the run.
    """
    return law.bound_to(_constants(law, table.keys, about, mechanics), ahead)


def _constants(law: Law, keys: Any, about: LawContext, mechanics: Mechanics) -> Any:
    """Return what the functions of the law know. Raises SceneError if it refuses the run."""
    if math.isnan(about.impedance_n_s_m) and _needs_impedance(law, keys, about):
        mechanics.local_plate  # noqa: B018 - says what is missing
    return law.constants(keys, about)


_TRIED_N_S_M = (100.0, 1000.0)  # impedances, to see whether a law takes any


def _needs_impedance(law: Law, keys: Any, about: LawContext) -> bool:
    """Whether the law's constants follow from it: whether they differ for two of them."""
    if not hasattr(getattr(law, "home", None), "prepare"):
        return False  # it has all that is known as it is
    one, other = (
        law.constants(keys, replace(about, impedance_n_s_m=tried)) for tried in _TRIED_N_S_M
    )
    return any(not np.array_equal(a, b) for a, b in zip(one, other, strict=True))
