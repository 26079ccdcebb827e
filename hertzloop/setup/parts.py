"""The parts of a run as a setup describes them: plant, sensor, and controller with its law."""

import math
from collections.abc import Hashable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.controller.controller import Controller, LineSpec, mean_latency_steps
from hertzloop.controller.law import About, Keys
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import NO_CONTROL, find
from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import Contact, Sphere, rigid_impact
from hertzloop.plant.estimates.model_order import least_limit_hz
from hertzloop.plant.figures.impacts import contacts
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.structure import Structure
from hertzloop.scenes.controller_table import ControllerTable
from hertzloop.scenes.errors import SceneError
from hertzloop.sensors.acquisition import Sensor
from hertzloop.setup.setup import Setup, resolve
from hertzloop.setup.stages import KEPT, Bodies

# Steps after the lead-in in which the first contact without control is looked for, four times as
# many at a time; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS, _MOST_PUBLISHED = 1 << 20, 1 << 14
_MOST_BELOW = 0.5  # of the contact's own flexibility


def check(setup: Setup) -> None:
    """Build all parts of the run once. Raises SceneError."""
    start_sensor(setup)
    start_plant(setup)
    start_controller(setup)


def start_plant(
    setup: Setup, spec: PlantSpec | None = None, steps: int | None = None, *, flight: bool = False
) -> Plant:
    """The plant at the start of the run, or that of another description `spec` by the same scheme,
    for as many `steps` as are to be run, by default all; `flight`: no impact is asked of it. Raises
    SceneError for what the scheme does not know, and modes too low for impacts.
    """
    spec = spec or setup.plant
    if not flight:
        check_reach(spec)
    try:
        return plant_at_start(spec, setup.scheme, steps or setup.steps, setup.touch_phase)
    except ValueError as error:
        raise SceneError(str(error)) from error


def check_reach(spec: PlantSpec) -> None:
    """Refuse modes of a file that leave out all of an impact, unless an infinite plate stands for
    the rest or a tail was asked for; or a solid's with what does not fit those. In flight they are
    right all the same. Raises SceneError."""
    sphere, plate, contact = spec.sphere, spec.plate, spec.contact
    if plate.mode_table is None or spec.infinite_plate:
        return
    _check_below_zero(plate, sphere, contact)
    needed_hz = least_limit_hz(sphere, plate, contact, spec.frequency_limit_hz)
    if spec.frequency_limit_hz > needed_hz or spec.damped_tail or spec.tail_asked:
        return
    if needed_hz == math.inf:
        raise SceneError(
            f"contact.damping: is too large for {plate}, which leave out too much flexibility. "
            "Give modes up to a higher frequency, or less damping."
        )
    lasts_s = rigid_impact(sphere, contact).contact_s
    grain = 10.0 ** (math.floor(math.log10(needed_hz)) - 2)  # rounded up, to three digits
    raise SceneError(
        f"{plate} reach up to {spec.frequency_limit_hz:,.6g} Hz, too low for an impact of "
        f"{1e6 * lasts_s:.3g} us; give modes up to {(needed_hz // grain + 1) * grain:,.6g} Hz at "
        "least (are they in Hz?), plate.thickness_m if it is a plate at the contact point, or "
        "plate.tail = 'spring' to run with an error that is not known"
    )


def _check_below_zero(structure: Structure, sphere: Sphere, contact: Contact) -> None:
    """Refuse a residual flexibility below zero, of the modes of a solid, where it does not fit."""
    left_out = structure.residual_flexibility_m_n(2.0 * math.pi * structure.highest_hz)
    if left_out >= 0.0:
        return
    named = f"{structure} with residual_flexibility_m_n = {left_out:.3g}, below zero,"
    if contact.has_damper:
        raise SceneError(
            f"{named} do not fit contact.damping: a negative residual flexibility is unstable with "
            "a damper. Use contact.plasticity for losses, or other modes."
        )
    tangent = contact.exponent * contact.stiffness * rigid_impact(sphere, contact).rise
    if -left_out * tangent > _MOST_BELOW:
        raise SceneError(
            f"{named}: the contact is too stiff for these modes. Use fewer modes, a softer "
            "contact, or a lower speed."
        )


def start_sensor(setup: Setup, steps: int | None = None) -> Sensor:
    """The data-acquisition channel at the start of the run, for as many `steps` as are to be run,
    by default all."""
    return Sensor(setup.sensor, setup.step_s, steps or setup.steps, setup.seed)


def start_controller(setup: Setup, ahead: bool = True, steps: int | None = None) -> Controller:
    """Law and line at the start of the run; `ahead` as of `bound_law`, `steps` as of
    `start_sensor`. Raises SceneError."""
    bound, steps = bound_law(setup, ahead), steps or setup.steps
    return Controller(bound, setup.line, setup.step_s, steps, setup.every_steps, setup.seed)


def free_series(setup: Setup) -> Iterator[tuple[int, np.ndarray]]:
    """Simulate the plant alone, without any force of the actuator; its time series in blocks:
    first step, and an array of shape (10, steps of the block)."""
    return ts.free_series(start_plant(setup), setup.steps)


def mean_latency_us(setup: Setup) -> float:
    """Mean latency of the force that acts, us; see `mean_latency_steps`."""
    steps = mean_latency_steps(setup.line, setup.steps, setup.every_steps, setup.seed)
    return 1e6 * setup.step_s * steps


def about(setup: Setup) -> About:
    """Return what a law may know of the run.

    A law that is computed beforehand asks for the contact force without control, which is a
    simulation of the plant alone.
    """
    return replace(
        setup.about_bodies,
        converter_step=setup.converter_step,
        uncontrolled_force_n=lambda: uncontrolled_force_n(setup),
    )


