"""The loop while the sphere touches the structure: linearised at the peak force, and facts for a
law without a linear loop.

A contact is a spring of stiffness k_c = 1.5 s^(2/3) F^(1/3) about a force F. Mean and rise of the
contact force over a step follow from the gap at both ends of the step, so the frozen system is a
sampled linear system like that in flight. A short contact ends before its loop can grow, so the
growth times the contact time decides whether the frozen loop means anything.
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import tangent_stiffness_n_m
from hertzloop.scene.build import build_sensor, free_series
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.growth import fastest_hz, growth_per_s, outside_poles
from hertzloop.studies.margin.identify import NotLinearError, law_filter
from hertzloop.studies.margin.law_filters import LawFilter
from hertzloop.studies.margin.linear import (
    PoleForm,
    by_command,
    by_contact,
    linear_model,
    through_sensor,
)
from hertzloop.studies.margin.loop import loop_of
from hertzloop.studies.margin.poles import closed_loop_poles

LONG = 3.0  # growth times contact time from which an instability in contact shows
_SOFT = 1e-3  # frequency of the spring that holds the free sphere, of that of the contact
_RING = 64  # points for the finite part of the response


@dataclass(frozen=True)
class Touch:
    """The first contact without control. Times in s, force in N.

    Attributes:
        contact_s: its length; up to the end of the run if it does not end.
        ends: whether it ends within the run.
        peak_n: largest contact force.
    """

    contact_s: float
    ends: bool
    peak_n: float


@dataclass(frozen=True)
class ContactMargin:
    """The frozen loop in contact.

    Attributes:
        touch: the contact without control.
        stiffness_n_m: of the contact at its peak force.
        unstable_poles: closed-loop poles outside the unit circle; None if undecided.
        growth_per_s: fastest growth, 1/s; 0 if stable, None if undecided.
        frequency_hz: of the pole that grows fastest.
        growth_times_contact: e-folds over the contact.
        stable: the verdict; None where the contact is too short for one.
    """

    touch: Touch
    stiffness_n_m: float
    unstable_poles: int | None
    growth_per_s: float | None
    frequency_hz: float | None
    growth_times_contact: float | None
    stable: bool | None


@dataclass(frozen=True)
class ImpactFacts:
    """Facts on a law that makes no linear loop.

    Attributes:
        touch: the contact without control.
        first_force_us: from the touch to the first force, at the latency of the scene; None if the
            law does not act within the run.
        latency_after_contact_us: latency beyond which the first force starts after the contact
            without control; None where that is not known.
    """

    touch: Touch
    first_force_us: float | None
    latency_after_contact_us: float | None


def first_touch(setup: Setup) -> Touch:
    """Return the first contact of a setup without control. Raises SceneError for a run without."""
    free = setup.without_control(same_plate=True)
    began, peak, step_s = None, 0.0, setup.step_s
    for first, truth in free_series(free):
        force = truth[ts.F_C]
        touching = force > 0.0
        if began is None:
            if not touching.any():
                continue
            began = first + int(np.argmax(touching))
        own = max(began - first, 0)
        gone = np.flatnonzero(~touching[own:])
        end = own + int(gone[0]) if len(gone) else len(force)
        peak = max(peak, float(force[own:end].max(initial=0.0)))
        if len(gone):
            return Touch((first + end - began) * step_s, True, peak)
    if began is None:
        raise SceneError(
            f"run.duration_s = {setup.duration_s:g} ends before the first contact. Increase it."
        )
    return Touch((setup.steps - began) * step_s, False, peak)


def impact_facts(setup: Setup) -> ImpactFacts:
    """Return facts on a law without a linear loop. Raises SceneError for a run without contact."""
    touch = first_touch(setup)

    def first_force_s(tried: Setup) -> float | None:
        truth = simulate(tried).truth
        pushes = np.flatnonzero(truth[ts.F_A])
        touches = np.flatnonzero(truth[ts.F_C] > 0.0)
        if not len(pushes) or not len(touches):
            return None
        return float(pushes[0] - touches[0]) * setup.step_s

    acts_s = first_force_s(setup)
    limit_us = None
    if acts_s is not None and touch.ends:
        left_us = 1e6 * (touch.contact_s - acts_s)
        tried_us = setup.latency_us + left_us
        if tried_us >= 0.0:
            # A law that knows its latency may act at another sample then.
            late_s = first_force_s(setup.vary({"controller.latency_us": round(tried_us, 3)}))
            if late_s is not None and abs(late_s - touch.contact_s) < 1.5 * setup.step_s:
                limit_us = tried_us
    return ImpactFacts(touch, None if acts_s is None else 1e6 * acts_s, limit_us)


def contact_margin(setup: Setup) -> ContactMargin | str:
    """Return the frozen loop in contact, or why there is none.

    Args:
        setup: with a linear law that samples the contact force or the gap.

    Raises:
        SceneError: the run has no contact, or the scheme has no linear model.
    """
    if setup.quantity not in ("contact_force", "xi"):
        return f"sensors.quantity = '{setup.quantity}': the loop in contact is not analysed"
    try:
        law = law_filter(setup)
    except NotLinearError as error:
        return f"not a linear loop ({error})"
    touch = first_touch(setup)
    plant, stiffness = plant_in_contact(setup, touch.peak_n)
    every = setup.every_steps
    latency = setup.line.latency_steps + setup.line.dead_steps
    delay, remainder = divmod(latency + 1, every)
    loop = loop_of(plant, law, every, remainder)
    count: int | None = int(loop.table.unstable(np.array([delay]))[0])
    poles = outside_poles(loop, delay, count or 0)
    growth: float | None = 0.0
    at_hz = None
    if poles is None:
        count = growth = None
    elif len(poles):
        sample_s = every * setup.step_s
        growth, at_hz = growth_per_s(poles, sample_s), fastest_hz(poles, sample_s)
    folds = None if growth is None else growth * touch.contact_s
    stable = None
    if folds is not None:
        if folds >= LONG:
            stable = False
        elif not count and not touch.ends:
            stable = True
    return ContactMargin(touch, stiffness, count, growth, at_hz, folds, stable)


def plant_in_contact(setup: Setup, force_n: float) -> tuple[PoleForm, float]:
    """Return the response of the samples to a command in a contact frozen about a force, and the
    stiffness of the contact, N/m.

    Raises:
        SceneError: the scheme has no linear model, or the poles in contact were not found.
    """
    model = linear_model(setup)
    command = by_command(model, gap=True)
    stiffness = tangent_stiffness_n_m(setup.contact.stiffness, force_n, setup.contact.exponent)
    spring = stiffness / (1.0 + stiffness * model.flexibility_m_n)
    contact = setup.contact
    damper = contact.viscous_n_s_m + contact.hunt_crossley_s_m * force_n
    # Of a step: mean of the force and half its rise, as -(a + b Z) times the gap at its start.
    a, b = 0.5 * spring - damper / model.step_s, 0.5 * spring + damper / model.step_s
    mean, slope = _with_sphere(by_contact(model), spring, model.mass_kg, model.step_s)
    p = mean.poles
    own_loop = mean.residues * (a + b * p) + slope.residues * 0.5 * spring * (p - 1.0)
    constant = 2.0 * float(np.sum((mean.residues * b + slope.residues * 0.5 * spring).real))
    closed = PoleForm(p, own_loop, np.zeros(2))
    whole = 1.0 + constant
    part = PoleForm(p, closed.residues / whole, np.zeros(2))
    none = np.empty(0, complex)
    own = closed_loop_poles(part, LawFilter(-1.0, none, none), 0)
    if own is None:
        raise SceneError("the poles of the structure in contact were not found")

    def numerator(z: np.ndarray) -> np.ndarray:
        gap = command.at(z)
        if setup.quantity == "xi":
            return np.asarray(gap * spring / stiffness)
        return np.asarray(-(a / z + b) * gap)  # the mean over the step before

    own = np.where(np.abs(own.imag) < 1e-13, own.real + 0j, own)
    own = own[(own.imag >= 0.0) & (np.abs(own) > 1e-9)]
    away = np.abs(own[:, None] - p).min(axis=1)
    own = own[away > 1e-15]  # a mode that does not move at the contact point is not seen
    change = -(closed.residues / (own[:, None] - p) ** 2).sum(axis=1)
    change -= (closed.residues.conj() / (own[:, None] - p.conj()) ** 2).sum(axis=1)
    residues = numerator(own) / change * np.where(own.imag == 0.0, 0.5, 1.0)
    form = PoleForm(own, residues, np.zeros(2))
    z = 2.0 * np.exp(2j * math.pi * np.arange(_RING) / _RING)
    full = numerator(z) / (whole + closed.at(z))
    rest = full - form.at(z)
    found = np.array([np.mean(rest * z).real, np.mean(rest * z**2).real])
    if np.abs(rest - found[0] / z - found[1] / z**2).max() > 1e-6 * np.abs(full).max():
        raise SceneError("the response of the structure in contact was not found")
    form = PoleForm(own, residues, found)
    return through_sensor(form, build_sensor(setup).model), stiffness


def _with_sphere(
    forms: tuple[PoleForm, PoleForm], spring: float, mass_kg: float, step_s: float
) -> tuple[PoleForm, PoleForm]:
    """Return the responses of the gap to mean and slope of the contact force with the sphere, which
    a very soft spring holds, so that it has a pole pair beside 1."""
    turn = _SOFT * math.sqrt(spring / mass_kg) * step_s
    scale = step_s**2 / (mass_kg * turn * 2j)
    constant = np.expm1(1j * turn) / (1j * turn)
    # 2 phi_2 - phi_1, whose terms cancel.
    rising = -1j * turn / 6.0 + turn**2 / 12.0 + 1j * turn**3 / 40.0
    pole = np.exp(1j * turn)
    mean, slope = (
        PoleForm(np.append(form.poles, pole), np.append(form.residues, scale * part), form.fir)
        for form, part in zip(forms, (constant, rising), strict=True)
    )
    return mean, slope
