"""A run as plain data, which `--json` writes, and as tables and sentences on the terminal."""

import ctypes
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields
from pathlib import Path
from threading import Thread
from typing import Any

from rich.console import Console
from rich.text import Text

from hertzloop.analysis.figures import Figures, free_figures, no_loop
from hertzloop.analysis.impacts import through_first_contact
from hertzloop.analysis.meters import Comparison, RunFigures, SpanFigures, change_db
from hertzloop.analysis.model import PlantParts, parts_of
from hertzloop.analysis.recorded import LawRan, PacedClock, Pacing, blocks_of
from hertzloop.analysis.trust import (
    ImpactErrors,
    LawAccuracy,
    Predictability,
    Verification,
    errors_of,
    verify,
)
from hertzloop.analysis.verdict import Judged, judge
from hertzloop.controller.loading.registry import controls
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.registry import STRUCTURES
from hertzloop.processes import fork_server
from hertzloop.processes.launcher import RunOptions, Transport, record
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import Recording, read
from hertzloop.recordings.writer import RecordingError
from hertzloop.setup import Setup
from hertzloop.views.effects import brief_warnings, effects_as_json, show_neglected
from hertzloop.views.format import LEGEND, UNKNOWN, Table, about, known_digits, styled
from hertzloop.views.sentences import (
    UNSTABLE,
    law_line,
    pacing_sentences,
    verdict_sentences,
    why_not_words,
)

_M_ARENA_MAX = -8  # of glibc: the most heaps
_BESIDE = 10  # nice value of what must not delay the loop
_CLOCK = [f.name for f in fields(PacedClock)]
_MISSED = [f.name for f in fields(Pacing)]


def _fields(found: Any) -> dict[str, Any] | None:
    return None if found is None else asdict(found)


def figures_as_json(found: Figures) -> dict[str, Any]:
    """`impacts` and `noise`, a dictionary each; `first_impact`, `whole_run`, `stability`, `demand`
    and `push`; `validity` and `warnings` as in `effects_as_json`."""
    return {
        "impacts": [asdict(one) for one in found.impacts],
        "noise": [asdict(one) for one in found.noise],
        "first_impact": _fields(found.first_impact),
        "whole_run": _fields(found.whole_run),
        "last_contact_ended": found.last_contact_ended,
        "stability": asdict(found.stability),
        "demand": _fields(found.demand),
        "push": _fields(found.push),
        **effects_as_json(found.neglected),
    }


def figures_in(report: Mapping[str, Any]) -> RunFigures:
    """The figures in what `run --json` or `inspect --json` writes."""
    spans = {span: report[span] and SpanFigures(**report[span])
             for span in ("first_impact", "whole_run")}  # fmt: skip
    return RunFigures(**spans)


def law_in(report: Mapping[str, Any]) -> LawRan:
    """The law in it."""
    return LawRan(**{f.name: report[f.name] for f in fields(LawRan)})


def pacing_as_json(found: Pacing | None) -> dict[str, Any] | None:
    """Missed deadlines of a paced or repeated run, and what the clock said of a paced one."""
    if found is None:
        return None
    data = asdict(found)
    clock, is_repeat = data.pop("clock"), data.pop("is_repeat")
    return data | (clock or {"pace": None, "is_repeat": is_repeat})


def pacing_in(report: Mapping[str, Any]) -> Pacing | None:
    """What `pacing_as_json` has written into a report."""
    data = report.get("pacing")
    if not data:
        return None
    clock = None if data["pace"] is None else PacedClock(**{key: data[key] for key in _CLOCK})
    missed = {key: value for key, value in data.items() if key in _MISSED}
    return Pacing(**({"is_repeat": False} | missed), clock=clock)


def predictability_as_json(found: Predictability) -> dict[str, Any]:
    """Fields as in `Predictability`; `why_not` in words."""
    return {
        "disturbance": found.disturbance,
        "model_error": found.model_error,
        "controlled": _known(found.controlled),
        "uncontrolled": _known(found.uncontrolled),
        "why_not": why_not_words(found.not_again),
    }


def _known(found: list[ImpactErrors] | None) -> list[dict[str, Any]] | None:
    return None if found is None else [asdict(each) for each in found]


def known_in(found: list[dict[str, Any]] | None) -> list[ImpactErrors] | None:
    """What is known of the impacts of a run, from what `predictability_as_json` writes."""
    return None if found is None else [ImpactErrors(**each) for each in found]


