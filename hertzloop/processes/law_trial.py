"""A law that is not shipped, tried with some hundred samples before a run.

The command line tries it in a child process, since it may hang or crash; Python in its own.
"""

import math
import mmap
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
from hertzloop.controller.law_kernels import LAW_COUNTS, SAMPLES
from hertzloop.controller.loading.bound import BoundLaw, BoundPython, LawFault
from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.records import seen_values
from hertzloop.controller.loading.registry import load_anew, shipped
from hertzloop.plant.contact.hertz import rigid_penetration_m
from hertzloop.scene.controller import bound_law, build_idle_controller, law_context, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED, Trial
from hertzloop.scene.setup import Setup

_SAMPLES = 400
_BEFORE = 100  # of these, before the impact
_PATIENCE_S = 6.0  # for all samples, three times
_IN_PYTHON_S = 2.0
_PREPARED_S = 60.0  # what a law prepares may take kernels that have to be compiled first
_TIMED = 20  # samples whose cost is measured


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
    bound, samples = bound_law(setup, True), impact_samples(setup, about)
    # The child may be killed: what it unpacks goes with this folder.
    with own_folder() as folder:
        if problem := _in_child(bound, samples, setup.run.step_s, folder):
            raise SceneError(problem)
    notes = [law.identity_note()]
    if isinstance(bound, BoundPython) and bound.trouble:
        if bound.trouble.startswith("NameError"):  # Python says so only when it gets there
            raise SceneError(f"law {bound.name}: {bound.trouble}. Correct the name, or define it.")
        notes.append(
            f"the law {bound.name} runs as Python, {bound.cost_us(samples[:_TIMED]):.1f} us a "
            f"sample instead of about 0.01, because Numba says: {bound.trouble}"
        )
    return "\n".join(filter(None, notes))


@lru_cache(maxsize=64)
def check_repeatable(setup: Setup) -> None:
    """Try a law in this process. Raises SceneError."""
    law = loaded_law(setup)
    if law.name in shipped():
        return
    about = law_context(setup)
    _check_prepared(law, setup, about)
    if problem := _problem(bound_law(setup, True), impact_samples(setup, about), setup.run.step_s):
        raise SceneError(problem)
    if note := law.identity_note():
        warnings.warn(note, stacklevel=4)


def _check_prepared(law: Law, setup: Setup, about: LawContext) -> None:
    """Refuse a law that is not the same, or prepares other constants, a second time. Raises
    SceneError."""
    remedy = "Use no random numbers and no clock there."
    if law.identity is not None:
        again = load_anew(setup.scene.controller.law)
        assert again.identity is not None
        if changed := law.identity.changed(again.identity):
            raise SceneError(
                f"law {law.name}: {changed} has another value each time that the law is loaded. "
                f"{remedy}"
            )
    keys = setup.scene.controller.keys
    with suppress(LawError, TypeError):  # it is told when the law is bound
        one, other = (_values(law.constants(keys, about)) for _ in range(2))
        if not all(np.array_equal(a, b) for a, b in zip(one, other, strict=True)):
            raise SceneError(
                f"law {law.name}: prepare returns other constants the second time. {remedy}"
            )


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
        Trial(
            gap_m=gap * about.impact_speed_m_s * about.sample_s - deepest * pulse,
            force_n=about.rigid_peak_n * pulse,
            velocity_m_s=-about.rigid_peak_n / about.impedance_n_s_m * pulse,
            sample_s=about.sample_s,
        )
    )


