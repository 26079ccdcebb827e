"""Fit scene keys to records: the check before, the solution, intervals, verdicts, hold-out."""

import difflib
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.channel import (
    Channel,
    align,
    make_ready,
    thinned,
    weighted,
    without_contact,
)
from hertzloop.identification.fit.discrepancy import PULSE, Rows, estimated, unknown
from hertzloop.identification.fit.hits import LONGEST_S, split
from hertzloop.identification.fit.loop_model import (
    LoopModel,
    acts_by_law,
    grain_us,
    notes_on,
    refuse_unknown_loop,
    refuse_unseen,
    why_not_free,
)
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.identification.fit.observation import Chain, chain_of, observe
from hertzloop.identification.fit.solve import (
    Free,
    Point,
    Problem,
    minimised,
    of_loop,
    own_values,
    reject_outliers,
)
from hertzloop.identification.fit.steps import (
    CERTAIN,
    Profile,
    expected,
    in_steps,
    profiled,
    searched,
    turned,
)
from hertzloop.identification.fit.verdicts import (
    NO_BOUND,
    NORMAL,
    WIDEST,
    Combination,
    Fitness,
    Model,
    Uncertainty,
    Verdict,
    bootstrapped,
    fitness,
    uncertainty,
)
from hertzloop.identification.records.records import (
    FILTERS,
    OF_PLATE,
    QUANTITIES,
    WITHOUT_CONTROL,
    Measured,
    Record,
    RecordError,
    of_chain,
)
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.key_value import value_of_key
from hertzloop.scene.setup import Setup

_STEPS_KNOWN = 1.5  # half-width in steps with which a key in whole steps is identified in any case
LONGEST_STEPS = 20  # of a key in whole steps, at least
_FACTOR, _LOSS_FACTOR, _PRESSURE_FACTOR = 5.0, 100.0, 20.0  # of a start, for default bounds
_PRESSURE = "contact.limiting_pressure_pa"
_NEAR_LIMIT = 1e-6  # of a logarithm: so near to the limit of a key a default range ends
_STARTS = (0.25, 0.45, 0.7)  # of the elastic centre pressure: above it, nothing yields
# Accuracy of the modes in the noise over the peak: the gap is as exact as it says, the plate's
# velocity at the contact point ten times less, its acceleration a hundred times less.
_ACCURACY = {"v_p": 0.03, "acceleration": 0.003}
_ACCURACY_OF_GAP = 0.3
_FINEST, _COARSEST = 3e-5, 1e-3
# Error of a record during contact over the noise, for 200 samples there, that its residual does not
# show: the square of the error times the root of the samples is what a test sees.
_HIDDEN, _AT_SAMPLES = 0.1, 200.0
_SPEEDS = (0.001, 45.0)  # of a hammer, m/s
_MOST_EXPECTED = 10_000_000  # samples of an expected record
_REFREEZE = 0.01  # change of a key's logarithm for which the model is frozen anew
_ROUNDS = 4  # of outliers
_ESTIMATES, _SETTLED = 3, 0.2  # of the model's error: most rounds, change that needs another one
_LAST_STAGES = 2  # minimisations after the windows, for the estimate of the time left
_YIELDED = 10.827566170662733  # at 99.9 %: yielding that is only probable sets no upper limit
_CLEAR = 30.0  # rise of chi-square beyond which the quadratic interval of a pressure is right
_ONE_SIDED = 2.705543454095404  # at 95 % on one side
# Of a search for a lower minimum: how much wider a shorter window leaves the keys, how far it looks
# and in what steps (standard deviations of the shorter and of the whole window), most points on a
# side, most minima, and by how much chi-square has to fall.
_BROADER, _ALONG_SD, _APART_SD = 8.0, 4.0, 10.0
_MOST_TRIED, _MOST_MINIMA, _LOWER = 20, 3, 4.0
_FARTHEST = 0.4  # of the logarithms of the keys
_LEAST_DRAWN = 0.25  # of a variance
_KNOWN_TO = 0.01  # relative standard deviation of a key measured by other means
_EXPECTED = re.compile(
    r"(?P<quantity>[a-z_]+):(?P<us>[0-9.eE+]+)us:(?P<noise>[0-9.eE+-]+)%(?::(?P<mhz>[0-9.eE+-]+)MHz)?"
)


class FitError(ValueError):
    """A key cannot be fitted as asked. The message says why."""

    exit_status = 2


@dataclass(frozen=True)
class Estimate:
    """An estimate of a free key.

    Attributes:
        key: scene key.
        value: estimate, in the unit of the key.
        low: lower end of the 95 % interval; None where it is open.
        high: upper end of the 95 % interval; None where it is open.
        verdict: identified, one-sided, not identifiable or at its bound.
        start: value of the scene before the fit.
        sd_log: standard deviation of the natural logarithm; None where it is unknown.
        prior_pull: distance from the prior in its standard deviations; None without a prior.
        alone_percent: half-width if all other keys were known, %.
        grain: distance of the values of a key in whole steps; None of another key.
    """

    key: str
    value: float
    low: float | None
    high: float | None
    verdict: Verdict
    start: float
    sd_log: float | None
    prior_pull: float | None = None
    alone_percent: float | None = None
    grain: float | None = None

    @property
    def half_width_percent(self) -> float | None:
        """Half the interval over the value, %."""
        if self.low is None or self.high is None or self.value == 0.0:
            return None
        return 50.0 * (self.high - self.low) / self.value


@dataclass(frozen=True)
class Nuisance:
    """Nuisance parameters and residual of a record: see the JSON.

    `off_percent`: residual over the peak: root mean square in the pulse and after it, and largest,
    %; None without samples there. `error_percent`: of the model, over the local signal, in the
    pulse and after it, %; zeros if the noise explains the residual.
    """

    record: str
    time_shift_s: float
    gain: float
    offset: float
    clock_ppm: float
    noise_rms: float
    residual_over_noise: float
    samples: int
    rejected: int
    off_percent: tuple[float | None, float | None, float | None]
    error_percent: tuple[float, float]


@dataclass(kw_only=True)
class FitResult:
    """The result of `fit`.

    Attributes:
        estimates: one per free key, in the order given.
        nuisances: time shift, clock error, gain and offset of each record.
        noise_rms: noise of the first record, in the SI unit of its quantity.
        residual_over_noise: residual of all records over their noise.
        model: verdict on the model.
        statistics: the tests behind the verdict, by name.
        reasons: sentences on the verdict.
        combinations: products of keys with their half-widths, the worst known first.
        measure_next: sentences on what to measure.
        hold_out: `residual_over_noise` of the held-out records; None without any.
        evaluations: number of simulations.
        wall_s: duration of the fit, s.
        covariance: covariance of the natural logarithms of the keys, shape (keys, keys).
        setup: setup with the fitted scene, `setup.scene`; None for a check.
        notes: sentences.
        speeds_m_s: least and largest impact speed of the records, m/s.
        records: the records.
        curves: measured and simulated values by record.
        checked_only: whether no fit was made.
    """

    estimates: list[Estimate]
    nuisances: list[Nuisance]
    noise_rms: float
    residual_over_noise: float
    model: Model
    statistics: dict[str, Any]
    reasons: list[str]
    combinations: list[Combination]
    measure_next: list[str]
    evaluations: int
    wall_s: float
    covariance: np.ndarray
    notes: list[str]
    speeds_m_s: tuple[float, float]
    hold_out: dict[str, Any] | None = None
    setup: Setup | None = None
    records: list[Record] = field(default_factory=list)
    curves: list[dict[str, np.ndarray]] = field(default_factory=list)
    checked_only: bool = False

    @property
    def identifiable(self) -> bool:
        """Whether the records determine every key at least on one side."""
        return all(e.verdict is not Verdict.NOT_IDENTIFIABLE for e in self.estimates)