def verification_as_json(found: Verification | None) -> dict[str, float] | None:
    """Fields as in `Verification`, and the largest change."""
    return None if found is None else {**asdict(found), "largest": found.largest}


def _law_accuracy(found: LawAccuracy | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {**asdict(found), "largest": found.by_modes.largest, "kept": found.kept}


def comparison_as_json(found: Comparison) -> list[dict[str, Any]]:
    """A dictionary for each figure, with fields as in `Difference`."""
    return [asdict(row) for row in found.rows]


def judged_as_json(found: Judged) -> dict[str, Any]:
    """All figures of a recorded run, and what they come to."""
    ran, ends = found.ran, found.conclusions
    data = {
        **asdict(found.law),
        "injected_j": ran.injected_j,
        "yield": _fields(found.yielded),
        "expected_error": ran.expected_error,
        "requested_accuracy": found.requested_accuracy,
        **figures_as_json(ran.figures),
        "pacing": pacing_as_json(found.pacing),
    }
    if found.free is not None:
        data["uncontrolled"] = figures_as_json(found.free)
    return data | {
        "predictability": predictability_as_json(ends.predictability),
        "law_accuracy": _law_accuracy(ends.law_accuracy),
        "verdict": verdict_sentences(ends.verdict),
    }


def struck(setup: Setup) -> dict[str, Any]:
    """The structure: `name`, `closed_form`, and what its modes are worth; see `Reached` and
    `ModalStructure.mobility_ratio`."""
    what = setup.structure
    if what.quality is None:
        plain = what.simply_supported is not None
        return {"name": "a simply supported plate" if plain else str(what), "closed_form": True}
    modes = setup.scene.plate.modes
    of_file = {} if what.mode_table is None else {"sha256": modes.sha256 if modes else ""}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}


def _parts(found: PlantParts) -> dict[str, Any]:
    data = asdict(found)
    if found.theory is not None:
        error = found.theory.kirchhoff_error
        data["theory"]["kirchhoff_error"] = error._asdict() | {"largest": error.largest}
    return data


def run_as_json(
    setup: Setup,
    recording: Recording,
    judged: Judged,
    *,
    transport: str,
    wall_s: float,
    exchanges: int,
    lane: str = "",
    realtime: str = "",
) -> dict[str, Any]:
    """Everything that `run --json` writes."""
    books = recording.books
    if books is None:
        raise ValueError("the recording has no energy balance: the run did not end")
    return {
        "scene": setup.name,
        "seed": setup.seed,
        "transport": transport,
        "scheme": setup.scheme,
        "steps": setup.steps,
        "wall_s": wall_s,
        "real_time_factor": setup.duration_s / wall_s if wall_s else math.inf,
        "exchanges": exchanges,
        "lane": lane,
        "realtime": realtime,
        "residuals": {"momentum": books.momentum_residual, "energy": books.energy_residual},
        **_parts(parts_of(setup, books)),
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "struck": struck(setup),
        "newton_iterations_max": books.newton_iterations_max,
        "recording": str(recording.path),
        "uncontrolled": figures_as_json(judged.free or judged.ran.figures),
        **judged_as_json(judged),
    }


@contextmanager
def _compared_beside(
    setup: Setup, options: RunOptions, on_progress: Callable[[int], None]
) -> Iterator[Callable[[int], None]]:
    """Simulate the run without control while the processes of the run start, and from the end of
    their loop on; the figures are kept. Yields what is to be told of the progress.

    Not in a run that follows the wall clock, nor where the loop runs in this process: a thread
    that calls Python would delay each of its blocks. What else a run is compared with is simulated
    after it, since it would take a core from the loop.
    """
    if options.transport is not Transport.ZENOH or options.pace:
        yield on_progress
        return
    setup.check()
    fork_server.prepare()  # before there is a thread
    with suppress(AttributeError):  # of another C library than glibc
        # A heap of the thread's own would keep its largest size, beside that of this thread.
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)

    def simulate() -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _BESIDE)  # of this thread
        with suppress(Exception):  # raised again where the figures are needed
            free_figures(setup)

    def hear(step: int) -> None:
        if step < setup.steps:
            no_loop.clear()
        else:
            no_loop.set()
        on_progress(step)

    beside = Thread(target=simulate, daemon=True)
    beside.start()
    try:
        yield hear
    finally:
        no_loop.set()
    beside.join()


