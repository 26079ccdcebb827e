"""The properties of a run that `--details` prints: scheme, plate model, latency, residuals."""

import math
from typing import Any

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.common.readable import quantity
from hertzloop.loop.run_options import Transport
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results import model
from hertzloop.results.model import step_limit_hz
from hertzloop.results.run_report import RunReport
from hertzloop.results.statistics import ActuatorDemand
from hertzloop.scene.controller import mean_latency_us
from hertzloop.scene.setup import Setup
from hertzloop.views.format import Table
from hertzloop.views.law_line import law_line


def run_table(report: RunReport) -> Table:
    """Return the table of a run's properties, in six rows."""
    balance = report.balance
    rows = {
        "run": _run_words(report),
        "time": _time_words(report),
        "plate": _plate_words(report),
        "contact": _contact_words(report),
        "actuator": _actuator_words(report),
        "residuals": f"energy {balance.energy_residual:.1e}, momentum "
        f"{balance.momentum_residual:.1e} (relative)",
    }
    table = Table("", "", show_header=False)
    for heading, words in rows.items():
        table.add_row(heading, words)
    return table


def _run_words(report: RunReport) -> str:
    """State scene, seed, transport, law and scheme."""
    setup = report.setup
    note = SCHEMES[setup.run.scheme].note
    scheme = f"; scheme {setup.run.scheme}: {note}" if note else ""
    law = law_line(report.assessed.law)
    return f"{setup.scene.name}, seed {setup.run.seed}, {report.transport}; law {law}{scheme}"


def _time_words(report: RunReport) -> str:
    """State steps, wall time, exchanges and the time by role."""
    setup, wall_s = report.setup, report.wall_s
    factor = setup.run.duration_s / wall_s if wall_s else math.inf
    rate = setup.run.steps / max(wall_s, 1e-9)
    words = [
        f"{setup.run.steps:,} steps in {wall_s:.4g} s, {factor:.3g} times real time, "
        f"{rate:,.0f} steps/s",
        f"exchanges: {_exchanges(report)}",
        f"time by role: {_time_by_role(report)}",
    ]
    if report.realtime:
        words.append(f"real-time profile: {report.realtime}")
    return "; ".join(words)


def _plate_words(report: RunReport) -> str:
    """Describe the structure, the model of the plate and its truncated modes."""
    structure, truncated = report.structure, report.parts.truncated_modes
    words = [] if structure["closed_form"] else [_structure_words(structure)]
    words.append(_model_order(report))
    if truncated:
        words.append(truncated_words(truncated))
    return "; ".join(words)


def _contact_words(report: RunReport) -> str:
    """State the cost of the contact solver, and the limiting pressure with what yielded, or why a
    contact that may yield by itself does not."""
    limit, found = report.parts.limiting_pressure, report.assessed.yielded
    balance = report.balance
    words = [f"at most {balance.newton_iterations_max} rounds of Newton's method a step"]
    if balance.newton_fallbacks:
        words.append(fallback_words(balance))
    if limit:
        words.append(f"limiting pressure {pressure_words(limit)}")
    if why := report.setup.mechanics.why_elastic:
        words.append(f"elastic: {why}")
    if found:
        words.append(yield_words(found))
    return "; ".join(words)


def fallback_words(balance: EnergyBalance) -> str:
    """Describe the contact steps in which Newton's method did not end."""
    return (
        f"Newton's method did not end in {balance.newton_fallbacks} of {balance.contact_steps} "
        "contact steps, which have a constant force"
    )


def _actuator_words(report: RunReport) -> str:
    """State what was demanded of the actuator, and the mean latency."""
    demand, mean = report.assessed.result.metrics.demand, mean_latency_words(report.setup)
    words = [demand_words(demand)] if demand else []
    if mean:
        words.append(f"mean latency {mean}")
    return "; ".join(words) or "no force"


def mean_latency_words(setup: Setup) -> str:
    """State the mean latency of the force that acts; empty if every command has the same."""
    line = setup.signal_path
    if not (line.varies or line.trace or line.drop_out_probability):
        return ""
    mean_us = mean_latency_us(setup)
    if math.isnan(mean_us):
        return "no command acts within the run"
    if ppm := setup.scene.controller.clock_ppm:
        beat_s = 1e6 * setup.sensor.every_steps * setup.run.step_s / abs(ppm)
        return (
            f"{mean_us:.1f} us of the force that acts: the controller's clock drifts by a sampling "
            f"period in {beat_s:.3g} s"
        )
    return (
        f"{mean_us:.1f} us of the force that acts: commands keep their order, so "
        "that a late one delays those behind it"
    )


_LANES = {
    "JOINED": "in the fast lane",
    "NOT_STATED": "over the bus; the controller knows of no fast lane",
    "OTHER_HOST": "over the bus, the controller being on another host",
    "NOT_ALLOWED": "over the bus; the controller could not open the plant's shared memory",
    "SWITCHED_OFF": "over the bus, the controller's fast lane being switched off",
}