def free_of(setup: Setup, text: str) -> Free:
    """Return a free key from `KEY[=LOW:HIGH][±PRIOR]`; +- may stand for ±, and a % after PRIOR.

    Raises:
        FitError: the text is not of this form, or the key is not one positive number.
    """
    head, sign, prior_text = text.replace("+-", "±").partition("±")
    key, equals, bounds = (part.strip() for part in head.partition("="))
    if not key:
        raise FitError(f"--free {text}: names no key. Write KEY, KEY=LOW:HIGH or KEY±PRIOR.")
    start = value_of(setup, key)
    grain = grain_us(setup, key)
    if grain is None:
        low, high = _bounds(setup, key, start)
    else:
        low, high = 0.0, max(_FACTOR * start, LONGEST_STEPS * grain)
    if equals:
        parts = bounds.split(":")
        try:
            low, high = (float(p) for p in parts)
        except ValueError as error:
            raise FitError(
                f"--free {text}: '{bounds}' is not a range. Write LOW:HIGH, two numbers."
            ) from error
        least = low >= 0.0 if grain else low > 0.0
        if not (least and low < high < math.inf):
            raise FitError(
                f"--free {text}: the range must be positive and rise. Write LOW:HIGH with LOW "
                "above zero."
            )
        first, last = in_steps(Free(key, start, low, high, None, grain))
        for end in (low, high) if grain is None else (first * grain, last * grain):
            why = setup.refusal({key: end})
            if why:
                raise FitError(f"--free {text}: {why}")
        if not low <= start <= high:
            start = math.sqrt(low * high) if grain is None else grain * round(high / grain / 2.0)
    prior = None
    if sign and grain is not None:
        raise FitError(
            f"--free {text}: a key in whole steps has no prior. Give it a range, {key}=LOW:HIGH."
        )
    if sign:
        try:
            given = float(prior_text.strip().rstrip("%"))
        except ValueError as error:
            raise FitError(
                f"--free {text}: '{prior_text}' is not a prior. Write a standard deviation in the "
                "unit of the key, or in %."
            ) from error
        prior = given / 100.0 if prior_text.strip().endswith("%") else given / start
        if not 0.0 < prior < math.inf:
            raise FitError(f"--free {text}: the prior must be a positive standard deviation.")
    return Free(key, start, low, high, prior, grain)


def value_of(setup: Setup, key: str) -> float:
    """Return the starting value of a key. Raises FitError unless it is one positive number."""
    table, _, last = key.partition(".")
    if last in _fields(setup, table) or (acts_by_law(key) and setup.has_law):
        _refuse_without_influence(setup, key)
    found = value_of_key(setup, key)
    if grain_us(setup, key) is not None and found is None and last == "dead_time_us":
        found = 0.0
    if grain_us(setup, key) is not None and isinstance(found, float) and found == 0.0:
        return found
    if table == "controller" and isinstance(found, int) and not isinstance(found, bool):
        raise FitError(f"--free {key}: is a whole number, {found}. Choose another key.")
    if isinstance(found, bool) or not isinstance(found, int | float) or not found > 0.0:
        raise FitError(f"--free {key}: {_why_not(setup, key, found)}")
    return float(found)


def _fields(setup: Setup, table: str) -> Mapping[str, Any]:
    """The keys of a table of the scene; none of a table that does not exist."""
    return getattr(type(getattr(setup.scene, table, None)), "model_fields", {})


def _refuse_without_influence(setup: Setup, key: str) -> None:
    """Raise FitError for a key of the scene that no record can tell."""
    table, _, last = key.partition(".")
    if acts_by_law(key):
        if not setup.has_law:
            raise FitError(
                f"--free {key}: cannot be fitted, as controller.law is off. {WITHOUT_CONTROL} Name "
                "the law that was on, --set controller.law=NAME."
            )
        why = why_not_free(key)
        if why is not None:
            raise FitError(f"--free {key}: cannot be fitted, as {why}.")
    if table == "run":
        raise FitError(
            f"--free {key}: is a choice of the simulation, not a property of the rig. Choose "
            "another key."
        )
    if table == "sensors" and last not in (*FILTERS, "mass_kg"):
        raise FitError(
            f"--free {key}: cannot be fitted. Of the sensor only mass_kg, {', '.join(FILTERS)} can "
            "be free; a fit finds noise, gain and offset by itself."
        )


def _why_not(setup: Setup, key: str, found: Any) -> str:
    table, _, last = key.partition(".")
    fields = _fields(setup, table)
    if table == "controller" and setup.has_law:
        fields = {**fields, **vars(setup.scene.controller.keys)}
    if last.partition(".")[0] not in fields:
        near = difflib.get_close_matches(last, fields, 1)
        hint = f"Did you mean {table}.{near[0]}?" if near else "See `hertzloop scene keys`."
        return f"is not a scene key. {hint}"
    if key == _PRESSURE:
        return (
            "the contact of the scene does not yield. Add --set contact.plasticity=thornton and "
            "--set contact.limiting_pressure_pa=VALUE."
        )
    if found is None:
        return "the scene has no value to start from. Give it one with --set."
    return f"is {found} in the scene, and must be one positive number. Choose another key."


def _bounds(setup: Setup, key: str, start: float) -> tuple[float, float]:
    factor = _FACTOR
    if key.endswith("loss_factor"):
        factor = _LOSS_FACTOR
    elif key == _PRESSURE:
        factor = _PRESSURE_FACTOR
    low, high = start / factor, start * factor
    if key.endswith(("loss_factor", "poisson", "restitution")):
        high = min(high, 0.49 if key.endswith("poisson") else 1.0)
    return _allowed(setup, key, start, low), _allowed(setup, key, start, high)


def _allowed(setup: Setup, key: str, start: float, end: float) -> float:
    """The end of a default range, or the value nearest to it that the scene can have."""
    if not setup.refusal({key: end}) or setup.refusal({key: start}):
        return end
    inner, outer = math.log(start), math.log(end)
    while abs(outer - inner) > _NEAR_LIMIT:
        middle = 0.5 * (inner + outer)
        if setup.refusal({key: math.exp(middle)}):
            outer = middle
        else:
            inner = middle
    return math.exp(inner)