def run_scene(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene; the report that `run --json` writes. Raises as `record`."""
    with _compared_beside(setup, options, on_progress) as hear:
        stats = record(setup, recording, options, hear)
    recorded = read(recording)
    if recorded.metadata.get("run_id") != stats["run_id"]:
        raise RecordingError(
            f"{recording} holds run {recorded.metadata.get('run_id')}, not {stats['run_id']} that "
            "was started here: another run has replaced it"
        )
    if recorded.problems:
        raise RecordingError(f"{recording}: {recorded.problems[0]}")
    verified = None
    if options.verify:
        rows = through_first_contact(blocks_of(recorded))
        verified = verify(setup, rows)
    report = run_as_json(
        setup,
        recorded,
        judge(setup, recorded, free_figures(setup)),
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
        lane=stats["lane"],
        realtime=stats.get("realtime", ""),
    )
    if options.repeat:
        report["repeats"] = str(options.repeat)
        report["differs"] = first_difference(read(options.repeat), recorded)
    if options.verify:
        report["verification"] = verification_as_json(verified)
    return report


_SHOWN = 12  # impacts in a table; --json has them all
# Heading, key, factor and usual format.
_COLUMNS = (
    ("start (ms)", "start_s", 1e3, ".4f"),
    ("duration (us)", "duration_s", 1e6, ".2f"),
    ("impact (m/s)", "impact_speed_m_s", 1.0, ".4f"),
    ("rebound (m/s)", "rebound_speed_m_s", 1.0, ".4f"),
    ("peak force (N)", "peak_force_n", 1.0, ".4g"),
    ("plate energy ({unit})", "plate_energy_j", 0.0, ".4g"),  # factor: see `energy_unit`
    ("plate speed (m/s)", "plate_speed_max_m_s", 1.0, ".4g"),
)


def headings(impacts: list[dict[str, float]]) -> list[str]:
    """Return the headings of the columns, with the unit that suits the energies."""
    _, unit = energy_unit(impact["plate_energy_j"] for impact in impacts[:_SHOWN])
    return [heading.format(unit=unit) for heading, *_ in _COLUMNS]


def impacts_table(
    title: str,
    impacts: list[dict[str, float]],
    known: list[dict[str, Any]] | None = None,
    why_not: str = "",
) -> Table:
    """Impacts, one a row; see `impact_rows`."""
    table = Table(title=title)
    for heading in headings(impacts):
        table.add_column(heading, justify="right")
    rows, notes = impact_rows(impacts, known, why_not)
    for row in rows:
        table.add_row(*row)
    table.caption = "; ".join(notes) or None
    return table


def energy_unit(energies_j: Iterable[float]) -> tuple[float, str]:
    """Return the factor from J and the unit in which four digits of energies need no exponent."""
    large = max((abs(energy) for energy in energies_j), default=0.0) >= 1e-2
    return (1e3, "mJ") if large else (1e6, "uJ")


def impact_rows(
    impacts: list[dict[str, float]], known: list[dict[str, Any]] | None = None, why_not: str = ""
) -> tuple[list[list[str]], list[str]]:
    """Rows of the table below `headings`, and notes on them.

    Args:
        impacts: Fields as in `Impact`.
        known: Fields as in `Known`, one for each impact: one that depends chaotically on those
            before it has its predictable digits, and none are listed once there are none.
        why_not: Why nothing is known of the digits, where that is so.
    """
    rows: list[list[str]] = []
    notes: list[str] = []
    to_unit, _ = energy_unit(impact["plate_energy_j"] for impact in impacts[:_SHOWN])
    digits = known_in(known)
    for i, impact in enumerate(impacts[:_SHOWN]):
        errors = errors_of(digits, i)
        cells = [
            known_digits(
                impact[key] * (factor or to_unit), form, errors.get(key, 0.0) * (factor or to_unit)
            )
            for _, key, factor, form in _COLUMNS
        ]
        if all(cell == UNKNOWN for cell in cells):
            notes.append(f"impacts from number {i + 1} on are not predictable")
            break
        rows.append(cells)
    else:
        if len(impacts) > _SHOWN:
            notes.append(f"and {len(impacts) - _SHOWN} more; --json has them all")
    if digits is not None and any(each.chaotic for each in digits[: len(rows)]):
        grown = digits[min(1, len(digits) - 1)].amplification
        notes.insert(
            0,
            "only predictable digits are shown: the second impact magnifies the model's error "
            f"{about(grown)} times",
        )
        if any(UNKNOWN in row for row in rows):
            notes.append(LEGEND)
    if why_not and len(impacts) > 1:
        notes.append(
            "digits as recorded: how many are predictable after the first impact is not known, "
            f"since {why_not}"
        )
    return rows, notes


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
    ("sigma E to 20 kHz, eq. 3.12 (study)", "radiated_j", 1e6, "uJ"),
    ("sigma E to 20 kHz, eq. 3.13", "radiated_maidanik_j", 1e6, "uJ"),
    ("radiated to 20 kHz, eq. 3.12", "sound_j", 1e6, "uJ"),
    ("radiated to 20 kHz, eq. 3.13", "sound_maidanik_j", 1e6, "uJ"),
)
_AMPLITUDES = ("peak_pressure_pa", "plate_speed_max_m_s")


def noise_table(
    columns: list[tuple[str, dict[str, float]]],
    compare: bool = True,
    errors: Sequence[dict[str, float]] = (),
) -> Table:
    """Noise figures of the first impact, one column a case; the change from the second to the
    first in dB where there are two and they `compare`, in per cent for speed, height and time.
    `errors`: of each column's figures, none where all digits count."""
    compare = compare and len(columns) == 2
    table = Table(title="Noise and vibration of the first impact")
    table.add_column("figure")
    for heading, _ in columns:
        table.add_column(heading, justify="right")
    if compare:
        table.add_column("change", justify="right")
    rows = noise_rows([figures for _, figures in columns], compare, errors)
    for row in rows:
        table.add_row(*row)
    notes = []
    if any(math.isnan(figures["radiated_j"]) for _, figures in columns):
        notes.append("radiation is known for simply supported plates with modes that can be summed")
    if any(UNKNOWN in row for row in rows):
        notes.append(LEGEND)
    table.caption = "; ".join(notes) or None
    return table


def noise_rows(
    columns: list[dict[str, float]], compare: bool, errors: Sequence[dict[str, float]] = ()
) -> list[list[str]]:
    """The rows of that table: label, a cell for every column, and the change if they `compare`."""
    rows = []
    for label, key, factor, unit in _NOISE_ROWS:
        values = [figures[key] for figures in columns]
        if unit == "uJ":
            factor, unit = energy_unit(values)
        wrong = [found.get(key, 0.0) for found in errors] or [0.0] * len(values)
        cells = [
            "not defined" if math.isnan(value) else _with_unit(
                known_digits(value * factor, ".4g", error * factor), unit
            )
            for value, error in zip(values, wrong, strict=True)
        ]  # fmt: skip
        if compare:
            cells.append(_change(key, *values, *wrong))
        rows.append([label, *cells])
    return rows


def _with_unit(number: str, unit: str) -> str:
    return number if number == UNKNOWN else f"{number} {unit}"


def _change(
    key: str, value: float, reference: float, error: float = 0.0, reference_error: float = 0.0
) -> str:
    """Ratio in dB for energies and amplitudes, in per cent otherwise."""
    if reference == 0.0 or math.isnan(value):
        return ""
    if key in ("contact_time_s", "next_impact_speed_m_s", "rebound_height_m"):
        if value > 1e3 * reference:  # what is divided by lies within the model's error
            return "from nearly zero"
        percent = 100.0 * value / reference
        wrong = 100.0 * (error + reference_error * abs(value / reference)) / abs(reference)
        return _with_unit(known_digits(percent, ".1f", wrong), "%")
    factor = 20.0 if key in _AMPLITUDES else 10.0
    change, wrong = change_db(value, reference, factor, error, reference_error)
    return "" if math.isnan(change) else _with_unit(known_digits(change, "+.2f", wrong), "dB")


def run_table(report: dict[str, Any]) -> Table:
    """Key figures of the run itself."""
    residuals = report["residuals"]
    table = Table(show_header=False)
    table.add_column()
    table.add_column()
    table.add_row(
        "scene, seed, transport", f"{report['scene']}, {report['seed']}, {report['transport']}"
    )
    table.add_row("law that ran", styled(law_line(law_in(report))))
    table.add_row("steps", f"{report['steps']:,}")
    table.add_row(
        "wall time",
        f"{report['wall_s']:.4g} s, {report['real_time_factor']:.3g} times real time, "
        f"{report['steps'] / max(report['wall_s'], 1e-9):,.0f} steps/s",
    )
    if note := SCHEMES[report["scheme"]].note:
        table.add_row("scheme", f"{report['scheme']}: {note}")
    if report["demand"]:
        table.add_row("actuator demand", demand_words(report["demand"]))
    if report["limiting_pressure"]:
        table.add_row("limiting pressure", pressure_words(report["limiting_pressure"]))
    if report["yield"]:
        table.add_row("yield", yield_words(report["yield"]))
    if report["radiation"]:
        table.add_row("radiation", radiation_words(report["radiation"]))
    table.add_row("exchanges", _exchanges(report))
    if report["realtime"]:
        table.add_row("real-time profile", styled(report["realtime"]))
    if not report["struck"]["closed_form"]:
        table.add_row("structure", _struck(report["struck"]))
    asked = STRUCTURES.get(report["theory"]["asked"]) if report["theory"] else None
    if report["theory"] and (asked is None or asked.solid):  # None: "auto"
        table.add_row("plate theory", theory_words(report["theory"]))
    table.add_row("plate model", _model_order(report))
    if report["tail"]:
        table.add_row("truncated modes", tail_words(report["tail"]))
    if report["model"] is not None:
        if "modes_in_file" not in report["struck"]:
            table.add_row("full model", _full_model(report["model"]))
        if offered := _infinite_plate(report):
            table.add_row("infinite plate", offered)
    table.add_row("contact solve", f"at most {report['newton_iterations_max']} evaluations a step")
    table.add_row(
        "residuals",
        f"energy {residuals['energy']:.1e}, momentum {residuals['momentum']:.1e} (relative)",
    )
    return table


_LANES = {
    "JOINED": "in the fast lane",
    "UNSAID": "over the bus; the controller knows of no fast lane",
    "OTHER_HOST": "over the bus, the controller being on another host",
    "NOT_ALLOWED": "over the bus; the controller could not open the plant's shared memory",
    "SWITCHED_OFF": "over the bus, the controller's fast lane being switched off",
}


def _exchanges(report: dict[str, Any]) -> str:
    """How many, how many a second, and which way."""
    words = f"{report['exchanges']:,}"
    if report["transport"] != "zenoh":
        return words
    way = _LANES.get(report["lane"], "over the bus, without fast lane")
    return f"{words}, {report['exchanges'] / max(report['wall_s'], 1e-9):,.0f}/s, {way}"


def _struck(struck: dict[str, Any]) -> str:
    """Describe a structure that is not a simply supported plate, and how well it is known."""
    if "low_modes" in struck:
        return (
            f"{struck['name']}: {struck['low_modes']} modes by Ritz's method, whose frequencies "
            f"change by {struck['low_change']:.1g} at most with the basis; those beyond, by phases "
            f"at the edges, to {struck['beyond_error']:.1g}"
        )
    words = [f"{struck['name']}: {struck['modes_in_file']}, sha256 {struck['sha256'][:16]}"]
    if struck["mobility_ratio"] is not None:
        words.append(
            f"their mean mobility is {struck['mobility_ratio']:.3g} of an infinite plate's"
        )
    return "; ".join(words)


def yield_words(found: dict[str, float]) -> str:
    """Describe the permanent dent and the dissipated energy of a contact that yielded."""
    return (
        f"a dent of {found['dent_m'] * 1e6:.3g} um, {found['dissipated_j'] * 1e6:.4g} uJ dissipated"
    )


def pressure_words(limit: dict[str, Any]) -> str:
    """At which pressure a contact yields, and by what that was chosen."""
    words, by = f"{limit['pressure_pa'] * 1e-9:.3g} GPa", limit["by"]
    if by is None:
        return f"{words}, as the scene says"
    return (
        f"{words}: {by['factor']:g} times the {by['measure']} of the {by['body']}, "
        f"{by['value_pa'] * 1e-9:.3g} GPa, known to {100 * by['spread']:z.0f} %"
    )


def radiation_words(found: dict[str, float]) -> str:
    """What the plate gave to the air."""
    faces = "one face" if found["faces"] == 1 else "two faces"
    return f"{found['dissipated_j'] * 1e6:.4g} uJ radiated into air from {faces} during the run"


def demand_words(asked: dict[str, float]) -> str:
    """Largest force, slew and power that a run asked of its actuator."""
    words = (
        f"{asked['force_n']:.4g} N, {asked['slew_n_s'] * 1e-6:.3g} N/us, {asked['power_w']:.3g} W"
    )
    if asked["delay_s"]:
        words += f"; its bandwidth adds {asked['delay_s'] * 1e6:.3g} us to the latency"
    return words


def _model_order(report: dict[str, Any]) -> str:
    """What was chosen, what it is expected to cost, and whether that is what was asked."""
    if report["model"] is None:  # all modes that the step carries
        limit = report["frequency_limit_hz"] / 1e3
        return f"{report['frequencies']} frequencies up to {limit:.4g} kHz (pi/dt), as published"
    if report["model"]["plate_model"] == "infinite":
        return _chosen_infinite(report)
    chosen = (
        f"{report['frequencies']} frequencies up to {report['frequency_limit_hz'] / 1e3:.4g} kHz; "
        f"expected truncation error {error_words(report)} of penetration or plate energy"
    )
    if missed(report):
        return f"{chosen} (requested: {report['requested_accuracy']:g}; {what_limits(report)})"
    return chosen


def _chosen_infinite(report: dict[str, Any]) -> str:
    """The same for the infinite plate."""
    chosen = f"infinite plate, a dashpot of {report['model']['impedance_n_s_m']:.4g} N s/m"
    if math.isinf(report["expected_error"]):
        return f"{chosen}; what the missing reflections cost by the run's end is not known"
    found = f"{chosen}; missing reflections may cost {error_words(report)} by the run's end"
    asked = f" (requested: {report['requested_accuracy']:g}; missed)"
    return f"{found}{asked}" if missed(report) else found


def missed(report: dict[str, Any]) -> bool:
    """Whether a run expects more error than was asked for."""
    expected = report["expected_error"]
    return expected is not None and expected > 1.001 * report["requested_accuracy"]


def error_words(report: dict[str, Any]) -> str:
    """The expected error of a run; where more was missed than a digit shows, with the digits that
    show it."""
    expected = report["expected_error"]
    if expected is None or math.isinf(expected):
        return "unknown"
    words = (f"{expected:.{digits}g}" for digits in range(1, 17))
    if not missed(report):
        return next(words)
    return next(word for word in words if float(word) > report["requested_accuracy"])


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
        f"sufficient until {until_s * 1e3:.4g} ms, beyond the first contact "
        f"(run.plate_model, requested: {report['requested_accuracy']:g})"
    )


