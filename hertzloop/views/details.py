"""Facts of a run beside its metrics, one row each, for `--details` and `--json`."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.common.readable import quantity
from hertzloop.controller.loading.registry import shipped
from hertzloop.plant.schemes.modal import impedance_n_s_m
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results.assessed_run import RunReport
from hertzloop.results.inspection import Inspected
from hertzloop.results.recorded import RecordedLaw
from hertzloop.results.statistics import ActuatorDemand
from hertzloop.scene.controller import mean_latency_us
from hertzloop.scene.setup import Setup
from hertzloop.views.format import Table


class RunFact(NamedTuple):
    """One fact of a run.

    Attributes:
        key: Its name in `--json`; "" for words alone.
        of: Its value, of a recording as inspected, or of a run.
        row: Its row in the table of details; "" for `--json` alone.
        words: Its value in words; zero, None and what is empty have none.
    """

    key: str
    of: Callable[[Any], Any]
    row: str = ""
    words: Callable[[Any], str] = str


_LONGEST = 200  # characters that are shown of a controller's own words
_ROWS = ("run", "time", "plate", "contact", "actuator", "residuals")
_SHARED = {
    "JOINED": "in shared memory",
    "NOT_STATED": "over the bus; the controller knows of no shared memory",
    "OTHER_HOST": "over the bus, the controller being on another host",
    "NOT_ALLOWED": "over the bus; the controller could not open the plant's shared memory",
    "SWITCHED_OFF": "over the bus, the controller not using shared memory",
}


def recorded_table(found: Inspected) -> Table:
    """Return the table of the facts that a recording has."""
    return _table([(fact, fact.of(found)) for fact in RECORDED])


def run_table(report: RunReport) -> Table:
    """Return the table of a run's facts, in six rows."""
    recorded = [(fact, fact.of(report.inspected)) for fact in RECORDED]
    return _table([*recorded, *((fact, fact.of(report)) for fact in OF_RUN)])


def _table(facts: Iterable[tuple[RunFact, Any]]) -> Table:
    rows: dict[str, list[str]] = {row: [] for row in _ROWS}
    for fact, value in facts:
        if value and fact.row and (words := fact.words(value)):
            rows[fact.row].append(words)
    table = Table("", "", show_header=False)
    for heading, said in rows.items():
        if said:
            table.add_row(heading, "; ".join(said))
    return table


def recorded_as_json(found: Inspected) -> dict[str, Any]:
    """Return the facts that a recording has by their names in `--json`."""
    return {fact.key: fact.of(found) for fact in RECORDED if fact.key}


def facts_as_json(report: RunReport) -> dict[str, Any]:
    """Return the facts of a run by their names in `--json`."""
    own = {fact.key: fact.of(report) for fact in OF_RUN if fact.key}
    return recorded_as_json(report.inspected) | own


def law_line(data: RecordedLaw, digests: bool = True) -> str:
    """Name the law that the forces of a recording come from; without `digests`, one that the scene
    does not name still has its digest."""
    if data.as_announced and not digests:
        return law_words(data.law, None)
    used, announced = law_words(data.law, data.law_digest), data.scene_law
    if data.as_announced or (used and data.law == announced and data.law_digest is None):
        return used
    law = used or "not reported by the controller"
    scene = law_words(announced, data.scene_law_digest)
    return f"{law} (the scene says {scene})" if announced else law


def law_words(name: str | None, digest: str | None) -> str:
    """Return a law's name, shortened to fit, and the digest of its files if it is not shipped."""
    words = "".join(c for c in " ".join((name or "").split()) if c.isprintable())[:_LONGEST]
    own = name is not None and name not in shipped()
    return f"{words}, digest {digest[:_LONGEST]}" if digest and own else words


def fallback_words(fallbacks: int) -> str:
    """Describe the contact steps in which Newton's method did not end."""
    return f"Newton's method did not end in {fallbacks} contact steps"


def mean_latency(setup: Setup) -> float | None:
    """Return the mean latency of the force that acts, us; None if every command has the same."""
    path = setup.signal_path
    return (
        mean_latency_us(setup) if path.varies or path.trace or path.drop_out_probability else None
    )


def _mean_latency_words(mean_us: float) -> str:
    if math.isnan(mean_us):
        return "no command acts within the run"
    return f"mean latency {mean_us:.1f} us of the force that acts"


def yield_words(found: Mapping[str, float]) -> str:
    """Describe the permanent dent and the dissipated energy of a contact that yielded."""
    dissipated = quantity(found["dissipated_j"], "J", 4)
    return f"a dent of {quantity(found['dent_m'], 'm')}, {dissipated} dissipated"


def _limiting_pressure(setup: Setup) -> float | None:
    """Return the pressure at which the contact yields, Pa; None of one that does not yield."""
    limit = setup.mechanics.contact.limit
    return None if limit is None else limit.pressure_pa


def pressure_words(setup: Setup) -> str:
    """Describe the pressure at which the contact yields, and where it comes from."""
    pressure_pa, weaker = _limiting_pressure(setup), setup.mechanics.weaker
    if pressure_pa is None:
        return ""
    words = f"limiting pressure {quantity(pressure_pa, 'Pa')}"
    if weaker is None or setup.scene.contact.limiting_pressure_pa is not None:
        return f"{words}, as the scene says"
    body, by = weaker
    return (
        f"{words}: {by.factor:g} times the {by.measure} of the {body}, "
        f"{quantity(by.value_pa, 'Pa')}, known to {100 * by.spread:z.0f} %"
    )