def expected_record(
    setup: Setup, text: str, name: str = "expected record", control: bool | None = None
) -> Record:
    """Return a made-up record of the scene as it is, for a check before an experiment.

    Args:
        setup: the scene.
        text: `QUANTITY:DURATIONus:NOISE%[:RATEMHz]`, as `contact_force:70us:0.3%:2MHz`; the noise
            is a share of the peak.
        name: of the record.
        control: whether the law is on; by default for the force of the actuator alone.

    Raises:
        FitError: the text is not of this form.
    """
    match = _EXPECTED.fullmatch(text.strip())
    if match is None or match["quantity"] not in QUANTITIES:
        raise FitError(
            f"--expect {text}: is not QUANTITY:DURATIONus:NOISE%[:RATEMHz], such as "
            f"contact_force:70us:0.3%:2MHz. Known quantities: {', '.join(QUANTITIES)}."
        )
    duration_s, share = 1e-6 * _number(text, match["us"]), 0.01 * _number(text, match["noise"])
    step_s = 1e-6 / _number(text, match["mhz"] or "2")
    quiet_s = max(250 * step_s, 0.2e-3)
    samples = (duration_s + quiet_s) / step_s
    if duration_s > LONGEST_S or samples > _MOST_EXPECTED:
        raise FitError(
            f"--expect {text}: is a record of {1e3 * duration_s:.3g} ms with {samples:.3g} "
            f"samples. Suppose at most {1e3 * LONGEST_S:g} ms and {_MOST_EXPECTED:g} samples."
        )
    quantity = match["quantity"]
    under = quantity == "actuator_force" if control is None else control
    table = Measured(quantity=quantity, control=under)
    model: FrozenModel
    if under:
        refuse_unknown_loop(setup)
        refuse_unseen(Record(name, np.arange(8.0), np.ones(8), quantity, table), setup)
        model = LoopModel(setup, duration_s, 1e-4)
    else:
        model = FrozenModel(setup, duration_s, 1e-4)
    time_s = np.arange(-quiet_s, duration_s, step_s)
    clean = observe(model.run({}, duration_s), quantity, Chain(), False).value(time_s)
    noise = share * float(np.max(np.abs(clean)))
    # The noise has a known size and no influence on the answer; its seed makes it repeatable.
    noisy = clean + noise * np.random.default_rng(1).standard_normal(len(clean))
    return Record(name, time_s, noisy, quantity, table)


def _number(text: str, part: str) -> float:
    """A positive number in the text of an expected record. Raises FitError."""
    with suppress(ValueError):
        if 0.0 < float(part) < math.inf:
            return float(part)
    raise FitError(f"--expect {text}: '{part}' is not a positive number. Give one.")


def prepared(setup: Setup, records: Sequence[Record], free: Sequence[Free]) -> Problem:
    """Return the problem of a fit: channels ready and aligned, models frozen.

    Args:
        setup: the scene to start from.
        records: at least one.
        free: the free keys, with their starting values.

    Raises:
        RecordError, SceneError
    """
    records = [_placed(record, setup) for record in records]
    looped = _controlled(setup, records, free)
    channels = [make_ready(record) for record in records]
    start = {f.key: f.start for f in free}
    accuracy = min(
        min(_ACCURACY.get(c.record.quantity, _ACCURACY_OF_GAP) * c.noise_over_peak, _COARSEST)
        for c in channels
    )
    accuracy = min(max(accuracy, _FINEST), max(setup.accuracy, _FINEST))
    for c in channels:
        _cut(c)
    models = _frozen(setup, channels, looped, start, accuracy)
    for c, model in zip(channels, models, strict=True):
        if isinstance(model, LoopModel):
            continue
        error = (_sharpness(c, model.contact_s) or 0.0) * model.velocity_error
        if error > 1.01 * _hidden(c, model.contact_s):
            c.coarse = error / c.noise_over_peak
    chains = [chain_of(c.record, setup) for c in channels]
    problem = Problem(list(free), channels, models, chains)
    _start_speeds(problem, start)
    leaders: dict[str, Channel] = {}
    # The clock of a drop follows from what is at the contact point, if anything is.
    for index in sorted(range(len(channels)), key=lambda i: channels[i].elsewhere):
        c, model = channels[index], models[index]
        long_s = max(3.0 * model.contact_s, 30e-6)
        if isinstance(model, LoopModel):
            long_s += 1e-6 * setup.latency_us
        if c.elsewhere:  # the wave has to arrive, and grow as it does in the record
            long_s = max(long_s, float(c.time_s[-1]) - c.onset_s)
        leader = leaders.get(c.record.measured.clock or "")
        seen = problem.observed(index, dict(start), long_s)
        if leader is None:
            align(c, seen, model.contact_s)
            leaders[c.record.measured.clock or " "] = c
        else:
            c.touch_s = leader.touch_s
        thinned(c, model.contact_s)
        weighted(c)
    if any(looped):
        _check_acting(problem, start)
        names = [c.record.name for c, under in zip(channels, looped, strict=True) if under]
        channels[looped.index(True)].notes += notes_on(setup, names)
    return problem


def _placed(record: Record, setup: Setup) -> Record:
    """Return a record with its measuring point: its own, or where the scene's sensor is.

    Raises RecordError for a point that the simulation does not know.
    """
    given, at_sensor = record.measured.point_m, setup.mechanics.sensor_point_m
    if record.quantity not in OF_PLATE:
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
    return replace(record, measured=replace(record.measured, point_m=at))


def _controlled(setup: Setup, records: Sequence[Record], free: Sequence[Free]) -> list[bool]:
    """Which records were taken under the law. Raises RecordError, FitError."""
    of_law = [f.key for f in free if acts_by_law(f.key)]
    found = []
    for record in records:
        said = record.measured.control
        if said is None:
            said = record.quantity == "actuator_force" or bool(of_law)
        elif not said and record.quantity == "actuator_force":
            raise RecordError(
                f"record.control = false: {record.name} holds the force of the actuator. Write "
                "control = true."
            )
        found.append(said)
        if said:
            of_record = setup.vary(dict(record.measured.set)) if record.measured.set else setup
            refuse_unknown_loop(of_record)
            refuse_unseen(record, of_record)
    if of_law and not any(found):
        raise FitError(
            f"--free {of_law[0]}: cannot be fitted. {WITHOUT_CONTROL} Give a record of an "
            "impact under the law."
        )
    stepped = [f.key for f in free if f.grain is not None]
    if len(stepped) > 1:
        raise FitError(
            f"--free {stepped[1]}: a fit finds one key in whole steps, and {stepped[0]} is one. "
            "Measure one of the two, and give it with --set."
        )
    clocks: dict[str, tuple[Any, ...]] = {}
    for record, under in zip(records, found, strict=True):
        kind = under, dict(record.measured.set)
        if record.measured.clock and clocks.setdefault(record.measured.clock, kind) != kind:
            raise RecordError(
                f"record.clock = '{record.measured.clock}': records of one clock are of one "
                f"impact, but {record.name} has another control or set."
            )
    return found


def _check_acting(problem: Problem, values: dict[str, float]) -> None:
    """Raise FitError for keys of the law where no actuator acts in any record."""
    asked = [f.key for f in problem.free if acts_by_law(f.key)]
    of_force = [c.record for c in problem.channels if c.record.quantity == "actuator_force"]
    if not asked and not of_force:
        return
    end_s = problem.longest_s
    for c, model in zip(problem.channels, problem.models, strict=True):
        if isinstance(model, LoopModel) and model.acts(own_values(values, c.record), end_s):
            return
    what = f"--free {asked[0]}" if asked else of_force[0].name
    raise FitError(
        f"{what}: not identifiable, as the actuator never acts in the simulated records at the "
        "starting values. Check the law and its threshold, the latency, and that the records last "
        "long enough."
    )