def show_verdict(console: Console, data: dict[str, Any]) -> None:
    """Print the verdict on a run, the first sentence in bold."""
    for i, sentence in enumerate(data["verdict"]):
        text = styled((sentence, "" if i else "bold"))
        if i == 0 and data["stability"]["unstable"]:
            text = styled((UNSTABLE, "bold red"), sentence[len(UNSTABLE) :])
        console.print(text)


def _verification_line(report: dict[str, Any]) -> Text:
    """What halving the step and doubling the modes changed."""
    found = report["verification"]
    if found is None:
        return styled("Nothing to verify: no impact ends within the run.")
    met = ("met", "") if found["largest"] <= report["requested_accuracy"] else ("missed", "red")
    return styled(
        f"Verified with half the step and modes to {found['frequency_limit_hz'] / 1e3:.4g} kHz: "
        f"penetration {found['penetration']:.1e}, rebound speed {found['rebound_speed']:.1e}, "
        f"plate energy {found['plate_energy']:.1e}; requested {report['requested_accuracy']:g}: ",
        met,
        ".",
    )


_MOST_WARNINGS = 8  # lines of neglected effects on the screen; --details prints all
# Label, key, factor, format and unit of a figure. A key without a span is of the whole run.
_FIGURES: tuple[tuple[str, str, str, float, str, str], ...] = (
    ("contacts, whole run", "whole_run", "contacts", 1.0, ".0f", ""),
    ("contact time, first contact", "first_impact", "contact_time_s", 1e6, ".4g", "us"),
    ("peak contact force", "first_impact", "peak_force_n", 1.0, ".4g", "N"),
    ("rebound speed", "first_impact", "rebound_speed_m_s", 1.0, ".3g", "m/s"),
    ("rebound height", "first_impact", "rebound_height_m", 1e3, ".3g", "mm"),
    ("plate energy, whole run", "whole_run", "plate_energy_j", 0.0, ".4g", "uJ"),
    ("plate energy", "first_impact", "plate_energy_j", 0.0, ".4g", "uJ"),
    ("radiated energy to 20 kHz", "first_impact", "radiated_j", 0.0, ".4g", "uJ"),
    ("largest plate speed", "first_impact", "plate_speed_max_m_s", 1.0, ".4g", "m/s"),
    ("peak pressure at 1 m (bound)", "first_impact", "peak_pressure_pa", 1.0, ".3g", "Pa"),
)
_IN_DB = ("plate_energy_j", "radiated_j", *_AMPLITUDES)