def _problem(
    bound: BoundLaw, samples: np.ndarray, step_s: float, answered: np.ndarray | None = None
) -> str:
    """What a law does wrong with these samples, in a sentence; empty if nothing.

    `answered`: words that count the samples, for another process that looks.
    """
    try:
        first, second = (_forces(bound, samples, step_s, 0.0, answered) for _ in range(2))
        if first.tobytes() != second.tobytes():
            step = int(np.flatnonzero(first != second)[0])  # a command acts from the next step on
            return (
                f"law {bound.name}: is not deterministic. With the same samples and a new state, "
                f"its command for sample {step - 1} is {first[step]:.9g} N the first time and "
                f"{second[step]:.9g} N the second. Make it a function of its keys, its state and "
                "its samples: keep what it remembers in State, and use no random numbers and no "
                "clock."
            )
        with suppress(LawTimeout), given_up_in_time(_IN_PYTHON_S):  # far slower than compiled
            if problem := bound.reads_unknown(samples):
                return problem
    except LawFault as error:
        return str(error)
    # What lies beyond its samples reaches a command of C without an error.
    with suppress(LawFault):
        if first.tobytes() == _forces(bound, samples, step_s, math.nan, answered).tobytes():
            return ""
    return (
        f"law {bound.name}: reads values before samples[0] or after samples[i], since its "
        "commands change with them. Read samples[0] to samples[i] only."
    )


def _forces(
    bound: BoundLaw,
    samples: np.ndarray,
    step_s: float,
    beyond: float,
    answered: np.ndarray | None = None,
) -> np.ndarray:
    """The forces of a law, where it finds the number `beyond` before and after the samples that it
    is given. Raises LawFault, for a law that changes its samples as well."""
    controller = Controller(bound, SignalPath(), step_s, _SAMPLES + 1, 1, 0)
    history = np.full(3 * (_SAMPLES + 1), beyond)[_SAMPLES + 1 : 2 * (_SAMPLES + 1)]
    counts = controller.law_state.counts
    if answered is not None:
        answered[LAW_COUNTS] += answered[SAMPLES]
        answered[:LAW_COUNTS] = counts
        counts = answered[:LAW_COUNTS]
    controller.law_state = controller.law_state._replace(history=history, counts=counts)
    forces = controller.process(samples).forces.copy()
    changed = np.flatnonzero(history[: len(samples)] != samples)
    if len(changed):
        raise LawFault(
            f"law {bound.name}: changes samples[{changed[0]}], which it may only read. Keep what "
            "it changes in State."
        )
    return forces


def _in_child(bound: BoundLaw, samples: np.ndarray, step_s: float, folder: str) -> str:
    """What a law does wrong with these samples, in a sentence; empty if nothing. `folder`: for
    its temporary files."""
    build_idle_controller()  # what is compiled here is no time of the law's
    answered = np.frombuffer(mmap.mmap(-1, 8 * (LAW_COUNTS + 1)), np.int64)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        problem, tempfile.tempdir = "", folder
        try:
            problem = _problem(bound, samples, step_s, answered)
        except BaseException as error:
            problem = f"law {bound.name}: failed: {error!r}"
        finally:
            os.write(writing, problem.encode()[:4000])
            os._exit(0)
    os.close(writing)
    seen = []
    try:
        for _ in range(2):
            ready, _, _ = select.select([reading], [], [], _PATIENCE_S / 2)
            seen.append(int(answered[SAMPLES] + answered[LAW_COUNTS]))
            if ready:
                break
        else:
            return _too_slow(bound.name, *seen)
        problem = os.read(reading, 4000).decode()
    finally:
        os.close(reading)
        by_signal = _kill_child(child)
    if not problem and by_signal:
        return f"law {bound.name}: ended its process by signal {by_signal}"
    return problem


def _too_slow(name: str, half: int, whole: int) -> str:
    """Say what a law needs for a sample, by those that it had answered after the first half of the
    time and after all of it."""
    if whole == half:
        return (
            f"law {name}: did not answer sample {(whole - 1) % _SAMPLES} within "
            f"{_PATIENCE_S / 2:g} s. Check it for an endless loop."
        )
    return (
        f"law {name}: takes {0.5e6 * _PATIENCE_S / (whole - half):,.0f} us a sample; at most "
        f"{1e6 * _PATIENCE_S / (3 * _SAMPLES):,.0f} are supported. Let it do less, or write what "
        "Numba compiles."
    )


def _kill_child(pid: int) -> int:
    """Kill a child process, wait for its end, and return the signal that had ended it before, or
    0."""
    os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    return 0 if number == signal.SIGKILL else number