def _frozen(
    setup: Setup, channels: Sequence[Channel], looped: Sequence[bool], values: dict[str, float],
    accuracy: float,
) -> list[FrozenModel]:  # fmt: skip
    """The frozen model of every channel; channels of one drop and measuring point share one, so
    that a simulation serves them all."""

    def kind(c: Channel, under: bool) -> Any:
        return tuple(sorted(c.record.measured.set.items())), c.record.measured.point_m, under

    kinds = [kind(c, under) for c, under in zip(channels, looped, strict=True)]
    durations: dict[Any, float] = {}
    firsts: dict[Any, Record] = {}
    for c, of_channel in zip(channels, kinds, strict=True):
        firsts.setdefault(of_channel, c.record)
        duration_s = float(c.time_s[-1]) - c.onset_s + 20e-6
        if of_channel[2]:
            duration_s += 1e-6 * setup.latency_us
        durations[of_channel] = max(durations.get(of_channel, 0.0), duration_s)
    models: dict[Any, FrozenModel] = {}
    for (given, point_m, under), duration_s in durations.items():
        of_record = setup.vary(dict(given)) if given else setup
        known = own_values(values, firsts[given, point_m, under])
        if under:
            models[given, point_m, under] = LoopModel(of_record.vary(known), duration_s, accuracy)
            continue
        base = of_record.vary({k: v for k, v in known.items() if not of_loop(k)})
        contact_s = rigid_impact(base.sphere, base.contact).contact_s
        sharp = [
            (c, _sharpness(c, contact_s))
            for c, of_channel in zip(channels, kinds, strict=True)
            if of_channel == (given, point_m, under)
        ]
        errors = [_hidden(c, contact_s) / times for c, times in sharp if times]
        models[given, point_m, under] = FrozenModel(
            base, duration_s, accuracy, point_m, velocity_error=min(errors, default=None)
        )
    return [models[of_channel] for of_channel in kinds]


def _sharpness(channel: Channel, contact_s: float) -> float | None:
    """Error of a record at the contact point during contact, relative to its peak, over that of the
    plate's velocity; None of a record that the omitted modes hardly change, or without a limit.

    Of a velocity behind a first-order filter, whose derivative an acceleration is: 1.4 to 29 in 12
    simulated records with corners of 0.24 to 15 over the contact time, within 15 % of this line.
    """
    quantity, measured = channel.record.quantity, channel.record.measured
    if measured.point_m is not None or channel.contact_unknown:
        return None
    if quantity == "acceleration":
        corner_hz = min(f for f in (measured.low_pass_hz, measured.resonance_hz) if f)
        return 1.0 + 1.75 * corner_hz * contact_s
    return 1.0 if quantity == "v_p" else None


def _hidden(channel: Channel, contact_s: float) -> float:
    """Error during contact that the residual of a record does not show, over the peak."""
    samples = max(contact_s / channel.interval_s, 1.0)
    return _HIDDEN * (_AT_SAMPLES / samples) ** 0.25 * channel.noise_over_peak


def _cut(channel: Channel) -> None:
    """Leave out what is later than a simulation is worth."""
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


def check(setup: Setup, records: Sequence[Record], free: Sequence[Free]) -> FitResult:
    """Report what records can tell about keys, at the starting values and without a fit.

    Raises:
        RecordError, SceneError, FitError
    """
    began = time.perf_counter()
    records = split(_named_apart(records), setup)
    _refuse_twice(free)
    free = _with_speeds(setup, records, free)
    problem = prepared(setup, records, free)
    until_s = problem.windows_s()[-1]
    stepped, profile = problem.stepped, None
    if stepped is not None:
        problem = replace(problem, fixed={stepped.key: stepped.start})
    point = problem.point(problem.start(), until_s, early=False)
    if stepped is not None:
        profile = expected(problem, point, until_s)
    _check_rows(point)
    known = uncertainty(problem, point)
    estimates = [
        _estimate(f, f.start, float(sd), float(alone), None)
        for f, sd, alone in zip(problem.moving, known.sd, known.alone, strict=True)
    ]
    estimates = _with_steps(problem, estimates, known, profile)
    fits = Fitness(Model.CANNOT_TELL, math.nan)
    fits.reasons.append("This is a check before a fit: nothing was fitted.")
    return FitResult(
        **_common(problem, point, point, until_s, known, fits), estimates=estimates,
        evaluations=problem.evaluations, wall_s=time.perf_counter() - began,
        notes=_notes(problem, setup), speeds_m_s=_speeds(problem, {}), records=list(records),
        checked_only=True,
    )  # fmt: skip


def _common(
    problem: Problem, point: Point, plain: Point, until_s: float, known: Uncertainty, fits: Fitness
) -> dict[str, Any]:
    """What fit and check have in common, by name; `plain` is the point of an exact model."""
    return {
        "nuisances": _nuisances(problem, plain, until_s), "noise_rms": problem.channels[0].noise,
        "residual_over_noise": fits.residual_over_noise, "model": fits.verdict,
        "statistics": fits.as_json(), "reasons": fits.reasons, "covariance": known.covariance,
        "combinations": known.combinations, "measure_next": _next(problem, point, known),
    }  # fmt: skip


def _named_apart(records: Sequence[Record]) -> list[Record]:
    """The records, those with a name that another one has with a number behind it."""
    found: list[Record] = []
    for record in records:
        name, count = record.name, 1
        while any(name == other.name for other in found):
            count += 1
            name = f"{record.name} ({count})"
        found.append(replace(record, name=name))
    return found


def _refuse_twice(free: Sequence[Free]) -> None:
    keys = [f.key for f in free]
    for key in keys:
        if keys.count(key) > 1:
            raise FitError(f"--free {key}: is given twice. Name each key once.")


def _without_held(
    records: Sequence[Record], hold_out: Sequence[Record | int] | None, setup: Setup
) -> tuple[list[Record], list[Record]]:
    """The records to fit, and those to compare: hits by number, and other records. Raises
    FitError."""
    hits = sorted({one.hit for one in records if one.hit})
    if hold_out is None:
        hold_out = hits[-1:] if len(hits) > 1 else []
    numbers = {one for one in hold_out if isinstance(one, int)}
    if numbers - set(hits) or (numbers and numbers == set(hits)):
        raise FitError(
            f"--hold-out {min(numbers)}: cannot be held out. The hits are "
            f"{', '.join(map(str, hits)) or 'not several'}; at least one is fitted."
        )
    others = split([one for one in hold_out if isinstance(one, Record)], setup)
    fitted = [one for one in records if one.hit not in numbers]
    return fitted, [one for one in records if one.hit in numbers] + others


def _with_speeds(setup: Setup, records: Sequence[Record], free: Sequence[Free]) -> list[Free]:
    """The free keys, with the speed of the striker once for each of several hits."""
    key, _ = _speed_key(setup)
    own = _speeds_of_hits(setup, records, free, 2)
    return [*(f for f in free if not own or f.key != key), *own]


def _speeds_of_hits(
    setup: Setup, records: Sequence[Record], free: Sequence[Free], fewest: int
) -> list[Free]:
    """The speed of every hit, from a number of hits on: always of a hammer, and of a sphere if its
    speed is free."""
    key, hammer = _speed_key(setup)
    named = next((f for f in free if f.key.partition("[")[0] == key), None)
    hits = {one.hit: one for one in records if one.hit}
    if len(hits) < fewest or not (named or hammer):
        return []
    own = named or free_of(setup, f"{key}={_SPEEDS[0]:g}:{_SPEEDS[1]:g}")
    return [
        replace(own, key=f"{key}[{hit}]")
        for hit, one in hits.items()
        if key not in one.measured.set
    ]