def figures_table(report: dict[str, Any], other: dict[str, Any] | None = None) -> Table:
    """Return the table of at most ten figures that ends a run.

    Args:
        report: The data of `run --json` or `inspect --json`.
        other: The figures of the same run without control. None if there is no comparison.

    Returns:
        One row for each figure: with control, without control, and the change, in dB for energies
        and amplitudes, and in per cent of the value without control otherwise.
    """
    known = report["predictability"] or {"controlled": None, "uncontrolled": None}
    compare = other is not None and not report["stability"]["unstable"]
    controlled = controls(report["scene_law"])
    cases = [(report, known["controlled"]), *([(other, known["uncontrolled"])] if other else [])]
    table = Table(title="Figures of the first impact")
    table.add_column("figure")
    for heading in ("with control" if controlled else "no control", "without")[: len(cases)]:
        table.add_column(heading, justify="right")
    if compare:
        table.add_column("change", justify="right")
    for label, span, key, factor, form, unit in _FIGURES:
        found = [(figures[span] or {}).get(key, math.nan) for figures, _ in cases]
        wrong = [_error_of(digits, span, key) for _, digits in cases]
        if factor == 0.0:
            factor, unit = energy_unit(one for one in found if not math.isnan(one))
        row = [
            "-" if math.isnan(value)
            else _with_unit(known_digits(value * factor, form, error * factor), unit)
            for value, error in zip(found, wrong, strict=True)
        ]  # fmt: skip
        if compare:
            row.append("" if key == "contacts" else _change_of_figure(key, *found, *wrong))
        table.add_row(label, *(cell.strip() for cell in row))
    return table


