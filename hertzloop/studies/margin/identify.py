"""Decide whether a law is linear, and find its transfer function.

Shipped feedback laws are read from their constants. Any other law is probed through its own
interface with ideal converters: zero input, superposition and proportionality over twelve orders
of magnitude. Then its impulse response is identified (Ho and Kalman 1966) and checked on other
samples.
"""

import timeit
from collections.abc import Callable

import numpy as np
import scipy

from hertzloop.common.changed_fields import changed_fields
from hertzloop.controller.controller import LINEAR_PATH_FIELDS, Controller, SignalPath
from hertzloop.controller.law_kernels import SAMPLES
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop.answering import answer_samples
from hertzloop.loop.stuck_law import watching
from hertzloop.scene.controller import bound_law, law_constants, loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.sensors.acquisition import LINEAR_FIELDS
from hertzloop.studies.margin.law_filters import Cascade
from hertzloop.studies.margin.linear import TransferFunction

_SAMPLES = 1500
_CHECKED = 12_000
_TIMED = 20
_MOST_PER_SAMPLE_S = 1e-3  # all test signals have some 60,000 samples
_HANKEL = 250
_TOLERANCE = 1e-9
_RANK = 1e-10
_AMPLITUDES = (1e-9, 1e-3, 1.0, 1e3)
# Fields of signal path and sensor that are known not to be linear.
_NOT_LINEAR = {
    "jitter_steps": "controller.jitter_us is not zero, so the signal path varies with time",
    "tick_steps": "controller.clock_ppm is not zero, so the signal path varies with time",
    "drop_out_probability": (
        "controller.drop_out_probability is not zero, so the signal path varies with time"
    ),
    "slew_n_s": "controller.slew_n_s limits the slope of the force",
    "trace": "controller.latency_trace varies with time",
    "stuck_step": "actuator.stuck_from_s holds the force from a moment on",
    "fault": "sensors.fault changes samples",
}
_Answer = Callable[[np.ndarray], np.ndarray]  # forces of a law for samples


class NotLinearError(Exception):
    """The law is not linear; the message gives the reason."""


def law_filter(setup: Setup) -> TransferFunction:
    """Return the transfer function from a sample to the command of that sample.

    Raises:
        NotLinearError: the law, or the signal path behind it, is not linear.
    """
    if why := loaded_law(setup).not_linear:
        raise NotLinearError(why)
    for part, linear in ((setup.signal_path, LINEAR_PATH_FIELDS), (setup.sensor, LINEAR_FIELDS)):
        for name in changed_fields(part, but=linear):
            unknown = f"{name} = {getattr(part, name)} is not known to be linear"
            raise NotLinearError(_NOT_LINEAR.get(name, unknown))
    ideal = setup.vary({"sensors.bits": "ideal", "controller.bits": "ideal"})
    # A law that refuses the run when it is prepared has no margin in it either.
    declared = loaded_law(setup).response(setup.scene.controller.keys, law_constants(ideal))
    if declared is None:
        return probe(ideal)
    if declared.stages:
        return Cascade.of(declared)
    poles, residues = np.array([declared.poles, declared.residues], complex)
    return TransferFunction(poles, residues, np.array([declared.gain]))


def probe(setup: Setup) -> TransferFunction:
    """Identify the law of a setup with ideal converters. Raises NotLinearError."""
    answered: list[np.ndarray] = []  # counts of the law, for each test signal
    with (
        watching(setup, lambda: sum(int(counts[SAMPLES]) for counts in tuple(answered))),
        np.errstate(over="ignore", invalid="ignore"),  # of forces near the largest number
    ):
        return _probe(setup, answered)


def _probe(setup: Setup, answered: list[np.ndarray]) -> TransferFunction:
    bound = bound_law(setup, ahead=False)

    def answer(samples: np.ndarray) -> np.ndarray:
        count = len(samples)
        controller = Controller(bound, SignalPath(), setup.run.step_s, count + 2, 1, 0)
        answered.append(controller.law_state.counts)
        try:
            return answer_samples(controller, samples, commands_ahead=False).forces[-count:]
        except LawFault as error:
            raise NotLinearError(f"it fails on a test signal: {error}") from error

    scale = _amplitude(setup)
    answer(np.zeros(1))  # the first call may compile the law
    times_s = timeit.repeat(lambda: answer(np.zeros(_TIMED)), number=1, repeat=3)
    per_sample_s = min(times_s) / _TIMED  # a machine may be busy
    if per_sample_s > _MOST_PER_SAMPLE_S:
        raise NotLinearError(
            f"it takes {1e6 * per_sample_s:,.0f} us a sample, and is tried with test signals only "
            f"up to {1e6 * _MOST_PER_SAMPLE_S:,.0f}"
        )
    if np.any(answer(np.zeros(_SAMPLES)) != 0.0):
        raise NotLinearError("it commands a force at zero input")
    rng = np.random.default_rng(1)
    _check_linear(answer, scale, rng.standard_normal((2, _SAMPLES)))
    found = _realise(_impulse_response(answer, scale))
    test = rng.standard_normal(_CHECKED)
    expected = _filtered(found, test)
    real = answer(scale * test) / scale
    size = max(float(np.abs(real).max()), 1e-300)
    if not float(np.abs(real - expected).max()) <= 1e-7 * size:
        raise NotLinearError("no finite linear model reproduces it on random samples")
    return found