def demand_words(asked: ActuatorDemand) -> str:
    """Describe the largest force, slew rate and power that a run demanded of its actuator."""
    words = f"{asked.force_n:.4g} N, {asked.slew_n_s * 1e-6:.3g} N/us, {asked.power_w:.3g} W"
    if asked.delay_s:
        words += f"; its bandwidth adds {asked.delay_s * 1e6:.3g} us to the latency"
    return words


def missed(expected: float | None, asked: float) -> bool:
    """Return whether a run expects more error than requested."""
    return expected is not None and expected > 1.001 * asked


def error_words(expected: float | None, asked: float) -> str:
    """Return the expected error of a run, with the digits that show a missed request."""
    if expected is None or math.isinf(expected):
        return "unknown"
    if expected >= 1.0:  # an estimate of a small error; of a large one it gives no size
        return "above 1"
    words = (f"{expected:.{digits}g}" for digits in range(1, 17))
    return next(word for word in words if float(word) > asked or not missed(expected, asked))


def _yield(found: Inspected) -> dict[str, float] | None:
    """Return the permanent indentation, m, and the energy, J, of a contact that yielded."""
    balance = found.recording.balance
    if balance is None or balance.dent_m == 0.0:
        return None
    return {"dent_m": balance.dent_m, "dissipated_j": balance.plastic_dissipated_j}


def _structure(setup: Setup) -> dict[str, Any]:
    """Return the name of the structure, and how good its modes are."""
    what = setup.mechanics.structure
    simple = what.quality is None and what.simply_supported is not None
    return {"name": "a simply supported plate" if simple else str(what), **(what.quality or {})}


def _plate_words(setup: Setup) -> str:
    local = setup.plant.plate.local_plate
    if not setup.plant.infinite_plate or local is None:
        return ""
    return f"infinite plate, a dashpot of {impedance_n_s_m(local):.4g} N s/m"


def _modes_words(balance: EnergyBalance) -> str:
    if not balance.frequencies:
        return ""
    return (
        f"{balance.frequencies} frequencies up to {quantity(balance.frequency_limit_hz, 'Hz', 4)}"
    )


def _of_balance(name: str) -> Callable[[Inspected], Any]:
    return lambda found: getattr(found.recording.balance, name, None)


def _demand(found: Inspected) -> ActuatorDemand | None:
    return found.assessment.result.metrics.demand if found.assessment else None


# fmt: off
RECORDED = (
    RunFact("scene", lambda i: i.recording.metadata.get("scene", ""), "run"),
    RunFact("seed", lambda i: i.seed),
    RunFact("", lambda i: f"seed {i.seed}", "run"),
    RunFact("", lambda i: law_line(i.law), "run", "law {}".format),
    RunFact("note", lambda i: i.recording.note),
    RunFact("recording", lambda i: str(i.recording.path)),
    RunFact("steps", lambda i: i.number("steps"), "time", "{:,} steps".format),
    RunFact("frequencies", _of_balance("frequencies")),
    RunFact("frequency_limit_hz", _of_balance("frequency_limit_hz")),
    RunFact("", lambda i: i.recording.balance, "plate", _modes_words),
    RunFact("newton_iterations_max", _of_balance("newton_iterations_max"), "contact",
            "at most {} rounds of Newton's method a step".format),
    RunFact("newton_fallbacks", _of_balance("newton_fallbacks"), "contact", fallback_words),
    RunFact("yield", _yield, "contact", yield_words),
    RunFact("", _demand, "actuator", demand_words),
    RunFact("residuals", lambda i: i.recording.balance and {
                "momentum": i.recording.balance.momentum_residual,
                "energy": i.recording.balance.energy_residual,
            }, "residuals", "energy {0[energy]:.1e}, momentum {0[momentum]:.1e} (relative)".format),
)
OF_RUN = (
    RunFact("transport", lambda r: r.options.transport.value, "run"),
    RunFact("scheme", lambda r: r.setup.run.scheme),
    RunFact("", lambda r: SCHEMES[r.setup.run.scheme].note, "run"),
    RunFact("wall_s", lambda r: r.stats["wall_s"], "time", "{:.4g} s of wall time".format),
    RunFact("real_time_factor",
            lambda r: r.setup.run.duration_s / max(r.stats["wall_s"], 1e-9),
            "time", "{:.3g} times real time".format),
    RunFact("exchanges", lambda r: int(r.stats["exchanges"]), "time", "{:,} exchanges".format),
    RunFact("shared_memory", lambda r: r.stats["shared_memory"], "time",
            lambda how: _SHARED.get(how, "")),
    RunFact("realtime", lambda r: r.stats.get("realtime", ""), "time",
            "real-time profile: {}".format),
    RunFact("struck", lambda r: _structure(r.setup), "plate", lambda s: s["name"]),
    RunFact("plate_model", lambda r: r.setup.plate_model),
    RunFact("", lambda r: _plate_words(r.setup), "plate"),
    RunFact("damped_residual", lambda r: r.setup.plant.damped_residual, "plate",
            lambda found: "one damped mode for the rest"),
    RunFact("limiting_pressure_pa", lambda r: _limiting_pressure(r.setup)),
    RunFact("", lambda r: pressure_words(r.setup), "contact"),
    RunFact("", lambda r: r.setup.mechanics.why_elastic, "contact",
            "elastic: {}".format),
    RunFact("mean_latency_us", lambda r: mean_latency(r.setup), "actuator", _mean_latency_words),
)
# fmt: on