def _error_of(digits: list[dict[str, Any]] | None, span: str, key: str) -> float:
    """The largest absolute error of a figure; 0 if all its digits are predictable."""
    found = known_in(digits)
    if span == "first_impact":
        errors = errors_of(found, 0) | errors_of(found, 0, "noise_errors")
        return errors.get(key, 0.0)
    if key != "plate_energy_j":
        return 0.0
    return sum(errors_of(found, i).get(key, 0.0) for i in range(len(found or ())))


def _change_of_figure(
    key: str, value: float, reference: float, error: float, reference_error: float
) -> str:
    """The change that control makes; empty if it has no meaning."""
    if math.isnan(value) or math.isnan(reference) or reference == 0.0:
        return ""
    if key in _IN_DB:
        factor = 20.0 if key in _AMPLITUDES else 10.0
        change, wrong = change_db(value, reference, factor, error, reference_error)
        return "" if math.isnan(change) else _with_unit(known_digits(change, "+.1f", wrong), "dB")
    if abs(value) > 1e3 * abs(reference) or reference < 0.0 or value < 0.0:
        return ""
    wrong = 100.0 * (error + reference_error * abs(value / reference)) / abs(reference)
    return _with_unit(known_digits(100.0 * (value / reference - 1.0), "+.0f", wrong), "%")


