"""A law that is not shipped, tried with some hundred samples before a run.

The command line tries it in a child process, since it may hang or crash; Python in its own.
"""

import math
import multiprocessing
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from hertzloop.bus.sockets import own_folder
from hertzloop.common.protocols import TrialImpact
from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.bound import BoundLaw, BoundPython, LawFault
from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.records import seen_values
from hertzloop.controller.loading.registry import load_anew, shipped
from hertzloop.loop import answering
from hertzloop.plant.contact.hertz import rigid_penetration_m
from hertzloop.scene.controller import bound_law, law_context, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup

_SAMPLES = 400
_BEFORE = 100  # of these, before the impact
_PATIENCE_S = 6.0  # for all samples, three times
_IN_PYTHON_S = 2.0
_PREPARED_S = 60.0  # what a law prepares may take kernels that have to be compiled first
_TIMED = 20  # samples whose cost is measured


class _LawTrial(NamedTuple):
    """A law, and the samples it is tried with."""

    bound: BoundLaw
    samples: np.ndarray
    step_s: float


def try_law(setup: Setup) -> str:
    """Let the scene's law answer an impact on a rigid plate; a line on what it costs if it is not
    compiled, else nothing. Raises SceneError if it fails or does not answer."""
    law = loaded_law(setup)
    if law.name in shipped():
        return ""
    try:
        with given_up_in_time(_PREPARED_S):
            trial = _trial(law, setup)
    except LawTimeout:
        raise SceneError(
            f"law {law.name}: was not prepared within {_PREPARED_S:g} s. Check it for an endless "
            "loop."
        ) from None
    if problem := _problem_in_child(trial):
        raise SceneError(problem)
    bound = trial.bound
    if not isinstance(bound, BoundPython) or not bound.trouble:
        return ""
    if bound.trouble.startswith("NameError"):  # Python says so only when it gets there
        raise SceneError(f"law {bound.name}: {bound.trouble}. Correct the name, or define it.")
    return (
        f"the law {bound.name} runs as Python, {bound.cost_us(trial.samples[:_TIMED]):.1f} us a "
        f"sample instead of about 0.01, because Numba says: {bound.trouble}"
    )


@lru_cache(maxsize=64)
def check_repeatable(setup: Setup) -> None:
    """Try a law in this process. Raises SceneError."""
    law = loaded_law(setup)
    if law.name not in shipped() and (problem := _problem(_trial(law, setup))):
        raise SceneError(problem)


def _trial(law: Law, setup: Setup) -> _LawTrial:
    """A law, bound for its trial. Raises SceneError, also for a law that is not the same, or
    prepares other constants, a second time."""
    about, remedy = law_context(setup), "Use no random numbers and no clock there."
    again = load_anew(setup.scene.controller.law).identity
    if law.identity and again and (changed := law.identity.changed(again)):
        raise SceneError(
            f"law {law.name}: {changed} has another value each time that the law is loaded. "
            f"{remedy}"
        )
    keys = setup.scene.controller.keys
    with suppress(LawError, TypeError):  # it is told when the law is bound
        if _values(law.constants(keys, about)) != _values(law.constants(keys, about)):
            raise SceneError(
                f"law {law.name}: prepare returns other constants the second time. {remedy}"
            )
    return _LawTrial(bound_law(setup, True), impact_samples(setup, about), setup.run.step_s)


def _values(constants: Any) -> list[bytes]:
    """The values of a law's constants, from a NamedTuple or by name, as bytes. Raises TypeError."""
    fields = constants if isinstance(constants, Mapping) else constants._asdict()
    return [np.asarray(value).tobytes() for value in seen_values(fields).values()]


