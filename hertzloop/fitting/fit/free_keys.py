"""The scene keys that a fit varies: what each changes, and the text of the option --free."""

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hertzloop.fitting.errors import FitError
from hertzloop.fitting.records.record import Record
from hertzloop.scene.fields import fields_at
from hertzloop.scene.setup import Setup

FILTERS = ("low_pass_hz", "ac_coupling_hz", "resonance_hz", "resonance_damping")
WITHOUT_CONTROL = "The records are simulated without control: no law, no latency, no force."
_EARLY_SPREADS = 6.0  # the early windows know a key to a sixth of its range
_AT_BOUND = 1e-6  # of a logarithm
PRESSURE_KEY = "contact.limiting_pressure_pa"
_LONGEST_STEPS = 20  # of a key in whole steps, at least
_FACTOR, _LOSS_FACTOR, _PRESSURE_FACTOR = 5.0, 100.0, 20.0  # of a start, for default bounds
_NEAR_LIMIT = 1e-6  # of a logarithm: so near to the limit of a key a default range ends
_NOT_OF_ONE_RUN = ("jitter_us", "clock_ppm", "clock_phase", "drop_out_probability")
_OF_ACTUATOR = ("bandwidth_hz", "damping", "force_limit_n", "dead_time_us", "mass_kg")


def is_chain_key(key: str) -> bool:
    """Whether a scene key is of the measuring chain alone: no simulation depends on it."""
    return key.startswith("sensors.")


@dataclass(frozen=True)
class FreeKey:
    """A free scene key, whose natural logarithm is fitted.

    Attributes:
        key: name of the key.
        start: starting value, in the unit of the key.
        low: lower bound.
        high: upper bound.
        prior: relative standard deviation of the prior around `start`; None without a prior.
        resolution: distance of the values of a key in whole steps; None of another key.
    """

    key: str
    start: float
    low: float
    high: float
    prior: float | None = None
    resolution: float | None = None

    @property
    def step(self) -> float:
        """Distance of the values of a key in whole steps, in its unit."""
        return self.resolution or 1.0

    @property
    def steps(self) -> range:
        """The values within the bounds of a key in whole steps, as numbers of steps."""
        first = math.ceil(self.low / self.step - 1e-9)
        return range(first, math.floor(self.high / self.step + 1e-9) + 1)

    @property
    def early_sd(self) -> float:
        """Standard deviation of the weak prior on the logarithm in early windows."""
        return math.log(self.high / self.low) / _EARLY_SPREADS

    def at_bound(self, logarithm: float) -> str:
        """At which end of the range the logarithm of a value is, "low" or "high"; "" within."""
        if logarithm <= math.log(self.low) + _AT_BOUND:
            return "low"
        return "high" if logarithm >= math.log(self.high) - _AT_BOUND else ""


def refuse_duplicates(free: Sequence[FreeKey]) -> None:
    """Raise FitError for a key that is given twice."""
    keys = [f.key for f in free]
    for key in keys:
        if keys.count(key) > 1:
            raise FitError(f"--free {key}: is given twice. Name each key once.")


def is_control_key(key: str) -> bool:
    """Whether a key changes nothing but the force of the actuator."""
    table, _, last = key.partition(".")
    return table == "controller" or (table == "actuator" and last != "mass_kg")


def drop_values(values: Mapping[str, float]) -> dict[str, float]:
    """Return the scene keys that a drop without control depends on."""
    return {k: v for k, v in values.items() if not (is_chain_key(k) or is_control_key(k))}


def values_for_record(values: Mapping[str, float], record: Record) -> dict[str, float]:
    """Return the scene keys that concern a record.

    Keys that its table sets are left out.
    """
    return {key: value for key, value in values.items() if key not in record.measurement.set}


def parse_free_key(setup: Setup, text: str) -> FreeKey:
    """Return a free key from `KEY[=LOW:HIGH][±PRIOR]`; +- may stand for ±, and a % after PRIOR.

    Raises:
        FitError: the text is not of this form, or the key is not one positive number.
    """
    head, sign, prior_text = text.replace("+-", "±").partition("±")
    key, equals, bounds = (part.strip() for part in head.partition("="))
    if not key:
        raise FitError(f"--free {text}: names no key. Write KEY, KEY=LOW:HIGH or KEY±PRIOR.")
    start = start_value(setup, key)
    resolution = _resolution_us(setup, key)
    if resolution is None:
        low, high = _default_range(setup, key, start)
    else:
        low, high = 0.0, max(_FACTOR * start, _LONGEST_STEPS * resolution)
    if equals:
        low, high = _parse_range(text, bounds, least=0.0 if resolution else None)
        _refuse_range(setup, text, FreeKey(key, start, low, high, None, resolution))
        if not low <= start <= high:
            start = math.sqrt(low * high)
            if resolution is not None:
                start = resolution * round((low + high) / resolution / 2.0)
    if sign and resolution is not None:
        raise FitError(
            f"--free {text}: a key in whole steps has no prior. Give it a range, {key}=LOW:HIGH."
        )
    prior = _parse_prior(text, prior_text, start) if sign else None
    return FreeKey(key, start, low, high, prior, resolution)


def start_value(setup: Setup, key: str) -> float:
    """Return the starting value of a key. Raises FitError unless it is one positive number."""
    table, _, last = key.partition(".")
    if last in _table_keys(setup, table) or (
        is_control_key(key) and setup.scene.controller.has_law
    ):
        _refuse_without_influence(setup, key)
    found = setup.value_of(key)
    if _resolution_us(setup, key) is not None and (
        found == 0.0 or (found is None and last == "dead_time_us")
    ):
        return 0.0
    if table == "controller" and isinstance(found, int) and not isinstance(found, bool):
        raise FitError(f"--free {key}: is a whole number, {found}. Choose another key.")
    if isinstance(found, bool) or not isinstance(found, int | float) or not found > 0.0:
        raise FitError(f"--free {key}: {_why_no_start(setup, key, found)}")
    return float(found)