def show_warnings(console: Console, report: dict[str, Any]) -> None:
    """Print one line for each effect outside its limit.

    Args:
        console: Where to print.
        report: The data of `run --json` or `inspect --json`.
    """
    lines = brief_warnings(report["validity"])
    for head, style, words in lines[:_MOST_WARNINGS]:
        console.print(styled((head, style), f" {words}"))
    if len(lines) > _MOST_WARNINGS:
        console.print(f"{len(lines) - _MOST_WARNINGS} more warnings: --details prints them.")


def print_run(
    console: Console, report: dict[str, Any], details: bool = False, warning: Text | None = None
) -> None:
    """Print the end of a run: verdict, figures, warnings and the next command.

    Args:
        console: Where to print.
        report: The data of `run --json`.
        details: Whether to print all tables as well.
        warning: One more warning, on what is not in the recording.
    """
    controlled = controls(report["scene_law"])
    if not report["verdict"]:
        what = "The run has control." if controlled else "The run has no control."
        console.print(styled((what, "bold")))
    show_verdict(console, report)
    console.print(figures_table(report, report["uncontrolled"] if controlled else None))
    show_warnings(console, report)
    if warning is not None:
        console.print(warning, soft_wrap=True)
    if details:
        _print_details(console, report)
    if "verification" in report:
        console.print(_verification_line(report), soft_wrap=True)
    show_pacing(console, report)
    _show_run_lines(console, report)