def impact_samples(setup: Setup, about: LawContext) -> np.ndarray:
    """What the law would sense of an impact on a rigid plate; a long one is shortened."""
    contact = min(max(int(about.rigid_contact_s / about.sample_s), 4), _SAMPLES // 2)
    away = np.arange(_SAMPLES) - _BEFORE
    pulse = np.sin(np.clip(away / contact, 0.0, 1.0) * np.pi)
    deepest = rigid_penetration_m(about.sphere_mass_kg, about.stiffness, about.impact_speed_m_s)
    gap = np.where(away < 0, -away, np.maximum(away - contact, 0))
    return SENSED[setup.scene.sensors.quantity].trial(
        TrialImpact(
            gap_m=gap * about.impact_speed_m_s * about.sample_s - deepest * pulse,
            force_n=about.rigid_peak_n * pulse,
            velocity_m_s=-about.rigid_peak_n / about.impedance_n_s_m * pulse,
            sample_s=about.sample_s,
        )
    )


def _problem(trial: _LawTrial) -> str:
    """What a law does wrong with these samples, in a sentence; empty if nothing."""
    name = trial.bound.name
    try:
        first, second = (_forces(trial, 0.0) for _ in range(2))
        if first.tobytes() != second.tobytes():
            step = int(np.flatnonzero(first != second)[0])  # a command acts from the next step on
            return (
                f"law {name}: is not deterministic. With the same samples and a new state, its "
                f"command for sample {step - 1} is {first[step]:.9g} N the first time and "
                f"{second[step]:.9g} N the second. Make it a function of its keys, its state and "
                "its samples: keep what it remembers in State, and use no random numbers and no "
                "clock."
            )
        with suppress(LawTimeout), given_up_in_time(_IN_PYTHON_S):  # far slower than compiled
            if problem := trial.bound.reads_unknown(trial.samples):
                return problem
    except LawFault as error:
        return str(error)
    # What lies beyond its samples reaches a command of C without an error.
    with suppress(LawFault):
        if first.tobytes() == _forces(trial, math.nan).tobytes():
            return ""
    return (
        f"law {name}: reads values before samples[0] or after samples[i], since its commands "
        "change with them. Read samples[0] to samples[i] only."
    )


def _forces(trial: _LawTrial, beyond: float) -> np.ndarray:
    """The forces of a law, where it finds the number `beyond` before and after the samples that it
    is given. Raises LawFault, for a law that changes its samples as well."""
    controller = Controller(trial.bound, SignalPath(), trial.step_s, _SAMPLES + 1, 1, 0)
    history = np.full(3 * (_SAMPLES + 1), beyond)[_SAMPLES + 1 : 2 * (_SAMPLES + 1)]
    controller.law_state = controller.law_state._replace(history=history)
    forces = answering.answer_samples(controller, trial.samples).forces.copy()
    changed = np.flatnonzero(history[:_SAMPLES] != trial.samples)
    if len(changed):
        raise LawFault(
            f"law {trial.bound.name}: changes samples[{changed[0]}], which it may only read. Keep "
            "what it changes in State."
        )
    return forces


def _problem_in_child(trial: _LawTrial) -> str:
    """The same from a process that may hang or crash."""
    answering.load()  # what is compiled here is no time of the law's
    name, context = trial.bound.name, multiprocessing.get_context("fork")
    reading, writing = context.Pipe(duplex=False)
    with own_folder() as folder:  # the child may be killed: what it unpacks goes with this
        child = context.Process(target=_send_problem, args=(trial, folder, writing))
        child.start()
        writing.close()
        try:
            if reading.poll(_PATIENCE_S):
                return str(reading.recv())
        except EOFError:
            child.join()
            return f"law {name}: ended its process by signal {-(child.exitcode or 0)}"
        finally:
            reading.close()
            child.kill()
            child.join()
    return (
        f"law {name}: did not answer {_SAMPLES} samples three times within {_PATIENCE_S:g} s. "
        "Check it for an endless loop, or let it do less."
    )


def _send_problem(trial: _LawTrial, folder: str, to: Connection) -> None:
    tempfile.tempdir = folder
    try:
        to.send(_problem(trial))
    except BaseException as error:
        to.send(f"law {trial.bound.name}: failed: {error!r}")