def _check_linear(answer: _Answer, scale: float, noise: np.ndarray) -> None:
    """Refuse a law that is not proportional or not additive, on signals of either sign."""
    for one, kind in (
        (noise[0], "random"),
        (np.abs(noise[0]), "positive"),
        (-np.abs(noise[0]), "negative"),
        (np.sin(np.linspace(0.0, 3.0, _SAMPLES)), "slow"),
    ):
        base = answer(scale * one)
        size = max(float(np.abs(base).max()), 1e-300)
        for factor in _AMPLITUDES:
            away = float(np.abs(answer(factor * scale * one) / factor - base).max())
            if not away <= _TOLERANCE * size:
                raise NotLinearError(
                    f"it is not proportional: {factor:g} times a {kind} input of {scale:.3g} gives "
                    f"a force that differs by {away / size:.1e}"
                )
        both = answer(scale * (one + noise[1]))
        rest = both - base - answer(scale * noise[1])
        if not float(np.abs(rest).max()) <= _TOLERANCE * max(size, float(np.abs(both).max())):
            raise NotLinearError("superposition fails: it is not additive")


def _impulse_response(answer: _Answer, scale: float) -> np.ndarray:
    """Return the answer to an impulse, shape (_SAMPLES,); refuse a law that varies with time."""

    def after(at: int) -> np.ndarray:
        impulse = np.zeros(_SAMPLES)
        impulse[at] = scale
        return answer(impulse)[at:] / scale

    markov = after(0)
    for at in (1, 7, 300):
        away = np.abs(after(at) - markov[: _SAMPLES - at]).max()
        if not away <= _TOLERANCE * max(float(np.abs(markov).max()), 1e-300):
            raise NotLinearError(f"it varies with time: an impulse at sample {at} differs")
    return markov


def _amplitude(setup: Setup) -> float:
    known = setup.law_context
    speed = known.impact_speed_m_s
    if setup.scene.sensors.quantity == "xi":
        return max(speed * known.rigid_contact_s, 1e-9)
    if setup.scene.sensors.quantity == "acceleration":
        return speed / known.rigid_contact_s
    return known.rigid_peak_n if setup.scene.sensors.quantity == "contact_force" else speed


def _realise(markov: np.ndarray) -> TransferFunction:
    """Ho-Kalman realisation of an impulse response, as poles and residues."""
    n = _HANKEL
    last = int(np.max(np.flatnonzero(markov), initial=0))
    if last <= n:  # a finite impulse response is what it says
        return TransferFunction.of_taps(*markov[: last + 1])
    hankel = scipy.linalg.hankel(markov[1 : n + 1], markov[n : 2 * n])
    shifted = scipy.linalg.hankel(markov[2 : n + 2], markov[n + 1 : 2 * n + 1])
    u, s, vt = np.linalg.svd(hankel)
    rank = int(np.sum(s > _RANK * s[0]))
    if rank > n // 2:
        raise NotLinearError(f"its order is above {n // 2}; the identification stops there")
    root = np.sqrt(s[:rank])
    a = (u[:, :rank] / root).T @ shifted @ (vt[:rank].T / root)
    b, c = (root[:, None] * vt[:rank])[:, 0], (u[:, :rank] * root)[0]
    poles, vectors = np.linalg.eig(a)
    if np.linalg.cond(vectors) > 1e8:
        raise NotLinearError("its poles coincide, and the margin needs distinct ones")
    residues = (c @ vectors) * np.linalg.solve(vectors, b.astype(complex))
    return TransferFunction(poles, residues, markov[:1])


def _filtered(law: TransferFunction, samples: np.ndarray) -> np.ndarray:
    total = scipy.signal.lfilter(law.fir, [1.0], samples).astype(complex)
    for pole, residue in zip(law.poles, law.residues, strict=True):
        total += scipy.signal.lfilter([0.0, residue], [1.0, -pole], samples.astype(complex))
    return np.asarray(total.real)