def _exchanges(report: RunReport) -> str:
    """Say how many exchanges took place, at which rate, and over which channel."""
    words = f"{report.exchanges:,}"
    if report.transport != Transport.ZENOH:
        return words
    way = _LANES.get(report.lane, "over the bus, without fast lane")
    return f"{words}, {report.exchanges / max(report.wall_s, 1e-9):,.0f}/s, {way}"


def _time_by_role(report: RunReport) -> str:
    """Say how long each role worked, and how long the plant waited."""
    if not report.busy_s:
        return "not known: all roles share one process, and none waits"
    roles = ", ".join(f"{role} {busy_s:.3g} s" for role, busy_s in report.busy_s.items())
    share = report.waited_s / max(report.wall_s, 1e-9)
    return f"{roles}; the plant waited {report.waited_s:.3g} s, {share:.0%} of the wall time"


def _structure_words(found: dict[str, Any]) -> str:
    """Describe a structure that is not a simply supported plate, and how well it is known."""
    if "low_modes" in found:
        return (
            f"{found['name']}: {found['low_modes']} modes by Ritz's method, whose frequencies "
            f"change by {found['low_change']:.1g} at most with the basis; those beyond, by phases "
            f"at the edges, to {found['beyond_error']:.1g}"
        )
    source = f"{found['modes_in_file']}, sha256 {found['sha256'][:16]}"
    words = [f"{found['name']}: {source}"]
    if found["mobility_ratio"] is not None:
        words.append(f"their mean mobility is {found['mobility_ratio']:.3g} of an infinite plate's")
    return "; ".join(words)


def yield_words(found: model.Yield) -> str:
    """Describe the permanent dent and the dissipated energy of a contact that yielded."""
    dissipated = quantity(found.dissipated_j, "J", 4)
    return f"a dent of {quantity(found.dent_m, 'm')}, {dissipated} dissipated"


def pressure_words(limit: dict[str, Any]) -> str:
    """Describe the pressure at which a contact yields, and where it comes from."""
    words, by = f"{limit['pressure_pa'] * 1e-9:.3g} GPa", limit["by"]
    if by is None:
        return f"{words}, as the scene says"
    return (
        f"{words}: {by['factor']:g} times the {by['measure']} of the {by['body']}, "
        f"{by['value_pa'] * 1e-9:.3g} GPa, known to {100 * by['spread']:z.0f} %"
    )


def demand_words(asked: ActuatorDemand) -> str:
    """Describe the largest force, slew rate and power that a run demanded of its actuator."""
    words = f"{asked.force_n:.4g} N, {asked.slew_n_s * 1e-6:.3g} N/us, {asked.power_w:.3g} W"
    if asked.delay_s:
        words += f"; its bandwidth adds {asked.delay_s * 1e6:.3g} us to the latency"
    return words


def _model_order(report: RunReport) -> str:
    """Describe the plate model, its expected error, and whether that meets the request."""
    balance, model, (expected, asked) = report.balance, report.parts.model, report.expects
    limit_hz, words = balance.frequency_limit_hz, error_words(expected, asked)
    if model is None:  # all modes that the step carries
        return (
            f"{balance.frequencies} frequencies up to {limit_hz / 1e3:.4g} kHz (pi/dt), "
            "as published"
        )
    if model.plate_model == "infinite":
        chosen = f"infinite plate, a dashpot of {model.impedance_n_s_m:.4g} N s/m"
        if expected is None or math.isinf(expected):
            return f"{chosen}; what the missing reflections cost by the run's end is not known"
        found = f"{chosen}; missing reflections may cost {words} by the run's end"
        return f"{found} (requested: {asked:g}; missed)" if missed(expected, asked) else found
    chosen = (
        f"{balance.frequencies} frequencies up to {limit_hz / 1e3:.4g} kHz; "
        f"expected truncation error {words} of penetration or plate energy"
    )
    if not missed(expected, asked):
        return chosen
    why = what_limits(
        of_file="modes_in_file" in report.structure,
        limit_hz=limit_hz,
        full_hz=step_limit_hz(report.setup),
    )
    return f"{chosen} (requested: {asked:g}; {why})"


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
    if not missed(expected, asked):
        return next(words)
    return next(word for word in words if float(word) > asked)


def truncated_words(found: model.TruncatedModes) -> str:
    """Describe the damped mode that replaces the truncated modes."""
    words, away = "one damped mode", found.wavelengths_to_edge
    if away >= found.needed:
        return words
    return f"{words}; not known so close to an edge, {away:.2g} of {found.needed:g} wavelengths"


def what_limits(of_file: bool, limit_hz: float, full_hz: float) -> str:
    """Say why a run expects more error than requested.

    Args:
        of_file: Whether the modes come from a file.
        limit_hz: Limit of the modes, Hz.
        full_hz: Limit of the modes that the step supports, Hz.
    """
    steps = (
        "the law's force jumps, or is held from sample to sample, and its steps cost that, not the "
        "modes; actuator.bandwidth_hz, or of a held force a smaller run.step_ns, makes them smaller"
    )
    if of_file:
        return "all modes of the file"
    if limit_hz < (1.0 - 1e-9) * full_hz:
        return steps
    return "the limit of this time step; a smaller run.step_ns supports more modes"