def _speed_key(setup: Setup) -> tuple[str, bool]:
    """The scene's key for the speed of the striker, and whether this is a hammer."""
    hammer, sphere = setup.scene.hammer is not None, setup.scene.sphere
    by_speed = sphere is not None and sphere.speed_m_s is not None
    name = (
        "hammer.speed_m_s" if hammer else f"sphere.{'speed_m_s' if by_speed else 'drop_height_m'}"
    )
    return name, hammer


def _start_speeds(problem: Problem, start: dict[str, float]) -> None:
    """Begin with the speed of a hammer that gives the peak of its first record: nobody measures
    it."""
    done: set[str] = set()
    for index, (c, model) in enumerate(zip(problem.channels, problem.models, strict=True)):
        for place, f in enumerate(problem.free):
            mine = own_values({f.key: f.start}, c.record)
            if f.key in done or f.prior or "hammer.speed_m_s" not in mine or c.is_gap:
                continue
            done.add(f.key)
            seen = problem.observed(index, start, 3.0 * model.contact_s)
            largest = float(np.max(np.abs(seen.value(seen.simulated.time_s))))
            n = model.spec.contact.exponent
            speed = f.start * (c.peak / largest) ** (0.5 * (n + 1.0) / n)
            begun = replace(f, start=min(max(speed, 1.01 * f.low), 0.99 * f.high))
            problem.free = [*problem.free[:place], begun, *problem.free[place + 1 :]]
            start[f.key] = begun.start


def _notes(problem: Problem, setup: Setup) -> list[str]:
    found = [note for c in problem.channels for note in c.notes]
    keys = {f.key for f in problem.free}
    known = ("hammer.mass_kg", "hammer.tip_exponent")
    if "hammer.tip_stiffness" in keys and not keys & {*known}:
        values = " and ".join(
            f"{key} = {getattr(setup.scene.hammer, key.partition('.')[2]):g}" for key in known
        )
        found.append(
            f"hammer.tip_stiffness holds for {values}: hits of similar speeds show mass, exponent "
            "and stiffness of the tip, and how far the structure gives way, only as the length and "
            "the shape of one pulse. Weigh the hammer; hits of other speeds tell the exponent."
        )
    return found


def _check_rows(point: Point) -> None:
    if len(point.residual) <= len(point.x):
        raise RecordError(
            f"the records have {len(point.residual)} samples for {len(point.x)} unknowns. Record "
            "at a higher rate, or free fewer keys."
        )


def fit(
    setup: Setup, records: Sequence[Record], free: Sequence[Free],
    hold_out: Sequence[Record | int] | None = None,
    on_progress: Callable[[int, int], None] = lambda done, expected: None, exact: bool = False,
) -> FitResult:  # fmt: skip
    """Fit scene keys to records.

    Args:
        setup: the scene to start from, in which everything else is known.
        records: at least one; all share the keys.
        free: the keys to find.
        hold_out: records, or numbers of hits, that are only compared with the result; the last one
            of several hits if left out.
        on_progress: is told the number of simulations done and of those expected.
        exact: whether the model is taken as exact, so that only noise may spoil a record.

    Returns:
        Estimates with 95 % intervals, verdicts, and the fitted setup.

    Raises:
        RecordError: a record cannot be used.
        SceneError: the scene cannot be simulated.
        FitError: the question makes no sense.
    """
    if not records:
        raise FitError("no record is given. Give at least one.")
    if not free:
        raise FitError("no key is free. Name at least one with --free KEY.")
    _refuse_twice(free)
    began = time.perf_counter()
    records = split(_named_apart(records), setup)
    records, held_records = _without_held(records, hold_out, setup)
    free = _with_speeds(setup, records, free)
    problem = prepared(setup, records, free)
    tally, keys = problem.tally, len(problem.moving)
    tally.on_progress = on_progress
    if any(acts_by_law(f.key) for f in free):  # a record that does not say so is under the law
        held_records = [
            replace(r, measured=replace(r.measured, control=r.measured.control is not False))
            for r in held_records
        ]
    evaluations = 0
    looped = any(isinstance(model, LoopModel) for model in problem.models)
    if looped:
        problem = searched(problem)
    x = _best_start(problem)
    windows = problem.windows_s()
    shorter: list[tuple[float, np.ndarray]] = []
    for i, end in enumerate(windows[:-1]):
        tally.expect(len(windows) - i + _LAST_STAGES, keys)
        x = minimised(problem, x, end, early=True, steps=15, tolerance=1e-3).x
        shorter.append((end, x))
    until_s = windows[-1]
    tally.expect(1 + _LAST_STAGES, keys)
    point = minimised(problem, x, until_s, early=False, steps=15, tolerance=1e-3)
    tally.expect(_LAST_STAGES, keys)
    if not looped:
        point = _lowest(problem, point, windows)
    starts = [math.log(f.start) for f in problem.moving]
    moved = max((abs(v - s) for s, v in zip(starts, point.x, strict=False)), default=0.0)
    if moved > _REFREEZE:
        evaluations += problem.evaluations
        problem = _refrozen(setup, problem, point)
        until_s = problem.windows_s()[-1]
    for c, model in zip(problem.channels, problem.models, strict=True):
        without_contact(c, model.contact_s)  # only now: the early windows hold little else
    tally.expect(1, keys)
    found = _estimated(_settled(problem, point, until_s), until_s, exact)
    erring = any(c.discrepancy is not None for c in found.problem.channels)
    if erring and shorter and not looped:
        # Without an error in the problem the whole record may have bent the keys too far.
        again = problem.point(shorter[0][1], until_s, early=False)
        other = _estimated(_settled(problem, again, until_s), until_s, exact)
        evaluations += max(found, other, key=lambda one: one.cost).problem.evaluations
        found = min(found, other, key=lambda one: one.cost)
    moved = _moved(problem, shorter, found.point) if erring else []
    evaluations += problem.evaluations
    problem, point, profile = found.problem, found.point, found.profile
    _check_rows(point)
    known = uncertainty(problem, point, moved)
    drawn = bootstrapped(problem, point, until_s)
    if drawn is not None:
        # Never below half of what white noise of the same size would give.
        least = float(np.max(np.diag(known.covariance) / np.diag(drawn)))
        if math.isfinite(least):
            known.covariance = drawn * max(1.0, _LEAST_DRAWN * least)
    estimates, one_sided = _estimates(problem, point, known, until_s)
    estimates = _with_steps(problem, estimates, known, profile)
    unsure = {e.key for e in estimates if e.verdict is Verdict.NOT_IDENTIFIABLE}
    plain = problem.point(point.x, until_s, early=False, jacobian=False, exact=True)
    fits = fitness(problem, plain, until_s, len(point.x), one_sided | unsure)
    values = problem.values(point.x)
    fitted = setup
    for of_sensor in (False, True):
        fitted = fitted.vary({
            name: value
            for key, value in values.items() if of_chain(key) is of_sensor
            for name in (key, *own_values({key: value}, records[0])) if "[" not in name
        })  # fmt: skip
    held = _held_out(fitted, held_records, free, exact) if held_records else None
    curves = _curves(problem, plain, until_s)
    if fits.verdict is Model.DOES_NOT_FIT:
        fits.reasons += [
            sentence
            for c, curve in zip(problem.channels, curves, strict=True)
            for sentence in _other_impact(c, curve)
        ]
    if held is not None and fits.verdict is Model.FITS and held["residual_over_noise"] > 2.0:
        fits.verdict = Model.DOES_NOT_FIT
        fits.reasons.append(
            f"The held-out records are {held['residual_over_noise']:.3g} times the noise away."
        )
    if fits.verdict is Model.FITS and unsure:
        fits.reasons.append("The model fits, but not every key is identifiable.")
    return FitResult(
        **_common(problem, point, plain, until_s, known, fits), estimates=estimates,
        hold_out=held, evaluations=evaluations + problem.evaluations, setup=fitted, curves=curves,
        wall_s=time.perf_counter() - began, notes=_notes(problem, setup),
        speeds_m_s=_speeds(problem, values), records=list(records),
    )  # fmt: skip


