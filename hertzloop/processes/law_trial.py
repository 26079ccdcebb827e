"""A law that is not shipped, tried for a moment before a run: in a child, since it may hang."""

import math
import os
import select
import signal
import tempfile
import warnings
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.bus.sockets import own_folder
from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.bound import BoundLaw, BoundPython, BrokenPromise, LawFault
from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import load_anew, shipped
from hertzloop.plant.contact.hertz import rigid_penetration_m
from hertzloop.scene.controller import bound_law, build_idle_controller, law_context, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED, Trial
from hertzloop.scene.setup import Setup

_SAMPLES = 2000
_PATIENCE_S = 10.0
_IN_PYTHON_S = 2.0
_PREPARED_S = 60.0  # what a law prepares may take kernels that have to be compiled first


def try_law(setup: Setup) -> str:
    """Let the scene's law answer an impact on a rigid plate; a line on what it costs if it is not
    compiled, else nothing. Raises SceneError if it fails or does not answer."""
    law = loaded_law(setup)
    if law.name in shipped():
        return ""
    about = law_context(setup)
    try:
        with given_up_in_time(_PREPARED_S):
            _check_prepared(law, setup, about)
    except LawTimeout:
        raise SceneError(
            f"law {law.name}: was not prepared within {_PREPARED_S:g} s. Check it for an endless "
            "loop."
        ) from None
    bound = bound_law(setup, True)
    samples = impact_samples(setup, about)
    # The child may be killed: what it unpacks goes with this folder.
    with own_folder() as folder:
        problem = _in_child(bound, samples, setup, folder)
    if problem:
        raise SceneError(problem)
    notes = [law.identity_note()]
    if isinstance(bound, BoundPython) and bound.trouble:
        if bound.trouble.startswith("NameError"):  # Python says so only when it gets there
            raise SceneError(f"law {bound.name}: {bound.trouble}. Correct the name, or define it.")
        cost_us = bound.cost_us(samples[:200])
        notes.append(
            f"the law {bound.name} runs as Python, {cost_us:.1f} us a sample instead of about "
            f"0.01, because Numba says: {bound.trouble}"
        )
    return "\n".join(filter(None, notes))


def _check_prepared(law: Law, setup: Setup, about: LawContext) -> None:
    """Refuse a law that is not the same, or prepares other constants, a second time. Raises
    SceneError."""
    remedy = "Use no random numbers and no clock there."
    if law.identity is not None:
        again = load_anew(setup.law_reference)
        assert again.identity is not None
        if changed := law.identity.changed(again.identity):
            raise SceneError(
                f"law {law.name}: {changed} has another value each time that the law is loaded. "
                f"{remedy}"
            )
    keys = setup.scene.controller.keys
    with suppress(LawError):  # it is told when the law is bound
        one, other = (_numbers(law.constants(keys, about)) for _ in range(2))
        if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True)):
            raise SceneError(
                f"law {law.name}: prepare returns other constants the second time. {remedy}"
            )


def _numbers(constants: Any) -> list[np.ndarray]:
    """The values of a law's constants, from a NamedTuple or by name."""
    values = constants.values() if isinstance(constants, Mapping) else constants
    return [np.asarray(value, float) for value in values]


@lru_cache(maxsize=64)
def check_repeatable(setup: Setup) -> None:
    """Refuse a law that answers the same samples with other commands the second time, in this
    process. Raises SceneError."""
    law = loaded_law(setup)
    if law.name in shipped():
        return
    about = law_context(setup)
    _check_prepared(law, setup, about)
    samples = impact_samples(setup, about)
    bound = bound_law(setup, True)
    first = _forces(bound, samples, setup.step_s, 0.0)
    if isinstance(first, BrokenPromise):  # a run may end before it comes to that
        raise SceneError(str(first))
    if problem := _unrepeatable(first, bound, samples, setup.step_s):
        raise SceneError(problem)
    if note := law.identity_note():
        warnings.warn(note, stacklevel=4)


def _unrepeatable(
    one: bytes | LawFault, bound: BoundLaw, samples: np.ndarray, step_s: float
) -> str:
    """One sentence on the first sample for which a law has another command the second time, each
    time from its first state; empty if there is none, or the law fails. `one`: its forces of the
    first time."""
    other = _forces(bound, samples, step_s, 0.0)
    if isinstance(one, LawFault) or isinstance(other, LawFault) or one == other:
        return ""
    first, second = np.frombuffer(one), np.frombuffer(other)
    step = int(np.flatnonzero(first != second)[0])  # a command acts from the next step on
    return (
        f"law {bound.name}: is not deterministic. With the same samples and a new state, its "
        f"command for sample {step - 1} is {first[step]:.9g} N the first time and "
        f"{second[step]:.9g} N the "
        "second. Make it a function of its keys, its state and its samples: keep what it remembers "
        "in State, and use no random numbers and no clock."
    )


