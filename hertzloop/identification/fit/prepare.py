"""Make the problem of a fit from a scene, records and free keys."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.channel import (
    Channel,
    align,
    prepare_channel,
    thin_samples,
    weight_equal_readings,
)
from hertzloop.identification.fit.errors import FitError
from hertzloop.identification.fit.free_keys import FreeKey
from hertzloop.identification.fit.frozen_models import (
    freeze_models,
    visible_error,
)
from hertzloop.identification.fit.hit_speeds import set_start_speeds
from hertzloop.identification.fit.hits import LONGEST_S
from hertzloop.identification.fit.loop_model import (
    LoopModel,
    control_notes,
    is_control_key,
    refuse_incomparable,
    refuse_unknown_loop,
)
from hertzloop.identification.fit.observation import chain_of_record
from hertzloop.identification.fit.problem import FitProblem, values_for_record
from hertzloop.identification.records.chain_keys import WITHOUT_CONTROL
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.quantities import PLATE_QUANTITIES
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup

# Accuracy of the modes in the noise over the peak: the gap is as exact as it says, the plate's
# velocity at the contact point ten times less, its acceleration a hundred times less.
_ACCURACY = {"v_p": 0.03, "acceleration": 0.003}
_ACCURACY_OF_GAP = 0.3
_FINEST, _COARSEST = 3e-5, 1e-3


def prepare_problem(setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]) -> FitProblem:
    """Return the problem of a fit, with its channels aligned and its models frozen.

    Args:
        setup: the scene to start from.
        records: at least one.
        free: the free keys, with their starting values.

    Raises:
        RecordError: a record cannot be used.
        SceneError: the scene cannot be simulated.
        FitError: the records cannot tell a key.
    """
    records = [with_measuring_point(record, setup) for record in records]
    looped = find_controlled(setup, records, free)
    _refuse_mixed_clocks(records, looped)
    channels = [prepare_channel(record) for record in records]
    start = {f.key: f.start for f in free}
    accuracy = _accuracy_of_modes(setup, channels)
    for c in channels:
        cut_late_samples(c)
    models = freeze_models(setup, channels, looped, start, accuracy)
    for c, model in zip(channels, models, strict=True):
        if not isinstance(model, LoopModel):
            c.coarse = visible_error(c, model)
    chains = [chain_of_record(c.record, setup) for c in channels]
    problem = FitProblem(list(free), channels, models, chains)
    set_start_speeds(problem, start)
    _align_channels(problem, start, setup.latency_us)
    if any(looped):
        _check_actuator_acts(problem, start)
        names = [c.record.name for c, under in zip(channels, looped, strict=True) if under]
        channels[looped.index(True)].notes += control_notes(setup, names)
    return problem


def _accuracy_of_modes(setup: Setup, channels: Sequence[Channel]) -> float:
    """Return the relative error that leaving out modes may cause, by the noise of the records."""
    accuracy = min(
        min(_ACCURACY.get(c.record.quantity, _ACCURACY_OF_GAP) * c.noise_over_peak, _COARSEST)
        for c in channels
    )
    return min(max(accuracy, _FINEST), max(setup.accuracy, _FINEST))


def _align_channels(problem: FitProblem, start: dict[str, float], latency_us: float) -> None:
    """Find the touch in every channel, and thin out long ones.

    Channels of one clock share the touch of the first; records of the contact point come first.
    """
    channels, models = problem.channels, problem.models
    leaders: dict[str, Channel] = {}
    for index in sorted(range(len(channels)), key=lambda i: channels[i].elsewhere):
        c, model = channels[index], models[index]
        long_s = max(3.0 * model.contact_s, 30e-6)
        if isinstance(model, LoopModel):
            long_s += 1e-6 * latency_us
        if c.elsewhere:  # the wave has to arrive, and grow as it does in the record
            long_s = max(long_s, float(c.time_s[-1]) - c.onset_s)
        seen = problem.simulate_channel(index, dict(start), long_s)
        clock = c.record.measurement.clock
        if clock and clock in leaders:
            c.touch_s = leaders[clock].touch_s
        else:
            align(c, seen, model.contact_s)
            if clock:
                leaders[clock] = c
        thin_samples(c, model.contact_s)
        weight_equal_readings(c)


def with_measuring_point(record: Record, setup: Setup) -> Record:
    """Return a record with its measuring point: its own, or where the scene's sensor is.

    Raises RecordError for a point that the simulation does not know.
    """
    given, at_sensor = record.measurement.point_m, setup.mechanics.sensor_point_m
    if record.quantity not in PLATE_QUANTITIES:
        return record
    if given is not None and setup.structure.mode_table is not None:
        raise RecordError(
            f"record.point_m = {list(given)}: {setup.structure} know no points. Remove the key, "
            "and give the file a column shape_sensor if the record is not of the contact point."
        )
    at = given or at_sensor
    mass_kg = setup.actuator.mass_kg
    if at is not None and mass_kg and at != setup.mechanics.actuator_point_m:
        raise RecordError(
            f"actuator.mass_kg = {mass_kg:g}: not supported with {record.name} at "
            "another point than contact and actuator. Leave out the mass, or the record."
        )
    if at == given:
        return record
    return replace(record, measurement=replace(record.measurement, point_m=at))


def find_controlled(setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]) -> list[bool]:
    """Return which records were taken under the law.

    Raises:
        RecordError: a record or its loop cannot be simulated.
        FitError: keys of the law are free without such a record, or two keys in whole steps.
    """
    of_law = [f.key for f in free if is_control_key(f.key)]
    found = []
    for record in records:
        said = record.measurement.control
        if said is None:
            said = record.quantity == "actuator_force" or bool(of_law)
        elif not said and record.quantity == "actuator_force":
            raise RecordError(
                f"record.control = false: {record.name} holds the force of the actuator. Write "
                "control = true."
            )
        found.append(said)
        if said:
            of_record = (
                setup.vary(dict(record.measurement.set)) if record.measurement.set else setup
            )
            refuse_unknown_loop(of_record)
            refuse_incomparable(record, of_record)
    if of_law and not any(found):
        raise FitError(
            f"--free {of_law[0]}: cannot be fitted. {WITHOUT_CONTROL} Give a record of an "
            "impact under the law."
        )
    stepped = [f.key for f in free if f.resolution is not None]
    if len(stepped) > 1:
        raise FitError(
            f"--free {stepped[1]}: a fit finds one key in whole steps, and {stepped[0]} is one. "
            "Measure one of the two, and give it with --set."
        )
    return found


def _refuse_mixed_clocks(records: Sequence[Record], controlled: Sequence[bool]) -> None:
    """Raise RecordError for records of one clock that cannot be of one impact."""
    clocks: dict[str, tuple[Any, ...]] = {}
    for record, under in zip(records, controlled, strict=True):
        kind = under, dict(record.measurement.set)
        if record.measurement.clock and clocks.setdefault(record.measurement.clock, kind) != kind:
            raise RecordError(
                f"record.clock = '{record.measurement.clock}': records of one clock are of one "
                f"impact, but {record.name} has another control or set."
            )


def _check_actuator_acts(problem: FitProblem, values: dict[str, float]) -> None:
    """Raise FitError for keys of the law where no actuator acts in any record."""
    asked = [f.key for f in problem.free if is_control_key(f.key)]
    of_force = [c.record for c in problem.channels if c.record.quantity == "actuator_force"]
    if not asked and not of_force:
        return
    end_s = problem.longest_s
    for c, model in zip(problem.channels, problem.models, strict=True):
        if isinstance(model, LoopModel) and model.acts(values_for_record(values, c.record), end_s):
            return
    what = f"--free {asked[0]}" if asked else of_force[0].name
    raise FitError(
        f"{what}: not identifiable, as the actuator never acts in the simulated records at the "
        "starting values. Check the law and its threshold, the latency, and that the records last "
        "long enough."
    )


def cut_late_samples(channel: Channel) -> None:
    """Leave out samples later after the impact than a simulation is worth."""
    late = channel.time_s > channel.onset_s + LONGEST_S
    if np.any(late):
        channel.kept = channel.kept & ~late
        keep = ~late
        channel.time_s, channel.value = channel.time_s[keep], channel.value[keep]
        channel.kept = channel.kept[keep]
        channel.notes.append(
            f"{channel.record.name}: {np.count_nonzero(late)} samples later than "
            f"{1e3 * LONGEST_S:g} ms after the impact are not used."
        )