def _moved(
    problem: Problem, shorter: Sequence[tuple[float, np.ndarray]], point: Point
) -> list[np.ndarray]:
    """How much farther the keys are from where shorter windows left them than noise explains."""
    n, found = len(problem.moving), []
    for end, x in shorter:
        apart = (x - point.x)[:n]
        variance = np.diag(_covariance(problem.point(x, end, early=True)))[:n]
        found.append(np.sign(apart) * np.sqrt(np.maximum(apart**2 - variance, 0.0)))
    return found


@dataclass
class _Solution:
    """A solution, the profile of a key in whole steps, and minus twice the logarithm of its
    likelihood, of one with estimated errors."""

    problem: Problem
    point: Point
    profile: Profile | None
    cost: float = math.inf


def _settled(problem: Problem, point: Point, until_s: float) -> _Solution:
    """The solution near a point without outliers, with channels of its own."""
    channels = [replace(c) for c in problem.channels]
    problem, profile = replace(problem, channels=channels, evaluations=0), None
    looped = any(isinstance(model, LoopModel) for model in problem.models)
    erring = any(c.discrepancy is not None for c in problem.channels)
    for rounds in range(_ROUNDS + 1):
        if problem.stepped is not None:
            problem, point, profile = profiled(problem, point, until_s)
        elif looped:
            point = turned(problem, point.x, until_s)
        enough: dict[str, Any] = {"steps": 12, "tolerance": 1e-4} if erring else {}
        point = minimised(problem, point.x, until_s, early=False, **enough)
        if rounds == _ROUNDS or not reject_outliers(problem, point, until_s):
            break
    return _Solution(problem, point, profile)


def _estimated(found: _Solution, until_s: float, exact: bool) -> _Solution:
    """The solution with errors of the model and noises that are estimated with the rest."""
    for _ in range(_ESTIMATES):
        cost, changed = _with_errors(found.problem, found.point, until_s, exact)
        if changed:
            before = found.problem.evaluations
            found = _settled(found.problem, found.point, until_s)
            found.problem.evaluations += before
        found.cost = cost
        if not changed:
            break
    return found


def _with_errors(problem: Problem, point: Point, until_s: float, exact: bool) -> tuple[float, bool]:
    """Estimate errors of the model and unknown noises at a solution, and give them to the channels.

    Returns:
        Minus twice the logarithm of the likelihood, and whether anything has changed.
    """
    plain = problem.point(point.x, until_s, early=False, exact=True)
    whole = np.column_stack([plain.jacobian, plain.residual])
    errors, rows = [], []
    for index, (c, model) in enumerate(zip(problem.channels, problem.models, strict=True)):
        value, _, tau = problem.predicted(point.x, index, until_s)
        gain, counted = problem.nuisances(point.x, index)[2], c.counted(tau <= until_s)
        signal = np.full(len(tau), c.peak) if c.is_gap else gain * value
        chain = problem.chains[index]
        wall_hz = chain.low_pass_hz if chain.before_s else None
        error = None if exact else unknown(tau, signal, c.whitening(), model.contact_s, wall_hz)
        errors.append(error)
        rows.append(Rows(
            whole[plain.rows[index]], float(np.sum(c.independent(counted))),
            error and error.on(counted), c.discrepancy is not None,
            c.least_noise / c.noise if c.noise_unknown else None,
        ))  # fmt: skip
    cost, found, kappa = estimated(rows, whole[plain.priors])
    changed = False
    for c, error, r, (shares, factor) in zip(problem.channels, errors, rows, found, strict=True):
        before = np.array(c.discrepancy.shares if c.discrepancy else (0.0, 0.0))
        apart = np.abs(before - shares) > _SETTLED * np.maximum(before, shares)
        changed |= bool(np.any(apart)) or abs(factor - 1.0) > 0.1 * _SETTLED
        cost += 2.0 * r.count * math.log(c.noise)
        c.noise *= factor
        c.discrepancy = None
        if error is not None and any(shares):
            basis = error.basis / factor
            c.discrepancy = replace(error, shares=shares, kappa=kappa, basis=basis, _on={})
    return cost, changed


def _lowest(problem: Problem, point: Point, windows: Sequence[float]) -> Point:
    """The same point, or one with less chi-square along what a shorter window leaves open.

    Waves that come back from the edges repeat: shifted by a period, they fit almost as well, and
    which of these minima a growing window comes to is chance.
    """
    keys = len(problem.moving)
    known = np.linalg.pinv(_covariance(point)[:keys, :keys])
    for end in reversed(windows[:-1]):
        covariance = _covariance(problem.point(point.x, end, early=True))
        variances, directions = np.linalg.eigh(covariance[:keys, :keys])
        direction, sd = directions[:, -1], math.sqrt(max(float(variances[-1]), 1e-30))
        apart = 1.0 / math.sqrt(max(float(direction @ known @ direction), 1e-30))
        if not sd > _BROADER * apart:
            continue
        axis = covariance[:, :keys] @ direction / sd  # of all parameters
        reach = min(_ALONG_SD, _FARTHEST / sd)
        count = min(math.ceil(reach * sd / (_APART_SD * apart)), _MOST_TRIED)
        trials = []
        for t in np.linspace(-reach, reach, 2 * count + 1):
            with suppress(SceneError):  # a value that the scene refuses
                x = point.x + t * axis
                trials.append(problem.point(x, windows[-1], early=False, jacobian=False))
        chi = [trial.chi_square for trial in trials]
        minima = [i for i in range(1, len(chi) - 1) if chi[i] <= min(chi[i - 1], chi[i + 1])]
        for i in sorted(minima, key=lambda i: chi[i])[:_MOST_MINIMA]:
            found = minimised(
                problem, trials[i].x, windows[-1], early=False, steps=15, tolerance=1e-3
            )
            if found.chi_square < point.chi_square - _LOWER:
                point = found
        break
    return point


def _covariance(point: Point) -> np.ndarray:
    """Covariance of all parameters, in their order."""
    inverse = point.inverse()
    return np.asarray(inverse @ inverse.T)


