"""Make the problem of a fit from a scene, records and free keys."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from hertzloop.fitting.errors import FitError, RecordError
from hertzloop.fitting.fit.alignment import align
from hertzloop.fitting.fit.channel import (
    Channel,
    cut_late_samples,
    thin_samples,
    weight_equal_readings,
)
from hertzloop.fitting.fit.channel_preparation import prepare_channel
from hertzloop.fitting.fit.free_keys import (
    WITHOUT_CONTROL,
    FreeKey,
    drop_values,
    is_control_key,
    values_for_record,
)
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator, LoopSimulator
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.fitting.fit.simulated_impact import chain_of_record
from hertzloop.fitting.records.quantities import PLATE_QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.scene.setup import Setup

# Error of a record during contact over the noise, for 200 samples there, that its residual does not
# show: the square of the error times the root of the samples is what a test sees.
_HIDDEN, _AT_SAMPLES = 0.1, 200.0
# Accuracy of the modes in the noise over the peak: the gap is as exact as it says, the plate's
# velocity at the contact point ten times less, its acceleration a hundred times less.
_ACCURACY = {"v_p": 0.03, "acceleration": 0.003}
_ACCURACY_OF_GAP = 0.3
_FINEST, _COARSEST = 3e-5, 1e-3


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


def refuse_mixed_clocks(records: Sequence[Record], controlled: Sequence[bool]) -> None:
    """Raise RecordError for records of one clock that cannot be of one impact."""
    clocks: dict[str, tuple[Any, ...]] = {}
    for record, under in zip(records, controlled, strict=True):
        kind = under, dict(record.measurement.set)
        if record.clock and clocks.setdefault(record.clock, kind) != kind:
            raise RecordError(
                f"{record.name}: has another control or set than another record of "
                f"'{record.clock}'. Records of one file or clock are of one impact."
            )


def refuse_unknown_loop(setup: Setup) -> None:
    """Raise RecordError for a loop of which no two runs are alike, or without a law."""
    control, sensors = setup.scene.controller, setup.scene.sensors
    if not setup.scene.controller.has_law:
        raise RecordError(
            "controller.law = off: a record is under control. Name the law, --set "
            "controller.law=NAME, or write control = false in the record table."
        )
    chance: dict[str, Any] = {
        "controller.jitter_us": control.jitter_us,
        "controller.clock_ppm": control.clock_ppm,
        "controller.drop_out_probability": control.drop_out_probability,
        "controller.latency_trace": control.latency_trace,
        "sensors.fault": sensors.fault,
    }
    for key, value in chance.items():
        if value:
            raise RecordError(
                f"{key} = {value}: a fit simulates one run, and what chance or a fault did in it "
                "is not known. Leave the key out."
            )


def refuse_incomparable(record: Record, setup: Setup) -> None:
    """Raise RecordError for a record that the simulation under a law cannot be compared with."""
    measurement, actuator = record.measurement, setup.mechanics.actuator
    if measurement.point_m is not None:
        raise RecordError(
            f"record.point_m = {list(measurement.point_m)}: under a law {record.name} must be of "
            "the contact point or of the actuator's force."
        )
    held = actuator.bandwidth_hz is None
    filtered = measurement.low_pass_hz is not None or measurement.resonance_hz is not None
    if record.quantity == "actuator_force" and held and not filtered:
        raise RecordError(
            f"{record.name}: without a bandwidth the actuator's force jumps at every step, which "
            "no sensor shows. Give actuator.bandwidth_hz, or record.low_pass_hz, the bandwidth of "
            "the sensor."
        )
    moving = [
        q for q in (record.quantity, setup.scene.sensors.quantity) if q in ("v_p", "acceleration")
    ]
    if moving and held:
        raise RecordError(
            f"{record.name}: without a bandwidth the actuator's force jumps at every step, and the "
            f"{moving[0]} that is {'recorded' if moving[0] == record.quantity else 'fed back'} "
            "jumps with it, by as much as the plate has modes. Give actuator.bandwidth_hz."
        )


def check_actuator_acts(problem: FitProblem, values: dict[str, float]) -> None:
    """Raise FitError for keys of the law where no actuator acts in any record."""
    asked = [f.key for f in problem.free if is_control_key(f.key)]
    of_force = [c.record for c in problem.channels if c.record.quantity == "actuator_force"]
    if not asked and not of_force:
        return
    end_s = problem.longest_s
    for c, one in zip(problem.channels, problem.simulators, strict=True):
        if isinstance(one, LoopSimulator) and one.acts(values_for_record(values, c.record), end_s):
            return
    what = f"--free {asked[0]}" if asked else of_force[0].name
    raise FitError(
        f"{what}: not identifiable, as the actuator never acts in the simulated records at the "
        "starting values. Check the law and its threshold, the latency, and that the records last "
        "long enough."
    )


def control_notes(setup: Setup, names: list[str]) -> Iterator[str]:
    """Sentences on what a simulation under a law supposes of some records."""
    law = setup.scene.controller.law
    yield (
        f"{', '.join(names)}: simulated under the law '{law}'. Write control = false in the record "
        "table if the law was off."
    )
    if setup.scene.sensors.noise_rms:
        yield (
            f"sensors.noise_rms = {setup.scene.sensors.noise_rms:g}: taken as zero, since the "
            "noise that the law read is not known. What it does to the force counts as misfit."
        )


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


def check_sample_count(iterate: Iterate) -> None:
    """Raise RecordError if there are fewer samples than unknowns that no prior holds."""
    samples = sum(one.rows.stop - one.rows.start for one in iterate.channels)
    unknowns = len(iterate.x) - (iterate.prior_rows.stop - iterate.prior_rows.start)
    if samples <= unknowns:
        raise RecordError(
            f"the records have {samples} samples for {unknowns} unknowns. "
            "Record at a higher rate, or free fewer keys."
        )


def unique_names(records: Sequence[Record]) -> list[Record]:
    """Return the records, with a number behind each name that an earlier one has. Raises
    RecordError for a record that is given twice."""
    found: list[Record] = []
    for record in records:
        if any(record.repeats(other) for other in found):
            raise RecordError(
                f"{record.name}: is given twice, and would count twice. Name each record once."
            )
        name, count = record.name, 1
        while any(name == other.name for other in found):
            count += 1
            name = f"{record.name} ({count})"
        found.append(replace(record, name=name))
    return found