def impact_samples(setup: Setup, about: LawContext) -> np.ndarray:
    """What the law would sense of an impact on a rigid plate."""
    contact = max(int(about.rigid_contact_s / about.sample_s), 4)
    before = min(_SAMPLES // 4, 200)
    phase = np.clip((np.arange(_SAMPLES) - before) / contact, 0.0, 1.0) * np.pi
    pulse = np.sin(phase)
    deepest = rigid_penetration_m(
        about.sphere_mass_kg, about.stiffness, about.impact_speed_m_s, about.exponent
    )
    away = np.arange(_SAMPLES) - before
    gap = np.where(away < 0, -away, np.maximum(away - contact, 0))
    return SENSED[setup.quantity].trial(
        Trial(
            gap_m=gap * about.impact_speed_m_s * about.sample_s - deepest * pulse,
            force_n=about.rigid_peak_n * pulse,
            velocity_m_s=-about.rigid_peak_n / about.impedance_n_s_m * pulse,
            sample_s=about.sample_s,
        )
    )


def _trial(bound: BoundLaw, samples: np.ndarray, step_s: float) -> str:
    """What a law does wrong, by itself or because it reads samples that it is not given. Raises
    SceneError as `_forces` does."""
    by_zero = _forces(bound, samples, step_s, 0.0)
    if isinstance(by_zero, LawFault):
        return str(by_zero)
    if problem := _unrepeatable(by_zero, bound, samples, step_s):
        return problem
    with suppress(LawTimeout), given_up_in_time(_IN_PYTHON_S):  # many times slower than compiled
        problem = bound.reads_unknown(samples)
        if problem:
            return problem
    if by_zero != _forces(bound, samples, step_s, math.nan):
        return (
            f"law {bound.name}: reads values before samples[0] or after samples[i], since its "
            "commands change with them. Read samples[0] to samples[i] only."
        )
    return ""


def _forces(bound: BoundLaw, samples: np.ndarray, step_s: float, beyond: float) -> bytes | LawFault:
    """The forces of a law, where it finds the number `beyond` before and after the samples that it
    is given; or how it failed. Raises SceneError for a law that changes its samples."""
    controller = Controller(bound, SignalPath(), step_s, _SAMPLES + 1, 1, 0)
    history = np.full(3 * (_SAMPLES + 1), beyond)[_SAMPLES + 1 : 2 * (_SAMPLES + 1)]
    controller.law_state = controller.law_state._replace(history=history)
    try:
        forces = controller.process(samples).forces
    except LawFault as error:
        return error
    changed = np.flatnonzero(history[: len(samples)] != samples)
    if len(changed):
        raise SceneError(
            f"law {bound.name}: changes samples[{changed[0]}], which it may only read. Keep what "
            "it changes in State."
        )
    return forces.tobytes()


def _in_child(bound: BoundLaw, samples: np.ndarray, setup: Setup, folder: str) -> str:
    """What a law does wrong with these samples, in a sentence; empty if nothing. `folder`: for
    its temporary files."""
    build_idle_controller()  # what is compiled here is no time of the law's
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        problem, tempfile.tempdir = "", folder
        try:
            problem = _trial(bound, samples, setup.step_s)
        except SceneError as error:
            problem = str(error)
        except BaseException as error:
            problem = f"law {bound.name}: failed: {error!r}"
        finally:
            os.write(writing, problem.encode()[:4000])
            os._exit(0)
    os.close(writing)
    try:
        ready, _, _ = select.select([reading], [], [], _PATIENCE_S)
        if not ready:
            return (
                f"law {bound.name}: did not answer {_SAMPLES} samples within "
                f"{_PATIENCE_S:g} s. Check it for an endless loop."
            )
        problem = os.read(reading, 4000).decode()
    finally:
        os.close(reading)
        by_signal = _kill_child(child)
    if not problem and by_signal:
        return f"law {bound.name}: ended its process by signal {by_signal}"
    return problem


def _kill_child(pid: int) -> int:
    """Kill a child process, wait for its end, and return the signal that had ended it before, or
    0."""
    os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    return 0 if number == signal.SIGKILL else number
