"""Records that were taken under a law: which they are, and whether a fit can use them."""

from collections.abc import Iterator, Sequence
from typing import Any

from hertzloop.fitting.fit.errors import FitError
from hertzloop.fitting.fit.keys.free_keys import FreeKey
from hertzloop.fitting.fit.keys.key_scope import is_control_key, values_for_record
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.simulation.loop_simulator import LoopSimulator
from hertzloop.fitting.records.chain_keys import WITHOUT_CONTROL
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup


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
