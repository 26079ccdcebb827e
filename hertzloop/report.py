"""Tables on the terminal."""

import math
from typing import Any

from rich.console import Console
from rich.table import Table

_SHOWN = 12  # impacts in a table; --json has them all


def impacts_table(title: str, impacts: list[dict[str, float]]) -> Table:
    """Impacts, one a row."""
    table = Table(title=title, title_justify="left")
    for heading in ("start (ms)", "duration (us)", "impact (m/s)", "rebound (m/s)",
                    "peak force (N)", "into the plate (uJ)"):  # fmt: skip
        table.add_column(heading, justify="right")
    for impact in impacts[:_SHOWN]:
        table.add_row(
            f"{impact['start_s'] * 1e3:.4f}",
            f"{impact['duration_s'] * 1e6:.2f}",
            f"{impact['impact_speed_m_s']:.4f}",
            f"{impact['rebound_speed_m_s']:.4f}",
            f"{impact['peak_force_n']:.4g}",
            f"{impact['plate_energy_j'] * 1e6:.4g}",
        )
    if len(impacts) > _SHOWN:
        table.caption = f"and {len(impacts) - _SHOWN} more; --json has them all"
    return table


_NOISE_ROWS = (
    ("contact time", "contact_time_s", 1e6, "us"),
    ("next impact speed", "next_impact_speed_m_s", 1.0, "m/s"),
    ("rebound height", "rebound_height_m", 1e3, "mm"),
    ("acceleration noise, Longhorn", "longhorn_j", 1e6, "uJ"),
    ("acceleration noise, Holmes", "holmes_j", 1e6, "uJ"),
    ("peak pressure bound at 1 m", "peak_pressure_pa", 1.0, "Pa"),
    ("transmitted energy, in time", "transmitted_j", 1e6, "uJ"),
    ("transmitted energy, by spectrum", "transmitted_spectrum_j", 1e6, "uJ"),
    ("largest plate speed", "plate_speed_max_m_s", 1.0, "m/s"),
    ("radiated energy to 20 kHz", "radiated_j", 1e6, "uJ"),
    ("the same with Maidanik's efficiency", "radiated_maidanik_j", 1e6, "uJ"),
)
_AMPLITUDES = ("peak_pressure_pa", "plate_speed_max_m_s")


def noise_table(columns: list[tuple[str, dict[str, float]]]) -> Table:
    """Noise figures of the first impact, one column a case; the change from the second to the
    first in dB where there are two, in per cent for speed, height and time."""
    table = Table(title="Noise and vibration of the first impact", title_justify="left")
    table.add_column("figure")
    for heading, _ in columns:
        table.add_column(heading, justify="right")
    if len(columns) == 2:
        table.add_column("change", justify="right")
    for label, key, factor, unit in _NOISE_ROWS:
        values = [figures[key] for _, figures in columns]
        cells = [f"{value * factor:.4g} {unit}" for value in values]
        if len(columns) == 2:
            cells.append(_change(key, *values))
        table.add_row(label, *cells)
    return table


def _change(key: str, value: float, reference: float) -> str:
    """Ratio in dB for energies and amplitudes, in per cent otherwise."""
    if reference == 0.0:
        return ""
    if key in ("contact_time_s", "next_impact_speed_m_s", "rebound_height_m"):
        return f"{100.0 * value / reference:.1f} %"
    if value / reference <= 0.0:
        return ""
    factor = 20.0 if key in _AMPLITUDES else 10.0
    return f"{factor * math.log10(value / reference):+.2f} dB"


def run_table(report: dict[str, Any]) -> Table:
    """Key figures of the run itself."""
    residuals = report["residuals"]
    table = Table(show_header=False)
    table.add_column()
    table.add_column()
    table.add_row(
        "scene, seed, transport", f"{report['scene']}, {report['seed']}, {report['transport']}"
    )
    table.add_row("steps", f"{report['steps']:,}")
    table.add_row(
        "wall time of the loop",
        f"{report['wall_s']:.3f} s, {report['real_time_factor']:.3g} times real time",
    )
    if report["scheme"] == "thesis2008":
        table.add_row("scheme", f"{report['scheme']}: published numerics, flaws included")
    table.add_row("exchanges waited for", f"{report['exchanges']:,}")
    table.add_row("model of the plate", _model_order(report))
    if report["model"] is not None:
        table.add_row("the full model", _full_model(report["model"]))
        if offered := _infinite_plate(report):
            table.add_row("infinite plate", offered)
    table.add_row("contact solve", f"at most {report['newton_iterations_max']} evaluations a step")
    table.add_row(
        "residuals",
        f"energy {residuals['energy']:.1e}, momentum {residuals['momentum']:.1e} (relative)",
    )
    return table


def _model_order(report: dict[str, Any]) -> str:
    """What was chosen, what it is expected to cost, and whether that is what was asked."""
    if report["scheme"] == "thesis2008":
        limit = report["frequency_limit_hz"] / 1e3
        return f"{report['frequencies']} frequencies up to {limit:.4g} kHz (pi/dt), as published"
    if report["model"]["plate_model"] == "infinite":
        return _chosen_infinite(report)
    chosen = (
        f"{report['frequencies']} frequencies up to {report['frequency_limit_hz'] / 1e3:.4g} kHz; "
        f"leaving out the rest may cost {report['expected_error']:.1g} of penetration or plate "
        "energy"
    )
    if report["expected_error"] > 1.001 * report["requested_accuracy"]:
        return (
            f"{chosen} (asked: {report['requested_accuracy']:g}; all that this step can "
            "carry, a smaller run.step_ns carries more)"
        )
    return chosen