def _refrozen(setup: Setup, problem: Problem, point: Point) -> Problem:
    """The same problem with the models frozen at a solution, where the limit of the modes fits."""
    values = problem.values(point.x)
    accuracy = problem.models[0].setup.accuracy
    looped = [isinstance(model, LoopModel) for model in problem.models]
    models = _frozen(setup, problem.channels, looped, values, accuracy)
    return replace(problem, models=models, evaluations=0)


def _best_start(problem: Problem) -> np.ndarray:
    """The starting point, of several for a limiting pressure: above the elastic pressure of the
    impact its gradient is zero."""
    x = problem.start()
    keys = [f.key for f in problem.moving]
    if _PRESSURE not in keys:
        return x
    place = keys.index(_PRESSURE)
    f = problem.moving[place]
    pressure = _elastic_pressure(problem, f)
    end = problem.windows_s()[0]
    best: Point | None = None
    for share in _STARTS:
        tried = x.copy()
        tried[place] = math.log(min(max(share * pressure, 1.01 * f.low), 0.99 * f.high))
        found = minimised(problem, tried, end, early=True, steps=12, tolerance=1e-2)
        if best is None or found.chi_square < best.chi_square:
            best = found
    assert best is not None
    return best.x


def _elastic_pressure(problem: Problem, f: Free) -> float:
    """Pressure in the centre of the contact at its largest force, if it were elastic, Pa."""
    model = problem.models[0]
    values = {g.key: g.start for g in problem.free if not of_loop(g.key)}
    run = model.run(values | {f.key: 1e13}, 2.0 * model.contact_s)
    force = float(np.max(run.force_n(run.time_s)))
    bodies = model.setup.vary(values).mechanics
    radius = bodies.sphere.radius_m
    modulus = 0.75 * run.contact.stiffness / math.sqrt(radius)
    a = (0.75 * force * radius / modulus) ** (1.0 / 3.0)
    return 1.5 * force / (math.pi * a * a)


def _estimate(f: Free, value: float, sd: float, alone: float, pull: float | None) -> Estimate:
    """An estimate whose interval is that of the covariance."""
    known = math.isfinite(sd) and NORMAL * sd < NO_BOUND
    low = value * math.exp(-NORMAL * sd) if known else None
    high = value * math.exp(NORMAL * sd) if known else None
    half = math.expm1(NORMAL * sd) if known else math.inf
    verdict = Verdict.IDENTIFIED if half <= WIDEST else Verdict.NOT_IDENTIFIABLE
    percent = 100.0 * math.expm1(NORMAL * alone) if NORMAL * alone < NO_BOUND else None
    return Estimate(f.key, value, low, high, verdict, f.start, sd if known else None, pull, percent)


def _estimates(
    problem: Problem, point: Point, known: Uncertainty, until_s: float
) -> tuple[list[Estimate], set[str]]:
    """Estimates of all keys; which of them a bound or a flat side makes one-sided."""
    pulls = problem.pulls(point.x)
    found, one_sided = [], set()
    for j, f in enumerate(problem.moving):
        value = problem.values(point.x)[f.key]
        sd, alone = float(known.sd[j]), float(known.alone[j])
        estimate = _estimate(f, value, sd, alone, pulls.get(f.key))
        at_bound = f.at_bound(point.x[j])
        doubtful = at_bound or estimate.verdict is not Verdict.IDENTIFIED
        # Where a key is unknown even with all others known, no combination is to blame.
        flat = at_bound or not math.expm1(min(NORMAL * alone, 50.0)) <= WIDEST
        if f.prior is None and (f.key == _PRESSURE or (doubtful and flat)):
            profiled = _profiled(problem, point, until_s, j, f, estimate, known.wider)
            if profiled is not None:
                estimate = profiled
                if estimate.low is None or estimate.high is None:
                    one_sided.add(f.key)
        found.append(_beyond_bound(estimate, at_bound, one_sided))
    return found, one_sided


def _beyond_bound(e: Estimate, at_bound: str, one_sided: set[str]) -> Estimate:
    """The estimate of a key, which is not identified where it ended at a bound of its range: then
    the range made the value, and the records may ask for one beyond."""
    if not at_bound or e.verdict is not Verdict.IDENTIFIED:
        return e
    one_sided.discard(e.key)
    low, high = (None, e.high) if at_bound == "low" else (e.low, None)
    return replace(e, low=low, high=high, verdict=Verdict.AT_BOUND, sd_log=None)


def _with_steps(
    problem: Problem, estimates: list[Estimate], known: Uncertainty, profile: Profile | None
) -> list[Estimate]:
    """The estimates with that of the key in whole steps, which widens the intervals of the others
    where several of its values are certain; the covariance gets a row of zeros for it."""
    if profile is None:
        return estimates
    f, found = profile.free, []
    for j, e in enumerate(estimates):
        if e.low is not None and e.high is not None and e.sd_log is not None:
            down, up = profile.spread(j, e.sd_log)
            e = replace(e, low=e.value * math.exp(down), high=e.value * math.exp(up))
            if e.verdict is Verdict.IDENTIFIED and 0.5 * (up - down) > math.log1p(WIDEST):
                e = replace(e, verdict=Verdict.NOT_IDENTIFIABLE)
        found.append(e)
    low, high = profile.interval()
    value = profile.best * (f.grain or 1.0)
    verdict = Verdict.NOT_IDENTIFIABLE
    if low is not None and high is not None:
        # The interval of a single step is one step wide, which is all that can be known.
        widest = max(WIDEST * value, _STEPS_KNOWN * (f.grain or 1.0))
        if 0.5 * (high - low) <= widest:
            verdict = Verdict.IDENTIFIED
    place = [g.key for g in problem.free].index(f.key)
    own = Estimate(f.key, value, low, high, verdict, f.start, None, grain=f.grain)
    found.insert(place, own)
    for axis in (0, 1):
        known.covariance = np.insert(known.covariance, place, 0.0, axis=axis)
    return found


def _profiled(
    problem: Problem, point: Point, until_s: float, j: int, f: Free, estimate: Estimate,
    wider: float,
) -> Estimate | None:  # fmt: skip
    """An estimate with one open end where chi-square, as intervals `wider` ask for, stays flat to a
    bound, else None."""
    best = point.chi_square

    def rise(value: float) -> float:
        held = replace(problem, fixed=problem.fixed | {f.key: value}, evaluations=0)
        x = np.delete(point.x, j)
        try:
            found = minimised(held, x, until_s, early=False, steps=12, tolerance=1e-4)
        except SceneError:  # with the other values, the scene cannot have this one
            return math.inf
        problem.evaluations += held.evaluations
        return (found.chi_square - best) / wider**2

    up = rise(f.high)
    if up < (_YIELDED if f.key == _PRESSURE else CERTAIN):
        # The high side is open. Find the largest value below at which chi-square has risen.
        edge = _crossing(rise, estimate.value, f.low)
        if edge is None:
            return None
        # A contact that does not yield sets a limit by itself; another key is just not known.
        verdict = Verdict.ONE_SIDED if f.key == _PRESSURE else estimate.verdict
        return replace(estimate, low=edge, high=None, verdict=verdict, sd_log=None)
    if f.key == _PRESSURE:
        # Above the largest pressure of the impact chi-square is flat: the interval is not even.
        edge = _crossing(rise, estimate.value, f.high, CERTAIN) if up < _CLEAR else None
        high = estimate.high
        return None if edge is None or high is None else replace(estimate, high=max(edge, high))
    edge = _crossing(rise, estimate.value, f.high) if rise(f.low) < CERTAIN else None
    return None if edge is None else replace(estimate, low=None, high=edge, sd_log=None)


