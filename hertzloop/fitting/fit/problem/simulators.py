"""The simulators of the records of a fit, as exact as the noise of the records asks for."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from hertzloop.fitting.fit.channels.channel import Channel
from hertzloop.fitting.fit.keys.key_scope import drop_values, values_for_record
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.simulation.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.simulation.loop_simulator import LoopSimulator
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.scene.setup import Setup

# Error of a record during contact over the noise, for 200 samples there, that its residual does not
# show: the square of the error times the root of the samples is what a test sees.
_HIDDEN, _AT_SAMPLES = 0.1, 200.0


class _Kind(NamedTuple):
    """What channels of one simulator have in common: keys of the record table, point, and law."""

    given: tuple[tuple[str, Any], ...]
    point_m: tuple[float, float] | None
    looped: bool


def build_simulators(
    setup: Setup,
    channels: Sequence[Channel],
    looped: Sequence[bool],
    values: dict[str, float],
    accuracy: float,
) -> list[ImpactSimulator]:
    """Return the simulator of every channel.

    Channels of one impact and measuring point share one, so that one simulation serves them.

    Args:
        setup: the scene.
        channels: of the fit.
        looped: which of them are under the law.
        values: scene keys at which the modes of the plate are chosen.
        accuracy: relative error that leaving out modes may cause.
    """
    groups: dict[_Kind, list[Channel]] = {}
    kinds = []
    for c, under in zip(channels, looped, strict=True):
        measurement = c.record.measurement
        kinds.append(_Kind(tuple(sorted(measurement.set.items())), measurement.point_m, under))
        groups.setdefault(kinds[-1], []).append(c)
    found = {kind: _build(setup, kind, some, values, accuracy) for kind, some in groups.items()}
    return [found[kind] for kind in kinds]


def _build(
    setup: Setup,
    kind: _Kind,
    channels: Sequence[Channel],
    values: dict[str, float],
    accuracy: float,
) -> ImpactSimulator:
    """Return the simulator of channels of one kind."""
    duration_s = max(float(c.time_s[-1]) - c.onset_s + 20e-6 for c in channels)
    own_setup = setup.vary(dict(kind.given)) if kind.given else setup
    known = values_for_record(values, channels[0].record)
    if kind.looped:
        duration_s += 1e-6 * setup.latency_us
        return LoopSimulator(own_setup.vary(known), duration_s, accuracy)
    base = own_setup.vary(drop_values(known))
    contact_s = rigid_impact(base.mechanics.sphere, base.mechanics.contact).contact_s
    gains = [(c, _velocity_error_gain(c, contact_s)) for c in channels]
    errors = [_hidden_error(c, contact_s) / gain for c, gain in gains if gain]
    velocity_error = min(errors, default=None)
    return ImpactSimulator(base, duration_s, accuracy, kind.point_m, velocity_error=velocity_error)


def rebuild_simulators(setup: Setup, problem: FitProblem, values: dict[str, float]) -> FitProblem:
    """Return the problem with the modes of its plates chosen anew, at other values of its keys."""
    accuracy = problem.simulators[0].setup.run.accuracy
    looped = [simulator.looped for simulator in problem.simulators]
    simulators = build_simulators(setup, problem.channels, looped, values, accuracy)
    return replace(problem, simulators=simulators)


def _velocity_error_gain(channel: Channel, contact_s: float) -> float | None:
    """Error of a record at the contact point during contact, relative to its peak, over that of the
    plate's velocity; None of a record that the omitted modes hardly change, or without a limit.

    Of a velocity behind a first-order filter, whose derivative an acceleration is: 1.4 to 29 in 12
    simulated records with corners of 0.24 to 15 over the contact time, within 15 % of this line.
    """
    quantity, measurement = channel.record.quantity, channel.record.measurement
    if measurement.point_m is not None or channel.contact_unknown:
        return None
    if quantity == "acceleration":
        corner_hz = min(f for f in (measurement.low_pass_hz, measurement.resonance_hz) if f)
        return 1.0 + 1.75 * corner_hz * contact_s
    return 1.0 if quantity == "v_p" else None


def _hidden_error(channel: Channel, contact_s: float) -> float:
    """Error during contact that the residual of a record does not show, over the peak."""
    samples = max(contact_s / channel.interval_s, 1.0)
    return _HIDDEN * (_AT_SAMPLES / samples) ** 0.25 * channel.noise_over_peak


def visible_error(channel: Channel, simulator: ImpactSimulator) -> float:
    """Return the error of the simulation during contact over the noise of a channel, where a test
    of the residual would show it; else zero."""
    gain = _velocity_error_gain(channel, simulator.contact_s) or 0.0
    error = gain * simulator.velocity_error
    if error > 1.01 * _hidden_error(channel, simulator.contact_s):
        return error / channel.noise_over_peak
    return 0.0