def _chosen_infinite(report: dict[str, Any]) -> str:
    """The same for the infinite plate."""
    expected, asked = report["expected_error"], report["requested_accuracy"]
    chosen = f"infinite plate, a dashpot of {report['model']['impedance_n_s_m']:.4g} N s/m"
    if math.isinf(expected):
        return f"{chosen}; what the missing reflections cost by the run's end is not known"
    found = f"{chosen}; missing reflections may cost {expected:.1g} by the run's end"
    return f"{found} (asked: {asked:g}; missed)" if expected > asked else found


def _full_model(model: dict[str, Any]) -> str:
    """What all modes that the step can carry would have cost."""
    full = model["full"]
    limit = f"up to {full['frequency_limit_hz'] / 1e3:.4g} kHz = 1/(2 step)"
    if full["frequencies"] is None:
        return f"about {full['modes']:.2g} modes {limit}, too many to count here"
    words = [f"{full['frequencies']:,} frequencies {limit}"]
    if full["frequency_ratio"] is not None:
        words.append(f"{full['frequency_ratio']:.3g} times as many")
    if full["measured_ratio"] is not None:
        words.append(
            f"a step under force takes {full['measured_ratio']:.3g} times as long (measured)"
        )
    elif full["frequency_ratio"] is not None:
        words.append("a ratio of frequencies, not of measured time")
    return "; ".join(words)


def _infinite_plate(report: dict[str, Any]) -> str:
    """Until when an infinite plate would have done, where the first contact is over by then."""
    until_s = report["model"]["infinite_until_s"]
    if report["model"]["plate_model"] == "infinite" or until_s is None or not report["impacts"]:
        return ""
    first = report["impacts"][0]
    if first["start_s"] + first["duration_s"] > until_s:
        return ""
    return (
        f"would do until {until_s * 1e3:.4g} ms, beyond the first contact "
        f"(run.plate_model, asked: {report['requested_accuracy']:g})"
    )


def comparison_line(controlled: list[dict[str, float]], free: list[dict[str, float]]) -> str:
    """First impact with against without control, in words."""
    if not controlled or not free:
        return "No impact within the run."
    with_, without = controlled[0], free[0]
    energy = with_["plate_energy_j"] / without["plate_energy_j"]
    return (
        f"First impact with control against without: plate energy {100 * energy:.1f} %, rebound "
        f"speed {with_['rebound_speed_m_s']:.3f} against {without['rebound_speed_m_s']:.3f} m/s."
    )


def _verification_line(report: dict[str, Any]) -> str:
    """What halving the step and doubling the modes changed."""
    found = report["verification"]
    if found is None:
        return "Nothing to verify: no impact ends within the run."
    met = "met" if found["largest"] <= report["requested_accuracy"] else "[red]missed[/red]"
    return (
        f"Verified with half the step and modes to {found['frequency_limit_hz'] / 1e3:.4g} kHz: "
        f"penetration {found['penetration']:.1e}, rebound speed {found['rebound_speed']:.1e}, "
        f"plate energy {found['plate_energy']:.1e}; asked for {report['requested_accuracy']:g}: "
        f"{met}."
    )


def cost_table(title: str, costs: list[dict[str, Any]]) -> Table:
    """Measured costs of a group; the first case is the yardstick."""
    table = Table(title=title, title_justify="left")
    table.add_column("case")
    for heading in ("median", "least", "ratio"):
        table.add_column(heading, justify="right")
    for cost in costs:
        figures = (f"{cost[key]:.3g}" for key in ("median_us", "least_us", "ratio"))
        table.add_row(cost["case"], *figures)
    return table


def roofline_table(title: str, shares: list[dict[str, Any]]) -> Table:
    """What the parts of a step reach of the processor's peaks; rows of `studies.roofline`."""
    table = Table(title=title, title_justify="left")
    table.add_column("case", no_wrap=True)
    for heading in ("modes", "floor us", "pass us", "share", "step us", "share", "loops"):
        table.add_column(heading, justify="right")
    for share in shares:
        floor, alone, step = (share[key] for key in ("floor_us", "pass_us", "step_us"))
        case = share["case"].rsplit(", ", 1)[0]
        table.add_row(
            case, str(share["frequencies"]), f"{floor:.3f}", f"{alone:.3f}",
            f"{floor / alone:.0%}", f"{step:.3f}", f"{floor / step:.0%}",
            f"{share['of_two_pass']:.2f}",
        )  # fmt: skip
    rates = [share["gigabytes_s"] for share in shares]
    table.caption = (
        f"peaks: {shares[0]['gigaoperations_s']:.1f} G multiply-adds/s, {min(rates):.0f} to "
        f"{max(rates):.0f} GB/s; share: of the floor; loops: step in two-pass loops over 1104"
    )
    return table


def print_run(console: Console, report: dict[str, Any]) -> None:
    """The closing table of a run."""
    console.print(impacts_table("Impacts with control", report["impacts"]))
    console.print(impacts_table("The same without control", report["uncontrolled"]["impacts"]))
    with_, without = report["noise"], report["uncontrolled"]["noise"]
    if with_ and without:
        cases = [("with control", with_[0]), ("without", without[0])]
        console.print(noise_table(cases))
    console.print(run_table(report))
    if "verification" in report:
        console.print(_verification_line(report))
    console.print(comparison_line(report["impacts"], report["uncontrolled"]["impacts"]))
    console.print(
        f"Recording: [bold]{report['recording']}[/bold]. Look at it with "
        f"[bold]hertzloop replay {report['recording']}[/bold]",
        soft_wrap=True,
    )