def _resolution_us(setup: Setup, key: str) -> float | None:
    """Return the distance of the values of a key in whole steps, us; None of another key."""
    table, _, last = key.partition(".")
    if key == "actuator.dead_time_us" or (
        table == "controller" and last in setup.scene.controller.whole_step_keys
    ):
        return setup.run.step_ns / 1000
    return None


def _parse_range(text: str, bounds: str, least: float | None) -> tuple[float, float]:
    """Return the range LOW:HIGH. `least`: value that LOW may have beside positive ones."""
    try:
        low, high = (float(p) for p in bounds.split(":"))
    except ValueError as error:
        raise FitError(
            f"--free {text}: '{bounds}' is not a range. Write LOW:HIGH, two numbers."
        ) from error
    if not ((low > 0.0 or low == least) and low < high < math.inf):
        raise FitError(
            f"--free {text}: the range must be positive and rise. Write LOW:HIGH with LOW "
            "above zero."
        )
    return low, high


def _refuse_range(setup: Setup, text: str, f: FreeKey) -> None:
    """Raise FitError for an end of a range that the scene refuses."""
    ends = f.low, f.high
    if f.resolution is not None:
        ends = f.steps.start * f.step, (f.steps.stop - 1) * f.step
    for end in ends:
        if why := setup.refusal({f.key: end}):
            raise FitError(f"--free {text}: {why}")


def _parse_prior(text: str, prior: str, start: float) -> float:
    """Return the relative standard deviation of a prior, which stands in % or in the unit of the
    key."""
    try:
        given = float(prior.strip().rstrip("%"))
    except ValueError as error:
        raise FitError(
            f"--free {text}: '{prior}' is not a prior. Write a standard deviation in the "
            "unit of the key, or in %."
        ) from error
    relative = given / 100.0 if prior.strip().endswith("%") else given / start
    if not 0.0 < relative < math.inf:
        raise FitError(f"--free {text}: the prior must be a positive standard deviation.")
    return relative


def _table_keys(setup: Setup, table: str) -> Mapping[str, Any]:
    """The keys of a table of the scene; none of a table that does not exist."""
    return fields_at([table], type(setup.scene)) if hasattr(setup.scene, table) else {}


def _refuse_without_influence(setup: Setup, key: str) -> None:
    """Raise FitError for a key of the scene that no record can tell."""
    table, _, last = key.partition(".")
    if is_control_key(key) and not setup.scene.controller.has_law:
        raise FitError(
            f"--free {key}: cannot be fitted, as controller.law is off. {WITHOUT_CONTROL} Name "
            "the law that was on, --set controller.law=NAME."
        )
    if table == "controller" and last in _NOT_OF_ONE_RUN:
        raise FitError(
            f"--free {key}: cannot be fitted, as a record of one run cannot tell it. Set it with "
            "--set."
        )
    if table == "actuator" and last not in _OF_ACTUATOR:
        raise FitError(
            f"--free {key}: cannot be fitted, as of the actuator only {', '.join(_OF_ACTUATOR)} "
            "can be free."
        )
    if table == "run":
        raise FitError(
            f"--free {key}: is a choice of the simulation, not a property of the rig. Choose "
            "another key."
        )
    if table == "sensors" and last not in FILTERS:
        raise FitError(
            f"--free {key}: cannot be fitted. Of the sensor only {', '.join(FILTERS)} can "
            "be free; a fit finds noise, gain and offset by itself."
        )


def _why_no_start(setup: Setup, key: str, found: Any) -> str:
    """Return why a value of the scene cannot be the start of a fit, and what to do."""
    table, _, last = key.partition(".")
    fields = _table_keys(setup, table)
    if table == "controller" and setup.scene.controller.has_law:
        fields = {**fields, **vars(setup.scene.controller.keys)}
    if last.partition(".")[0] not in fields:
        near = difflib.get_close_matches(last, fields, 1)
        hint = f"Did you mean {table}.{near[0]}?" if near else "See `hertzloop scene keys`."
        return f"is not a scene key. {hint}"
    if key == PRESSURE_KEY:
        return (
            "the contact of the scene does not yield. Add --set contact.plasticity=thornton and "
            "--set contact.limiting_pressure_pa=VALUE."
        )
    if found is None:
        return "the scene has no value to start from. Give it one with --set."
    return f"is {found} in the scene, and must be one positive number. Choose another key."


def _default_range(setup: Setup, key: str, start: float) -> tuple[float, float]:
    """Return the range of a key around its start, as far as the scene can have it. Raises FitError
    if it can have no other value."""
    factor = _FACTOR
    if key.endswith("loss_factor"):
        factor = _LOSS_FACTOR
    elif key == PRESSURE_KEY:
        factor = _PRESSURE_FACTOR
    low, high = start / factor, start * factor
    if key.endswith(("loss_factor", "poisson", "restitution")):
        high = min(high, 0.49 if key.endswith("poisson") else 1.0)
    ends = _allowed_end(setup, key, start, low), _allowed_end(setup, key, start, high)
    if math.log(ends[1] / ends[0]) < 2.0 * _NEAR_LIMIT:
        raise FitError(f"--free {key}: {setup.refusal({key: low})}")
    return ends


def _allowed_end(setup: Setup, key: str, start: float, end: float) -> float:
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
