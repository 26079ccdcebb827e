"""Make the problem of a fit from a scene, records and free keys."""

from collections.abc import Sequence
from dataclasses import replace

from hertzloop.fitting.fit.channels.alignment import align
from hertzloop.fitting.fit.channels.channel import Channel
from hertzloop.fitting.fit.channels.channel_preparation import prepare_channel
from hertzloop.fitting.fit.channels.sample_selection import (
    cut_late_samples,
    thin_samples,
    weight_equal_readings,
)
from hertzloop.fitting.fit.errors import FitError
from hertzloop.fitting.fit.keys.free_keys import FreeKey
from hertzloop.fitting.fit.keys.key_scope import values_for_record
from hertzloop.fitting.fit.problem.controlled_records import (
    check_actuator_acts,
    control_notes,
    find_controlled,
    refuse_mixed_clocks,
)
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.problem.simulators import build_simulators, visible_error
from hertzloop.fitting.fit.simulation.measuring_chain import chain_of_record
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.quantities import PLATE_QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

# Accuracy of the modes in the noise over the peak: the gap is as exact as it says, the plate's
# velocity at the contact point ten times less, its acceleration a hundred times less.
_ACCURACY = {"v_p": 0.03, "acceleration": 0.003}
_ACCURACY_OF_GAP = 0.3
_FINEST, _COARSEST = 3e-5, 1e-3


def prepare_problem(setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]) -> FitProblem:
    """Return the problem of a fit, with its channels aligned.

    Args:
        setup: the scene to start from.
        records: at least one.
        free: the free keys, with their starting values.

    Raises:
        RecordError: a record cannot be used.
        SceneError: the scene cannot be simulated.
        FitError: the records cannot tell a key.
    """
    for f in free:
        if not any(values_for_record({f.key: f.start}, record) for record in records):
            raise FitError(
                f"--free {f.key}: record.set holds it in {records[0].name}. Remove one of the two."
            )
    records = [with_measuring_point(record, setup) for record in records]
    looped = find_controlled(setup, records, free)
    refuse_mixed_clocks(records, looped)
    channels = [prepare_channel(record) for record in records]
    start = {f.key: f.start for f in free}
    accuracy = _accuracy_of_modes(setup, channels)
    for c in channels:
        cut_late_samples(c)
    simulators = build_simulators(setup, channels, looped, start, accuracy)
    for c, simulator in zip(channels, simulators, strict=True):
        if not simulator.looped:
            c.simulation_error = visible_error(c, simulator)
    chains = [chain_of_record(c.record, setup) for c in channels]
    problem = FitProblem(free=list(free), channels=channels, simulators=simulators, chains=chains)
    _align_channels(problem, start, setup.latency_us)
    if any(looped):
        check_actuator_acts(problem, start)
        names = [c.record.name for c, under in zip(channels, looped, strict=True) if under]
        channels[looped.index(True)].notes += control_notes(setup, names)
    return problem


def _accuracy_of_modes(setup: Setup, channels: Sequence[Channel]) -> float:
    """Return the relative error that leaving out modes may cause, by the noise of the records."""
    accuracy = min(
        min(_ACCURACY.get(c.record.quantity, _ACCURACY_OF_GAP) * c.noise_over_peak, _COARSEST)
        for c in channels
    )
    return min(max(accuracy, _FINEST), max(setup.run.accuracy, _FINEST))


def _align_channels(problem: FitProblem, start: dict[str, float], latency_us: float) -> None:
    """Find the touch in every channel, and thin out long ones.

    Channels of one clock share the touch of the first; records of the contact point come first.
    """
    channels = problem.channels
    leaders: dict[str, Channel] = {}
    for index in sorted(range(len(channels)), key=lambda i: channels[i].away_from_contact):
        c, simulator = channels[index], problem.simulators[index]
        long_s = max(3.0 * simulator.contact_s, 30e-6)
        if simulator.looped:
            long_s += 1e-6 * latency_us
        if c.away_from_contact:  # the wave has to arrive, and grow as it does in the record
            long_s = max(long_s, float(c.time_s[-1]) - c.onset_s)
        seen = problem.simulate_channel(index, dict(start), long_s)
        clock = c.record.clock
        if clock and clock in leaders:
            c.touch_s = leaders[clock].touch_s
        else:
            align(c, seen, simulator.contact_s)
            if clock:
                leaders[clock] = c
        thin_samples(c, simulator.contact_s)
        weight_equal_readings(c)


def with_measuring_point(record: Record, setup: Setup) -> Record:
    """Return a record with its measuring point: its own, or where the scene's sensor is.

    Raises RecordError for a point that the simulation does not know.
    """
    given, at_sensor = record.measurement.point_m, setup.mechanics.sensor_point_m
    if record.quantity not in PLATE_QUANTITIES:
        return record
    if given is not None and setup.mechanics.structure.mode_table is not None:
        raise RecordError(
            f"record.point_m = {list(given)}: {setup.mechanics.structure} know no points. Remove "
            "the key, and give the file a column shape_sensor if the record is not of the contact "
            "point."
        )
    if given is not None and setup.refusal({"plate.actuator_point_m": list(given)}):
        raise RecordError(
            f"record.point_m = {list(given)}: is not a point of the plate in {record.name}. Give "
            "two numbers within plate.size_m, m."
        )
    at = given or at_sensor
    mass_kg = setup.mechanics.actuator.mass_kg
    if at is not None and mass_kg and at != setup.mechanics.actuator_point_m:
        raise RecordError(
            f"actuator.mass_kg = {mass_kg:g}: not supported with {record.name} at "
            "another point than contact and actuator. Leave out the mass, or the record."
        )
    if at == given:
        return record
    return replace(record, measurement=replace(record.measurement, point_m=at))