def _show_run_lines(console: Console, report: dict[str, Any]) -> None:
    """Print scene, law, errors, recording and the next command."""
    console.print(
        styled(
            f"Scene {report['scene']}, seed {report['seed']}, {report['transport']}, "
            f"{report['steps']:,} steps in {report['wall_s']:.3g} s. "
            f"Law: {law_line(law_in(report))}."
        )
    )
    console.print(
        styled(
            f"Model error {error_words(report)} (requested {report['requested_accuracy']:g}",
            ("; missed", "yellow") if missed(report) else "",
            f"). Energy residual {report['residuals']['energy']:.1e}, "
            f"momentum {report['residuals']['momentum']:.1e}.",
        )
    )
    console.print(
        styled("Recording: ", (report["recording"], "bold"), ". --details prints all figures."),
        soft_wrap=True,
    )
    console.print(
        styled("Next: ", (f"hertzloop replay {report['recording']}", "bold")), soft_wrap=True
    )


def _print_details(console: Console, report: dict[str, Any]) -> None:
    """Print all impacts, noise figures, properties of the run and neglected effects."""
    controlled, unstable = controls(report["scene_law"]), report["stability"]["unstable"]
    noise, free = report["noise"], report["uncontrolled"]
    known = report["predictability"]
    own, other = known["controlled"], known["uncontrolled"]
    errors = [errors_of(known_in(each), 0, "noise_errors") for each in (own, other)]
    if controlled:
        console.print(impacts_table("Impacts with control", report["impacts"], own))
        console.print(impacts_table("The same without control", free["impacts"], other))
        if noise and free["noise"]:
            cases = [("with control", noise[0]), ("without", free["noise"][0])]
            console.print(noise_table(cases, not unstable, errors))
    else:
        console.print(impacts_table("Impacts, no control", report["impacts"], own))
        if noise:
            console.print(noise_table([("no control", noise[0])], errors=errors[:1]))
    console.print(run_table(report))
    show_neglected(console, report["validity"])


def theory_words(found: dict[str, Any]) -> str:
    """Which theory a run took, and why."""
    size = f"Kirchhoff's theory may cost {found['kirchhoff_error']['largest']:.1g}"
    if STRUCTURES[found["chosen"]].solid:
        loud = "; a force that jumps has no limit as modes are added: give actuator.bandwidth_hz"
        return f"three dimensions; {size}{loud if found['jumps'] else ''}"
    if found["why_not_3d"]:
        return f"Kirchhoff; {size}, but {found['why_not_3d']}"
    return f"Kirchhoff; {size}, no more than asked"


def tail_words(found: dict[str, float]) -> str:
    """What stands for the modes left out where that is no spring."""
    words, away = (
        f"one damped mode dissipated {found['lost_j'] * 1e6:.3g} uJ",
        found["wavelengths_to_edge"],
    )
    if away >= found["needed"]:
        return words
    return f"{words}; not known so close to an edge, {away:.2g} of {found['needed']:g} wavelengths"


def what_limits(report: dict[str, Any]) -> str:
    """Why a run expects more error than was asked for, in words."""
    steps = (
        "the law's force jumps, or is held from sample to sample, and its steps cost that, not the "
        "modes; actuator.bandwidth_hz, or of a held force a smaller run.step_ns, makes them smaller"
    )
    if report["theory"] and STRUCTURES[report["theory"]["chosen"]].solid:
        allowed = "all that this step, or a contact as wide as the waves, allows"
        return f"{steps}; or it is {allowed}" if controls(report["scene_law"]) else allowed
    if "modes_in_file" in report["struck"]:
        return "all modes of the file"
    if report["frequency_limit_hz"] < (1.0 - 1e-9) * report["model"]["full"]["frequency_limit_hz"]:
        return steps
    return "the limit of this time step; a smaller run.step_ns supports more modes"


def show_pacing(console: Console, data: dict[str, Any]) -> None:
    """Print what is to be said of pace and repetition in a report, if anything."""
    paced = pacing_in(data)
    for sentence in pacing_sentences(paced) if paced else ():
        console.print(styled(sentence), soft_wrap=True)
    if "repeats" in data:
        differs = data["differs"]
        said = f"not the run in {data['repeats']}: {differs}" if differs else (
            f"the same bytes as in {data['repeats']}"
        )  # fmt: skip
        console.print(styled((f"Repeated: {said}.", "red" if differs else "bold")), soft_wrap=True)