def uncontrolled_force_n(setup: Setup) -> np.ndarray:
    """Return the contact force of the first impact without control, from the sample at its start,
    N; in the published scheme its elastic part; shape (samples in contact,).

    Raises:
        LawError: the contact lasts longer than is worth following.
    """
    found, followed_s = _uncontrolled_force_n(setup.without_control().plain())
    if found is None:
        raise LawError(
            f"controller.law = '{setup.law_reference}' needs the contact force without control, "
            f"but the first contact does not end within {followed_s:g} s. Use a harder plate, "
            "less contact.viscous_n_s_m, or another law."
        )
    return found


@lru_cache(maxsize=16)
def _uncontrolled_force_n(free: Setup) -> tuple[np.ndarray | None, float]:
    """The force, None of a contact that lasts too long; how long it was followed, s."""
    published = not SCHEMES[free.scheme].conserves
    steps, lead_s = _FIRST_STEPS, free.lead_in_s
    while steps <= (_MOST_PUBLISHED if published else _MOST_STEPS):
        run = free.scene.run.replaced(duration_s=lead_s + steps * free.step_s)
        short = resolve(free.scene.replaced(run=run))
        truth = ts.series_under(start_plant(short), np.zeros(short.steps))
        found = first_contact_force_n(truth, free.contact.stiffness, published)
        if found is not None:
            return found, steps * free.step_s
        steps *= 4
    return None, steps / 4 * free.step_s


def first_contact_force_n(
    truth: np.ndarray, stiffness: float, published: bool
) -> np.ndarray | None:
    """Contact force of the first contact from its first sample on, N; its elastic part in the
    published scheme, as there. None unless the contact has ended.

    Args:
        truth: rows of a plant, shape (10, steps).
        stiffness: of the contact, N/m^1.5.
    """
    gap = truth[ts.XI]
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    starts, ends = contacts((gap <= 0.0).astype(float) if published else truth[ts.F_C])
    if not ends:
        return None
    span = slice(starts[0], ends[0])
    if published:
        return np.asarray(stiffness * np.maximum(-gap[span], 0.0) ** 1.5)
    return truth[ts.F_C, span].copy()


def bound_law(setup: Setup, ahead: bool = True) -> BoundLaw:
    """Return the law with its constants; without `ahead` its commands alone. Raises SceneError."""
    # All that the contact force without control follows from, which `about` does not show.
    free = (
        setup.with_edges, setup.touch_phase, setup.scheme, setup.scene.run.plate_model,
        setup.accuracy,
    )  # fmt: skip
    table = setup.scene.controller
    return _bound(_law_of(table), table, about(setup), setup.bodies, free, ahead)


def law_constants(setup: Setup) -> Any:
    """Return what the functions of the law know. Raises SceneError."""
    return _constants(setup.scene.controller, about(setup), setup.bodies)


def law_of(setup: Setup) -> Law:
    """Return the law as it was found, without constants. Raises SceneError where a recording has
    outlived its law."""
    return _law_of(setup.scene.controller)


def law_flight_m(setup: Setup) -> float:
    """Return how far above the plate the law has to see the sphere, m: what it flies in the latency
    and the law's window; zero of a law that waits for the contact, or is not shipped. Raises
    SceneError."""
    if not setup.law_is_shipped:  # a recording must not have others called
        return 0.0
    level = bound_law(setup).waits_above
    if not 0.0 < level < math.inf:
        return 0.0
    known = setup.about_bodies
    window = getattr(setup.scene.controller.keys, "window_samples", 1) * known.sample_s
    return min(level, known.impact_speed_m_s * (known.horizon_s + window))


@lru_cache(maxsize=KEPT)
def _bound(
    law: Law, table: ControllerTable, about: About, bodies: Bodies, free: Hashable, ahead: bool
) -> BoundLaw:
    """Bind the law to its constants.

    Args:
        law: the law of the table as it was loaded last: it may prepare other constants each time.
        free: what the contact force without control depends on, for which a law may ask `about`.
        ahead: whether anybody asks what the law knows of samples to come.

    Raises:
        SceneError: the law cannot be prepared for the run.
    """
    try:
        return law.bound_to(_constants(table, about, bodies), ahead)
    except LawError as error:
        raise SceneError(str(error)) from error


def _constants(table: ControllerTable, about: About, bodies: Bodies) -> Any:
    """Return what the functions of the law know. Raises SceneError if it refuses the run."""
    law = _law_of(table)
    try:
        if math.isnan(about.impedance_n_s_m) and _needs_impedance(law, table.keys, about):
            bodies.local_plate  # noqa: B018 - says what is missing
        return law.constants(table.keys, about)
    except LawError as error:
        raise SceneError(str(error)) from error


_TRIED_N_S_M = (100.0, 1000.0)  # impedances, to see whether a law takes any


def _needs_impedance(law: Law, keys: Any, about: About) -> bool:
    """Whether the law's constants follow from it: whether they differ for two of them."""
    if not hasattr(getattr(law, "home", None), "prepare"):
        return False  # it has all that is known as it is
    one, other = (
        law.constants(keys, replace(about, impedance_n_s_m=tried)) for tried in _TRIED_N_S_M
    )
    return any(not np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def _law_of(table: ControllerTable) -> Law:
    """The law that a scene names. Raises SceneError."""
    try:
        return table.loaded_law
    except LawError as error:
        raise SceneError(str(error)) from error


def idle() -> Controller:
    """A controller without a law, whose kernels are loaded, or compiled, once it is there: before
    anybody waits for an answer."""
    found = Controller(find(NO_CONTROL).bind(Keys(), About()), LineSpec(), 1e-6, 1, 1, 0)
    found.process(np.empty(0))
    return found
