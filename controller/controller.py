"""A controller made from a description: law, latency line, converter."""

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from controller import kernels as k
from controller import law_kernels as laws

_JITTER_STREAM, _DROP_OUT_STREAM = 2, 3  # random streams; the sensor's noise is another


class Law(IntEnum):
    """Kinds of force laws."""

    OFF = laws.OFF
    SLOPE_THRESHOLD = laws.SLOPE_THRESHOLD
    CONSTANT = 100  # a profile of one value
    PROFILE = laws.PROFILE
    PREDICTED = laws.PREDICTED
    FEEDBACK = laws.FEEDBACK
    INTEGRAL_FEEDBACK = laws.INTEGRAL_FEEDBACK


class Mode(IntEnum):
    """States of a law. A profile that is over stays SPENT until the contact ends."""

    IDLE = laws.IDLE
    WATCHING = laws.WATCHING
    ACTING = laws.ACTING
    SPENT = laws.SPENT


@dataclass(frozen=True)
class LawSpec:
    """Parameters of a law.

    Slope threshold: `kappa` (1) scales s p^(3/2) with `stiffness` s (N/m^1.5), `v_thr_m_s`
    is the slope (m/s) at which the delay is latched, of a line through the last `window`
    samples (least squares). After the contact the force fades over `fade_samples`, if
    given; 0 ends it at once.
    Predicted: the same for what a sphere of `mass_kg` on an infinite plate of `impedance_n_s_m`
    (N s/m) will do in the next `lead_samples`; it watches below `watch_level`.
    Constant and profile: forces `profile_n` (N), one a sample from the first in contact on.
    Feedback: `gain` times the sample (N per its unit), or, integral, per its integral, which
    leaks with the corner `leak_hz`; samples up to `dead_zone` count as zero.
    A sample at or below `contact_level` counts as in contact. With a lead a threshold law or
    profile commands what is due `lead_samples` later.
    """

    law: Law
    stiffness: float
    kappa: float = 0.0
    v_thr_m_s: float = 0.0
    profile_n: tuple[float, ...] = ()
    contact_level: float = 0.0
    lead_samples: int = 0
    window: int = 2
    fade_samples: int | None = None
    watch_level: float = 0.0
    mass_kg: float = math.inf
    impedance_n_s_m: float = math.inf
    gain: float = 0.0
    leak_hz: float = 0.0
    dead_zone: float = 0.0


def law_model(spec: LawSpec, sample_s: float) -> laws.LawModel:
    """Compiled form of a law for samples `sample_s` apart (s)."""
    place = np.arange(spec.window) - 0.5 * (spec.window - 1)
    return laws.LawModel(
        law=int(Law.PROFILE if spec.law is Law.CONSTANT else spec.law),
        contact_level=spec.contact_level,
        watch_level=max(spec.watch_level, spec.contact_level),
        sample_s=sample_s,
        kappa=spec.kappa,
        v_thr_m_s=spec.v_thr_m_s,
        stiffness=spec.stiffness,
        mass_kg=spec.mass_kg,
        impedance_n_s_m=spec.impedance_n_s_m,
        profile=np.array(spec.profile_n, dtype=float),
        slope_weights=place / (np.sum(place * place) * sample_s),
        lead_samples=spec.lead_samples,
        fade_samples=-1 if spec.fade_samples is None else spec.fade_samples,
        gain=spec.gain,
        keep=math.exp(-2.0 * math.pi * spec.leak_hz * sample_s),
        dead_zone=spec.dead_zone,
    )


@dataclass(frozen=True)
class LineSpec:
    """What lies between law and actuator.

    The command of the sample at step j acts from step j + 1 + latency_steps + jitter on,
    jitter uniform over 0..jitter_steps; a command is lost with `drop_out_probability` and
    the last force is then held. `bits` and `full_scale_n` (N) describe the converter, None
    means ideal or unlimited; `slew_n_s` limits the rate of the force (N/s).
    """

    latency_steps: int = 0
    jitter_steps: int = 0
    drop_out_probability: float = 0.0
    bits: int | None = None
    full_scale_n: float | None = None
    slew_n_s: float | None = None


@dataclass
class Reply:
    """What a block of samples led to: forces from `first_step` on, and what may be relied on."""

    first_step: int
    forces: np.ndarray
    samples_seen: int
    promise_zero: bool
    promise_level: float
    modes: np.ndarray = field(repr=False)  # mode and delay after every sample of the block
    delays: np.ndarray = field(repr=False)


class Controller:
    """Law and line for a run of `steps` steps, sampled every `every_steps` steps."""

    def __init__(
        self, law: LawSpec, line: LineSpec, step_s: float, steps: int, every_steps: int, seed: int
    ) -> None:
        samples = -(-steps // every_steps)
        self.law = law_model(law, every_steps * step_s)
        self.law_state = laws.LawState(
            np.zeros(laws.LAW_COUNTS, np.int64), np.zeros(samples), np.zeros(1)
        )
        jitter, dropped = np.empty(0, np.int64), np.empty(0, np.bool_)
        if line.jitter_steps > 0:
            jitter = _random(seed, _JITTER_STREAM).integers(0, line.jitter_steps + 1, samples)
        if line.drop_out_probability > 0.0:
            dropped = _random(seed, _DROP_OUT_STREAM).random(samples) < line.drop_out_probability
        full_scale = line.full_scale_n or 0.0
        if line.bits is not None and line.full_scale_n is None:
            raise ValueError("a converter with bits needs a full-scale force")
        last_code = 2 ** (line.bits - 1) - 1 if line.bits is not None else 0
        self.line = k.LineModel(
            every_steps=every_steps,
            latency_steps=line.latency_steps,
            jitter_steps=jitter,
            dropped=dropped,
            ideal=line.bits is None,
            limited=line.full_scale_n is not None,
            full_scale_n=full_scale,
            lsb_n=full_scale / last_code if last_code else 1.0,
            last_code=last_code,
            slew_n=math.inf if line.slew_n_s is None else line.slew_n_s * step_s,
        )
        self.line_state = k.LineState(
            np.full(steps, np.nan), np.zeros(k.LINE_COUNTS, np.int64), np.zeros(2)
        )
        self.forces = np.zeros(steps)

    def process(self, values: np.ndarray, look_ahead: bool = True) -> Reply:
        """Feed samples; the forces that became final, those known ahead included if asked."""
        first = int(self.line_state.counts[k.EMITTED])
        modes = np.empty(len(values), np.int64)
        delays = np.empty(len(values), np.int64)
        k.control_block(
            self.law, self.law_state, self.line, self.line_state, values, self.forces, modes, delays
        )
        if look_ahead:
            k.grant_ahead(self.law, self.law_state, self.line, self.line_state, self.forces)
        end = int(self.line_state.counts[k.EMITTED])
        return Reply(
            first_step=first,
            forces=self.forces[first:end],
            samples_seen=int(self.law_state.counts[laws.SAMPLES]),
            promise_zero=bool(k.promises_zero(self.law, self.law_state, self.line_state)),
            promise_level=self._promise_level(),
            modes=modes,
            delays=delays,
        )

    def _promise_level(self) -> float:
        if self.law.law == laws.OFF:
            return -math.inf
        predicts = self.law.law == laws.PREDICTED
        return float(self.law.watch_level if predicts else self.law.contact_level)


def _random(seed: int, stream: int) -> np.random.Generator:
    """Reproducible numbers: a function of seed, stream and position only."""
    return np.random.Generator(np.random.Philox(key=[seed, stream]))