def _crossing(rise: Any, value: float, bound: float, level: float = _ONE_SIDED) -> float | None:
    """Where chi-square has risen by a level, by default the one-sided one of 95 %, between a value
    and a bound."""
    if rise(bound) < level:
        return None
    inner, outer = math.log(value), math.log(bound)
    for _ in range(10):
        middle = 0.5 * (inner + outer)
        if rise(math.exp(middle)) < level:
            inner = middle
        else:
            outer = middle
        if abs(outer - inner) < 3e-3:
            break
    return math.exp(outer)


def _nuisances(problem: Problem, point: Point, until_s: float) -> list[Nuisance]:
    found = []
    for index, c in enumerate(problem.channels):
        touch_s, ppm, gain, offset = problem.nuisances(point.x, index)
        rows = point.residual[point.rows[index]]
        samples = _samples(problem, point, index, until_s)
        rms = math.sqrt(float(np.sum(rows**2)) / samples) if samples else math.nan
        shares = c.discrepancy.shares if c.discrepancy else (0.0, 0.0)
        found.append(Nuisance(
            c.record.name, touch_s, gain, offset, ppm, c.noise, rms, len(rows), c.rejected,
            _off(problem, point, index, until_s), (100.0 * shares[0], 100.0 * shares[1]),
        ))  # fmt: skip
    return found


def _off(
    problem: Problem, point: Point, index: int, until_s: float
) -> tuple[float | None, float | None, float | None]:
    """Residual over the peak: its root mean square in the pulse and after it, and its largest
    value, %; None without samples there."""
    c, contact_s = problem.channels[index], problem.models[index].contact_s
    value, _, tau = problem.predicted(point.x, index, until_s)
    _, _, gain, offset = problem.nuisances(point.x, index)
    residual = gain * value + offset - c.value
    used = c.kept & (tau <= until_s) & (tau > -0.1 * contact_s)
    pulse = tau < PULSE * contact_s

    def rms(some: np.ndarray) -> float | None:
        if not np.any(some):
            return None
        return 100.0 * math.sqrt(float(np.mean(residual[some] ** 2))) / c.peak

    largest = float(np.max(np.abs(residual[used]), initial=0.0))
    return rms(used & pulse), rms(used & ~pulse), 100.0 * largest / c.peak


def _samples(problem: Problem, point: Point, index: int, until_s: float) -> float:
    """How many independent samples of a channel count."""
    channel = problem.channels[index]
    touch_s, ppm, _, _ = problem.nuisances(point.x, index)
    tau = channel.after_touch_s(touch_s, ppm)
    return float(np.sum(channel.independent(channel.counted(tau <= until_s))))


def _speeds(problem: Problem, values: dict[str, float]) -> tuple[float, float]:
    alone = {k: v for k, v in values.items() if not of_loop(k)}
    speeds = [
        m.spec_of(own_values(alone, c.record)).sphere.impact_speed_m_s
        for m, c in zip(problem.models, problem.channels, strict=True)
    ]
    return min(speeds), max(speeds)


def _curves(problem: Problem, point: Point, until_s: float) -> list[dict[str, np.ndarray]]:
    """Measured and simulated values of every record over the time after the touch."""
    found = []
    for index, c in enumerate(problem.channels):
        value, _, tau = problem.predicted(point.x, index, until_s)
        _, _, gain, offset = problem.nuisances(point.x, index)
        inside = tau <= until_s
        found.append({
            "time_s": tau[inside], "measured": c.value[inside],
            "simulated": gain * value[inside] + offset, "used": c.kept[inside],
        })  # fmt: skip
    return found


def _other_impact(c: Channel, curve: dict[str, np.ndarray]) -> list[str]:
    """Say where a record of the force shows an impact that the simulation does not have."""
    if c.record.quantity != "contact_force":
        return []
    high = 0.1 * c.peak
    measured = np.where(curve["used"], curve["measured"] - c.baseline, 0.0) > high
    simulated = curve["simulated"] - np.min(curve["simulated"]) > 0.01 * c.peak
    late = curve["time_s"] > curve["time_s"][np.argmax(curve["simulated"])]
    alone = measured & ~simulated & late
    found = np.flatnonzero(alone[:-1] & alone[1:])
    if not len(found):
        return []
    return [
        f"{c.record.name}: an impact {1e6 * curve['time_s'][found[0]]:.3g} us after the first is "
        "not in the simulation. If it is another drop or hit, cut the record before it."
    ]


def _held_out(
    fitted: Setup, records: Sequence[Record], free: Sequence[Free], exact: bool
) -> dict[str, Any]:
    """Compare records with the fitted scene; only their nuisances, and the speed of every hit, are
    found anew."""
    problem = prepared(fitted, records, _speeds_of_hits(fitted, records, free, 1))
    if any(isinstance(model, LoopModel) for model in problem.models):
        problem = searched(problem)
    until_s = problem.windows_s()[-1]
    point = minimised(problem, problem.start(), until_s, early=False)
    found = _estimated(_settled(problem, point, until_s), until_s, exact)
    problem = found.problem
    plain = problem.point(found.point.x, until_s, early=False, jacobian=False, exact=True)
    rows = np.concatenate([plain.residual[s] for s in plain.rows])
    samples = sum(_samples(problem, plain, i, until_s) for i in range(len(records)))
    ratio = math.sqrt(float(rows @ rows) / max(samples - len(plain.x), 1.0))
    nuisances = _nuisances(problem, plain, until_s)
    return {
        "records": [r.name for r in records],
        "residual_over_noise": ratio,
        "gain": [n.gain for n in nuisances],
        "in_pulse_percent": [n.off_percent[0] for n in nuisances],
        "after_pulse_percent": [n.off_percent[1] for n in nuisances],
        "largest_percent": [n.off_percent[2] for n in nuisances],
    }


def _next(problem: Problem, point: Point, known: Uncertainty) -> list[str]:
    """Say which key, measured by other means, would help the worst known key most."""
    n = len(problem.moving)
    if n < 2:
        return []
    half = known.half_widths()
    worst = int(np.argmax(np.where(np.isfinite(half), half, np.inf)))
    if half[worst] <= 0.1:
        return []
    best: tuple[float, int] | None = None
    for j in range(n):
        if "[" in problem.moving[j].key:  # the speed of one hit, which no one measures
            continue
        line = np.zeros((1, len(point.x)))
        line[0, j] = 1.0 / _KNOWN_TO
        more = replace(
            point, residual=np.append(point.residual, 0.0),
            jacobian=np.concatenate([point.jacobian, line]),
        )  # fmt: skip
        others = float(np.max(uncertainty(problem, more).half_widths()))
        if best is None or others < best[0]:
            best = (others, j)
    if best is None:
        return []
    key = problem.moving[best[1]].key
    return [
        f"Measure {key} by other means to 1 % and give it as a prior, --free '{key}±1%': the worst "
        f"half-width falls from {_percent(half[worst])} to {_percent(best[0])}."
    ]


def _percent(share: float) -> str:
    if share >= 10.0:
        return "no bound"
    return f"{100.0 * share:.{2 if share < 1.0 else 3}g} %"
