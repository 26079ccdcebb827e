"""A run as plain data, which `--json` writes, and as tables and sentences on the terminal."""

import ctypes
import math
import os
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from threading import Thread
from typing import Any

from rich.console import Console
from rich.text import Text

from hertzloop.analysis import effects, meters, model, trust
from hertzloop.analysis import verdict as verdicts
from hertzloop.analysis.cases import IN_WORDS, OTHER, Span
from hertzloop.analysis.figures import Figures, Ran, free_figures, no_loop
from hertzloop.analysis.impacts import through_first_contact
from hertzloop.analysis.recorded import IN_TIME, LawRan, PacedClock, Pacing, blocks_of
from hertzloop.bus.messages_pb2 import Books
from hertzloop.controller.loading.registry import NO_CONTROL, shipped
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.registry import STRUCTURES
from hertzloop.processes import fork_server
from hertzloop.processes.launcher import record
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.setup import Setup
from hertzloop.setup.controller import check_buildable, mean_latency_us
from hertzloop.views.format import Table, print_all, unwrapped

UNKNOWN = "unknown"  # in the place of a number without a predictable digit
LEGEND = f"{UNKNOWN}: not predictable"
_PLAIN = 7  # digits before the decimal point that are written without an exponent
# Decibels have one digit: the second depends on where in a sample the contact begins.
UNSTABLE = "UNSTABLE:"  # the first words of a verdict on an unstable loop
_LONGEST = 200  # characters that are shown of a controller's own words
_LATER = {
    verdicts.Later.NONE: "",
    verdicts.Later.PREDICTABLE: " in the first impact",
    verdicts.Later.UNPREDICTABLE: " (first impact; later ones are not predictable)",
    verdicts.Later.UNKNOWN: " (first impact; it is unknown whether later ones are predictable)",
}
_CHANGED = {"radiated_j": "radiated energy", "plate_speed_max_m_s": "largest plate speed"}
_MOVED = {
    trust.Moved.PENETRATION: "penetration",
    trust.Moved.REBOUND_SPEED: "rebound speed",
    trust.Moved.PLATE_ENERGY: "plate energy",
}


def known_digits(value: float, form: str, error: float = 0.0) -> str:
    """Write a number with the digits that its error leaves.

    Args:
        value: The number.
        form: Format specification of a number without error.
        error: Largest absolute error; 0 where all digits are predictable.

    Returns:
        The number as `form` has it or with fewer digits, "about 100" where digits before the
        decimal point are not predictable, `UNKNOWN` where none is.
    """
    # `z`: what is rounded to zero has no sign.
    usual = f"{value:+z{form[1:]}}" if form.startswith("+") else f"{value:z{form}}"
    if error == 0.0:
        return usual
    if not error < abs(value):  # as `_predictable` of analysis.verdict has it
        return UNKNOWN
    whole = math.floor(math.log10(abs(value)))
    digits = max(whole - math.floor(math.log10(error)), 1)
    # `#` keeps the zeros that are known.
    sign = "+" if form.startswith("+") else ""
    known = f"{value:{sign}#.{digits}g}".replace(".e", "e").removesuffix(".")
    shown = min(known, usual, key=lambda text: sum(c.isdigit() for c in text.partition("e")[0]))
    return about(value, digits, sign) if shown is known and whole >= digits else shown


def about(value: float, digits: int = 2, sign: str = "") -> str:
    """A rounded number in words, e.g. "about 300"; 0 digits before the point are no news."""
    rounded = float(f"{value:.{digits}g}")
    plain = abs(rounded) < 10.0**_PLAIN
    return f"about {rounded:{sign},.0f}" if plain else f"about {rounded:{sign}.{digits}g}"


def verdict_sentences(found: verdicts.RunVerdict) -> list[str]:
    """Render the verdict on a run as short sentences, the outcome of control first.

    Args:
        found: The typed verdict of `hertzloop.analysis.verdict`.

    Returns:
        One sentence for each fact. Each usually fits on a line of 80 columns.
    """
    said, figures = [], found.ran.figures
    stability = figures.stability
    if stability.unstable:
        said += _unstable(stability)
    if not stability.unstable and not figures.impacts:
        said.append("No impact occurs within the run.")
    if found.control:
        said += _control(found.control)
    if stability.pumps and not stability.unstable:
        said.append(_pumping(stability))
    if figures.impacts and not figures.last_contact_ended:
        said.append("The run ends during the last contact. Increase run.duration_s.")
    if saturation := found.ran.saturation:
        times = "once" if saturation.times == 1 else f"{saturation.times} times"
        first = f"first at {saturation.since_s * 1e3:.4g} ms (sensors.full_scale)"
        said.append(f"The sensor saturated {times}, {first}.")
    if found.law_accuracy:
        said += law_accuracy_sentences(found.law_accuracy)
    return said


def spans_differ(own_db: float, other_db: float | None, span: Span, hint: str) -> list[str]:
    """State the change of the plate energy in both spans where it differs by much.

    Args:
        own_db: The change in `span`, dB.
        other_db: The change in the other span, dB; None without one.
        span: The span that the command evaluates.
        hint: What to do, a sentence.

    Returns:
        One sentence and the hint, or nothing.
    """
    if other_db is None or not abs(other_db - own_db) > meters.MUCH_DB:
        return []
    return [
        f"Plate energy changes by {own_db:+.1f} dB {IN_WORDS[span]} and by {other_db:+.1f} dB "
        f"{IN_WORDS[OTHER[span]]}, because the contacts after the first differ. {hint}".strip()
    ]


def _unstable(stability: meters.Stability) -> list[str]:
    """State that the loop is unstable, from when, and how far it diverged."""
    said = [
        f"{UNSTABLE} the actuator supplies {stability.most_injected:.3g} times the impact energy."
    ]
    if stability.since_s is not None:
        said.append(
            f"From {stability.since_s * 1e3:.4g} ms on, it supplies more than the impact energy."
        )
    return [
        *said,
        f"Largest actuator force: {stability.largest_force_n:.3g} N, "
        f"{stability.of_contact:.3g} times the limit of the impact.",
        "An unstable run is not compared with the run without control.",
    ]


def _pumping(stability: meters.Stability) -> str:
    """State that the loop adds energy, although it does not diverge."""
    since = ""
    if stability.since_s is not None:
        since = f" from {stability.since_s * 1e3:.4g} ms on"
    return f"The loop adds energy{since}: {stability.fed_in:.2g} times the energy of the impact."


def _control(found: verdicts.Control) -> list[str]:
    """State what control changes, and why it does not help where that is so."""
    if found.outcome is verdicts.ControlEffect.IDLE:
        return ["Control has no effect: the law never commands a force."]
    if found.outcome is verdicts.ControlEffect.UNPREDICTABLE:
        return ["The effect of control is unpredictable: the model error exceeds the change."]
    change = known_digits(abs(found.energy_db), ".1f", found.error_db)
    over = _LATER[found.later]
    said = [
        {
            verdicts.ControlEffect.HELPS: f"Control reduces plate energy by {change} dB{over}.",
            verdicts.ControlEffect.HARMS: f"Control increases plate energy by {change} dB{over}.",
            verdicts.ControlEffect.HARDLY: f"Control leaves plate energy nearly unchanged{over}.",
        }[found.outcome]
    ]
    if found.whole_db is not None and abs(found.whole_db - found.energy_db) > meters.MUCH_DB:
        with_, without = found.contacts
        said.append(
            f"Over all contacts the change is {found.whole_db:+.1f} dB, with {with_} contact"
            f"{'s' if with_ > 1 else ''} instead of {without}."
        )
    for better, head in ((True, "Better"), (False, "Worse")):
        listed = [_change_sentence(one) for one in found.changes if one.better is better]
        of = "" if found.later is verdicts.Later.NONE else " (first impact)"
        if listed:
            said.append(f"{head}{of}: {', '.join(listed)}.")
    return [*said, *(_reasons(found.reasons) if found.reasons else [])]


def _change_sentence(found: verdicts.Change) -> str:
    if found.figure in _CHANGED:
        return f"{_CHANGED[found.figure]} {known_digits(found.value, '+.1f', found.error)} dB"
    if found.from_nothing:
        return "rebound height, from nearly zero"
    return (
        f"rebound height {known_digits(found.value, '.0f', found.error)} % of that without control"
    )


def _reasons(found: verdicts.Reasons) -> list[str]:
    """Render each reason why control does not help, one sentence each."""
    said = []
    if found.after_touch_s is not None and found.late_share is not None:
        said.append(
            f"the first force comes {1e6 * found.after_touch_s:.3g} us after contact begins "
            f"({100.0 * found.late_share:z.0f} % of it)"
        )
    if found.apart is not None:
        said.append(f"{100.0 * found.apart:z.0f} % of the control impulse acts without contact")
    if found.injected_j is not None:
        said.append(f"the actuator adds {1e6 * found.injected_j:.3g} uJ to the plate")
    if found.dent_m is not None:
        said.append(
            f"the law takes the permanent dent of {1e6 * found.dent_m:.2g} um for penetration"
        )
    return [f"Reason: {one}." for one in said]


def law_accuracy_sentences(found: trust.LawAccuracy) -> list[str]:
    """State which figure twice the modes change, by how much, and why.

    Args:
        found: Accuracy of a run under its law.

    Returns:
        One or two sentences.
    """
    figure, by_modes = found.most_moved, found.by_modes
    said = [
        f"Accuracy missed: twice the modes change {_MOVED[figure]} "
        f"by {effects.percent(by_modes.largest)} (requested {effects.percent(found.asked)})."
    ]
    if found.latches_otherwise:
        said.append(
            f"With twice the modes the law latches {found.finer_delay_us:g} us instead of "
            f"{found.delay_us:g} us."
        )
    return said


def why_not_words(found: trust.NotAgain | None) -> str:
    """Why a run cannot be simulated again, in words that follow "since"; empty where it can."""
    if found is None:
        return ""
    if found.law is not None:
        law = law_line(found.law)
        return f"the forces may not come from the law of the scene: {law}"
    return {
        trust.Obstacle.NOT_ENDED: "the run did not end",
        trust.Obstacle.TOO_LONG: "it takes too long to simulate this run again",
        trust.Obstacle.NOT_HERE: f"the run cannot be simulated here: {found.error}",
    }.get(found.obstacle, found.error)


def law_line(data: LawRan) -> str:
    """Which law the forces of a recording come from."""
    ran, announced = law_words(data.law, data.law_digest), data.scene_law
    if data.as_announced or (ran and data.law == announced and data.law_digest is None):
        return ran
    said = ran or "not reported by the controller"
    scene = law_words(announced, data.scene_law_digest)
    return f"{said} (the scene says {scene})" if announced else said


def law_words(name: str | None, digest: str | None) -> str:
    """A law's name, with no more of it than fits, and what its files are."""
    words = "".join(c for c in " ".join((name or "").split()) if c.isprintable())[:_LONGEST]
    own = name is not None and name not in shipped()
    return f"{words}, digest {digest[:_LONGEST]}" if digest and own else words


def pacing_sentences(found: Pacing) -> list[str]:
    """What a person can act on."""
    missed = (
        f"{found.late_forces:,} of {found.steps:,} forces came late "
        f"({100 * found.share_late:.2g} %), at most {found.longest_row:,} in a row"
    )
    if not found.late_forces:
        missed = f"None of {found.steps:,} forces came late"
    clock = found.clock
    if clock is None:
        if found.is_repeat:
            return [f"{missed}, as in the run that this one repeats."]
        return [
            f"{missed} in what was recorded; the response times, which the plant tells at the end "
            "of a run, are not in it."
        ]
    said = [
        f"Pace {clock.pace:g}: {missed}"
        + (f", the worst {effects.time_words(clock.late_max_us)} late" * bool(found.late_forces))
        + f"; the plant itself was at most {effects.time_words(clock.behind_max_us)} behind the "
        "clock.",
        "From a sample to its answer: "
        + ", ".join(f"{name} {effects.time_words(us)}" for name, us in clock.response_us.items())
        + f" (of {effects.time_words(clock.slack_us)} that this pace leaves).",
    ]
    return [*said, _pacing_advice(clock)]


def _pacing_advice(found: PacedClock) -> str:
    controller, plant = found.controller_pace, found.plant_pace or found.controller_pace
    could = min(controller, plant)
    words = f"This machine, as it was, holds a pace of {could:.1g} with {100 * IN_TIME:g} % in time"
    if could >= found.pace:
        return f"{words}: this pace is below the limit."
    if plant < controller:
        return f"{words}: the plant limits the pace. Use --pace {could:.1g} or less."
    more_us = float(f"{found.latency_wanted_us:.2g}")
    return (
        f"{words}: use --pace {could:.1g} or less, increase controller.latency_us by {more_us:g}, "
        "or use an idle computer (and --realtime on)."
    )


def not_evaluated(neglected: effects.Neglected) -> str:
    """Return which effects have no size in this structure, in a sentence; empty if all have one."""
    if neglected.facts is None or neglected.facts.local is not None:
        return ""
    return (
        f"Not evaluated: {', '.join(effects.OF_PLATE)}. No plate at the contact point is known for "
        f"{neglected.facts.spec.plate}; for a file of modes, plate.thickness_m gives one."
    )


def effects_as_json(neglected: effects.Neglected) -> dict[str, Any]:
    """`validity`: all effects, fields as in `Finding`; `warnings`: sentences on those out of
    range."""
    shown = [asdict(found) for found in neglected.findings]
    beyond = [one for one in shown if one["state"] == effects.EffectState.OUT_OF_RANGE]
    return {"validity": shown, "warnings": [f"{one['name']}: {one['sentence']}" for one in beyond]}


_HEADS = {
    effects.EffectState.OUT_OF_RANGE: ("OUT OF RANGE:", "bold red"),
    effects.EffectState.LEFT_OUT: ("Neglected:", "yellow"),
}
_STATE_WORDS = {effects.EffectState.LEFT_OUT: "neglected", effects.EffectState.NOT_KNOWN: "unknown"}
_BRIEF = {row.name: (row.brief or row.name, row.key) for row in effects.ROWS}


def sentences_of(found: Iterable[effects.Finding]) -> list[tuple[str, str]]:
    """Heads and sentences on effects out of range, then on neglected effects."""
    return [(head, sentence) for head, _, sentence in _styled_sentences(found)]


def _styled_sentences(found: Iterable[effects.Finding]) -> list[tuple[str, str, str]]:
    known = list(found)
    return [(*_HEADS[state], f"{f.sentence}.") for state in _HEADS for f in known
            if f.state == state]  # fmt: skip


def brief_warnings(found: Iterable[effects.Finding]) -> list[tuple[str, str, str]]:
    """Render each effect outside its limit on one line of at most 80 columns.

    Args:
        found: The indicators.

    Returns:
        Head, style and text of each line: effects out of range first, then neglected ones.
    """
    known = list(found)
    lines = []
    for state, (head, style) in _HEADS.items():
        for one in known:
            if one.state != state:
                continue
            text, key = _BRIEF[one.name]
            if math.isnan(one.value):
                text = one.name
            words = text.format(x=one.value, p=effects.percent(one.value))
            lines.append((head, style, f"{words} ({key})." if key else f"{words}."))
    return lines


def neglected_lines(found: Iterable[effects.Finding]) -> list[Text]:
    """A sentence on each neglected effect."""
    return [unwrapped((head, style), f" {said}") for head, style, said in _styled_sentences(found)]


def table_of(found: Iterable[effects.Finding]) -> Table:
    """All indicators with their thresholds."""
    table = Table(title="Neglected effects")
    for heading in ("effect", "formula", "value", "threshold", ""):
        table.add_column(heading, justify="right" if heading in ("value", "threshold") else "left")
    for one in found:
        _, style = _HEADS.get(one.state, ("", ""))
        table.add_row(
            one.name, one.formula, "" if math.isnan(one.value) else f"{one.value:.2g}",
            f"{'>' if one.beyond < one.threshold else '<'} {one.threshold:.2g}",
            Text(_STATE_WORDS.get(one.state, one.state), style),
        )  # fmt: skip
    return table


_M_ARENA_MAX = -8  # of glibc: the most heaps
_BESIDE = 10  # nice value of what must not delay the loop


def _plain(found: Any) -> Any:
    """Dataclasses, alone or in a list, as dictionaries; anything else as it is."""
    if isinstance(found, list):
        return [asdict(one) for one in found]
    return asdict(found) if is_dataclass(found) else found  # type: ignore[arg-type]


def figures_as_json(found: Figures) -> dict[str, Any]:
    """`impacts` and `noise`, a dictionary each; `first_impact`, `whole_run`, `stability`, `demand`
    and `push`; `validity` and `warnings` as in `effects_as_json`."""
    data = {name: _plain(value) for name, value in vars(found).items() if name != "neglected"}
    return data | effects_as_json(found.neglected)


def pacing_as_json(found: Pacing | None) -> dict[str, Any] | None:
    """Missed deadlines of a paced or repeated run, and what the clock said of a paced one."""
    if found is None:
        return None
    data = asdict(found)
    clock, is_repeat = data.pop("clock"), data.pop("is_repeat")
    return data | (clock or {"pace": None, "is_repeat": is_repeat})


def predictability_as_json(found: trust.Predictability) -> dict[str, Any]:
    """Fields as in `Predictability`; `why_not` in words."""
    return {
        "disturbance": found.disturbance,
        "model_error": found.model_error,
        "controlled": _plain(found.controlled),
        "uncontrolled": _plain(found.uncontrolled),
        "why_not": why_not_words(found.not_again),
    }


def comparison_as_json(found: meters.Comparison) -> list[dict[str, Any]]:
    """A dictionary for each figure, with fields as in `Difference`."""
    return [asdict(row) for row in found.rows]


def judged_as_json(found: verdicts.Judged) -> dict[str, Any]:
    """All figures of a recorded run, and what they come to."""
    ran, ends = found.ran, found.conclusions
    data = {
        **asdict(found.law),
        "injected_j": ran.injected_j,
        "yield": _plain(found.yielded),
        "expected_error": ends.stated_error,
        "requested_accuracy": found.requested_accuracy,
        **figures_as_json(ran.figures),
        "pacing": pacing_as_json(found.pacing),
    }
    if found.free is not None:
        data["uncontrolled"] = figures_as_json(found.free)
    law = ends.law_accuracy
    more = {"largest": law.by_modes.largest} if law else {}
    return data | {
        "predictability": predictability_as_json(ends.predictability),
        "law_accuracy": None if law is None else asdict(law) | more,
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


def _parts(found: model.PlantParts) -> dict[str, Any]:
    data: dict[str, Any] = asdict(found)
    if found.theory is not None:
        data["theory"]["kirchhoff_error"] = found.theory.kirchhoff_error._asdict()
    return data


@dataclass(frozen=True)
class RunReport:
    """A recorded run, with all that is to be said of it. `struck` and `parts`: its structure, and
    what it took for its plant; `differs`: from the run that it `repeats`, empty if in nothing."""

    setup: Setup
    recording: Recording
    judged: verdicts.Judged
    books: Books
    struck: dict[str, Any]
    parts: model.PlantParts
    transport: str
    wall_s: float
    exchanges: int
    lane: str = ""
    realtime: str = ""
    repeats: Path | None = None
    differs: str | None = None
    verifies: bool = False
    verification: trust.Verification | None = None

    @property
    def expects(self) -> tuple[float | None, float]:
        """The expected error, and that asked for."""
        return self.judged.conclusions.stated_error, self.judged.requested_accuracy


def run_as_json(report: RunReport) -> dict[str, Any]:
    """Everything that `run --json` writes."""
    setup, books, wall_s, judged = report.setup, report.books, report.wall_s, report.judged
    data = {
        "scene": setup.name,
        "seed": setup.seed,
        "transport": report.transport,
        "scheme": setup.scheme,
        "steps": setup.steps,
        "wall_s": wall_s,
        "real_time_factor": setup.duration_s / wall_s if wall_s else math.inf,
        "exchanges": report.exchanges,
        "lane": report.lane,
        "realtime": report.realtime,
        "residuals": {"momentum": books.momentum_residual, "energy": books.energy_residual},
        **_parts(report.parts),
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "struck": report.struck,
        "newton_iterations_max": books.newton_iterations_max,
        "recording": str(report.recording.path),
        "uncontrolled": figures_as_json(judged.free or judged.ran.figures),
        **judged_as_json(judged),
    }
    if report.repeats:
        data |= {"repeats": str(report.repeats), "differs": report.differs}
    if report.verifies:
        data["verification"] = _plain(report.verification)
    return data


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
    check_buildable(setup)
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


def run_scene(setup: Setup, recording: Path, *how: Any) -> dict[str, Any]:
    """Run and record a scene; the report that `run --json` writes. Arguments as for `run_of`."""
    return run_as_json(run_of(setup, recording, *how))


def run_of(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> RunReport:
    """Run and record a scene, and judge the run. Raises as `record`."""
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
        verified = trust.verify(setup, through_first_contact(blocks_of(recorded)))
    judged = verdicts.judge(setup, recorded, free_figures(setup))
    books = recorded.books
    assert books is not None  # else there were a problem
    parts = model.parts_of(setup, books)
    return RunReport(
        setup, recorded, judged, books, struck(setup), parts,
        options.transport.value, stats["wall_s"], int(stats["exchanges"]),
        lane=stats["lane"], realtime=stats.get("realtime", ""), repeats=options.repeat,
        differs=first_difference(read(options.repeat), recorded) if options.repeat else None,
        verifies=options.verify, verification=verified,
    )  # fmt: skip


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


def headings(impacts: Sequence[Impact]) -> list[str]:
    """Return the headings of the columns, with the unit that suits the energies."""
    _, unit = energy_unit(impact.plate_energy_j for impact in impacts[:_SHOWN])
    return [heading.format(unit=unit) for heading, *_ in _COLUMNS]


def impacts_table(
    title: str,
    impacts: Sequence[Impact],
    known: Sequence[trust.ImpactErrors] | None = None,
    why_not: str = "",
) -> Table:
    """Impacts, one a row; see `impact_rows`."""
    table = Table(right=headings(impacts), title=title)
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
    impacts: Sequence[Impact], digits: Sequence[trust.ImpactErrors] | None = None, why_not: str = ""
) -> tuple[list[list[str]], list[str]]:
    """Rows of the table below `headings`, and notes on them.

    Args:
        impacts: The impacts.
        digits: One for each impact: one that depends chaotically on those before it has its
            predictable digits, and none are listed once there are none.
        why_not: Why nothing is known of the digits, where that is so.
    """
    rows: list[list[str]] = []
    notes: list[str] = []
    to_unit, _ = energy_unit(impact.plate_energy_j for impact in impacts[:_SHOWN])
    for i, impact in enumerate(impacts[:_SHOWN]):
        errors = trust.errors_of(digits, i)
        cells = [
            known_digits(
                getattr(impact, key) * (factor or to_unit),
                form,
                errors.get(key, 0.0) * (factor or to_unit),
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


# Noise figures in the order of their table; words and units of those that no span has.
_OF_NOISE = {
    "contact_time_s": meters.FigureRow("", "contact time", "us", 1e6),
    "next_impact_speed_m_s": meters.FigureRow("", "next impact speed", "m/s"),
    "transmitted_j": meters.FigureRow("", "transmitted energy, in time", "uJ", 1e6, 10.0),
    "transmitted_spectrum_j": meters.FigureRow(
        "", "transmitted energy, by spectrum", "uJ", 1e6, 10.0
    ),
    "radiated_maidanik_j": meters.FigureRow("", "sigma E to 20 kHz, eq. 3.13", "uJ", 1e6, 10.0),
    "sound_maidanik_j": meters.FigureRow("", "radiated to 20 kHz, eq. 3.13", "uJ", 1e6, 10.0),
}
_NOISE_ROWS = {
    name: _OF_NOISE.get(name) or meters.SPAN_ROWS[name]
    for name in (
        "contact_time_s", "next_impact_speed_m_s", "rebound_height_m", "longhorn_j", "holmes_j",
        "peak_pressure_pa", "transmitted_j", "transmitted_spectrum_j", "plate_speed_max_m_s",
        "radiated_j", "radiated_maidanik_j", "sound_j", "sound_maidanik_j",
    )
}  # fmt: skip


def noise_table(
    columns: list[tuple[str, ImpactNoise]],
    compare: bool = True,
    errors: Sequence[dict[str, float]] = (),
) -> Table:
    """Noise figures of the first impact, one column a case; the change from the second to the
    first in dB where there are two and they `compare`, in per cent for speed, height and time.
    `errors`: of each column's figures, none where all digits count."""
    compare = compare and len(columns) == 2
    right = [*(heading for heading, _ in columns), *["change"] * compare]
    table = Table("figure", right=right, title="Noise and vibration of the first impact")
    rows = noise_rows([figures for _, figures in columns], compare, errors)
    for row in rows:
        table.add_row(*row)
    notes = []
    if any(math.isnan(figures.radiated_j) for _, figures in columns):
        notes.append("radiation is known for simply supported plates with modes that can be summed")
    if any(UNKNOWN in row for row in rows):
        notes.append(LEGEND)
    table.caption = "; ".join(notes) or None
    return table


def noise_rows(
    columns: Sequence[ImpactNoise], compare: bool, errors: Sequence[dict[str, float]] = ()
) -> list[list[str]]:
    """The rows of that table: label, a cell for every column, and the change if they `compare`."""
    rows = []
    for key, row in _NOISE_ROWS.items():
        values = [getattr(one, key) for one in columns]
        wrong = [found.get(key, 0.0) for found in errors] or [0.0] * len(values)
        cells = _cells(row, values, wrong, ".4g", "not defined")
        if compare:
            cells.append(_change(row, *values, *wrong))
        rows.append([row.words, *cells])
    return rows


def _cells(
    row: meters.FigureRow, values: Sequence[float], errors: Sequence[float], form: str, without: str
) -> list[str]:
    """A figure of several runs with its unit and predictable digits; `without`: what nan says."""
    factor, unit = row.factor, row.unit
    if unit == "uJ":
        factor, unit = energy_unit(value for value in values if not math.isnan(value))
    return [
        without
        if math.isnan(value)
        else _with_unit(known_digits(value * factor, form, error * factor), unit)
        for value, error in zip(values, errors, strict=True)
    ]


def _with_unit(number: str, unit: str) -> str:
    return number if number == UNKNOWN else f"{number} {unit}"


def _change(
    row: meters.FigureRow,
    value: float,
    reference: float,
    error: float = 0.0,
    reference_error: float = 0.0,
) -> str:
    """The change in dB for energies and amplitudes, in per cent otherwise; empty where the sign
    of a value makes it meaningless."""
    if reference == 0.0 or math.isnan(value):
        return ""
    if not row.db:
        if reference < 0.0 or value < 0.0:
            return ""
        if value > 1e3 * reference:  # what is divided by lies within the model's error
            return "from nearly zero"
        share = 100.0 * (value / reference - 1.0)
        wrong = 100.0 * (error + reference_error * abs(value / reference)) / abs(reference)
        return _with_unit(known_digits(share, "+.1f", wrong), "%")
    return _in_db(meters.change_db(value, reference, row.db, error, reference_error), "+.2f")


def _in_db(found: tuple[float, float], form: str) -> str:
    """A change in dB and its error in words; empty where there is none."""
    change, wrong = found
    return "" if math.isnan(change) else _with_unit(known_digits(change, form, wrong), "dB")


def run_table(report: RunReport) -> Table:
    """Key figures of the run itself."""
    setup, parts, wall_s = report.setup, report.parts, report.wall_s
    books, demand = report.books, report.judged.ran.figures.demand
    judged, full = report.judged, parts.model and parts.model.full
    asked = STRUCTURES.get(parts.theory.asked) if parts.theory else None
    told = parts.theory if asked is None or asked.solid else None  # None: "auto"
    factor = setup.duration_s / wall_s if wall_s else math.inf
    note = SCHEMES[setup.scheme].note
    limit = parts.limiting_pressure
    rows = (
        ("scene, seed, transport", f"{setup.name}, {setup.seed}, {report.transport}"),
        ("law that ran", law_line(judged.law)),
        ("steps", f"{setup.steps:,}"),
        ("wall time", f"{wall_s:.4g} s, {factor:.3g} times real time, "
                      f"{setup.steps / max(wall_s, 1e-9):,.0f} steps/s"),
        ("scheme", note and f"{setup.scheme}: {note}"),
        ("actuator demand", demand and demand_words(demand)),
        ("limiting pressure", limit and pressure_words(limit)),
        ("yield", judged.yielded and yield_words(judged.yielded)),
        ("radiation", parts.radiation and radiation_words(parts.radiation)),
        ("mean latency", mean_latency_words(setup)),
        ("exchanges", _exchanges(report)),
        ("real-time profile", report.realtime),
        ("structure", "" if report.struck["closed_form"] else _struck(report.struck)),
        ("plate theory", told and theory_words(told)),
        ("plate model", _model_order(report)),
        ("truncated modes", parts.tail and tail_words(parts.tail)),
        ("full model", full and "modes_in_file" not in report.struck and _full_model(full)),
        ("infinite plate", parts.model and _infinite_plate(report, parts.model)),
        ("contact solve", f"at most {books.newton_iterations_max} evaluations a step"),
        ("residuals", f"energy {books.energy_residual:.1e}, "
                      f"momentum {books.momentum_residual:.1e} (relative)"),
    )  # fmt: skip
    table = Table("", "", show_header=False)
    for heading, words in rows:
        if words:
            table.add_row(heading, words)
    return table


def mean_latency_words(setup: Setup) -> str:
    """State the mean latency of the force that acts; empty if every command has the same."""
    line = setup.line
    if not (line.jitter_steps or line.trace or line.drop_out_probability):
        return ""
    mean_us = mean_latency_us(setup)
    if math.isnan(mean_us):
        return "no command acts within the run"
    return (
        f"{mean_us:.1f} us of the force that acts: commands keep their order, so "
        "that a late one delays those behind it"
    )


_LANES = {
    "JOINED": "in the fast lane",
    "UNSAID": "over the bus; the controller knows of no fast lane",
    "OTHER_HOST": "over the bus, the controller being on another host",
    "NOT_ALLOWED": "over the bus; the controller could not open the plant's shared memory",
    "SWITCHED_OFF": "over the bus, the controller's fast lane being switched off",
}


def _exchanges(report: RunReport) -> str:
    """How many, how many a second, and which way."""
    words = f"{report.exchanges:,}"
    if report.transport != Transport.ZENOH:
        return words
    way = _LANES.get(report.lane, "over the bus, without fast lane")
    return f"{words}, {report.exchanges / max(report.wall_s, 1e-9):,.0f}/s, {way}"


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


def yield_words(found: model.Yield) -> str:
    """Describe the permanent dent and the dissipated energy of a contact that yielded."""
    return f"a dent of {found.dent_m * 1e6:.3g} um, {found.dissipated_j * 1e6:.4g} uJ dissipated"


def pressure_words(limit: dict[str, Any]) -> str:
    """At which pressure a contact yields, and by what that was chosen."""
    words, by = f"{limit['pressure_pa'] * 1e-9:.3g} GPa", limit["by"]
    if by is None:
        return f"{words}, as the scene says"
    return (
        f"{words}: {by['factor']:g} times the {by['measure']} of the {by['body']}, "
        f"{by['value_pa'] * 1e-9:.3g} GPa, known to {100 * by['spread']:z.0f} %"
    )


def radiation_words(found: model.Radiation) -> str:
    """What the plate gave to the air."""
    faces = "one face" if found.faces == 1 else "two faces"
    return f"{found.dissipated_j * 1e6:.4g} uJ radiated into air from {faces} during the run"


def demand_words(asked: meters.Demand) -> str:
    """Largest force, slew and power that a run asked of its actuator."""
    words = f"{asked.force_n:.4g} N, {asked.slew_n_s * 1e-6:.3g} N/us, {asked.power_w:.3g} W"
    if asked.delay_s:
        words += f"; its bandwidth adds {asked.delay_s * 1e6:.3g} us to the latency"
    return words


def _model_order(report: RunReport) -> str:
    """What was chosen, what it is expected to cost, and whether that is what was asked."""
    books, model, (expected, asked) = report.books, report.parts.model, report.expects
    limit_hz, words = books.frequency_limit_hz, error_words(expected, asked)
    if model is None:  # all modes that the step carries
        return (
            f"{books.frequencies} frequencies up to {limit_hz / 1e3:.4g} kHz (pi/dt), as published"
        )
    if model.plate_model == "infinite":
        chosen = f"infinite plate, a dashpot of {model.impedance_n_s_m:.4g} N s/m"
        if expected is None or math.isinf(expected):
            return f"{chosen}; what the missing reflections cost by the run's end is not known"
        found = f"{chosen}; missing reflections may cost {words} by the run's end"
        return f"{found} (requested: {asked:g}; missed)" if missed(expected, asked) else found
    chosen = (
        f"{books.frequencies} frequencies up to {limit_hz / 1e3:.4g} kHz; "
        f"expected truncation error {words} of penetration or plate energy"
    )
    if not missed(expected, asked):
        return chosen
    theory, law = report.parts.theory, report.judged.law.scene_law
    why = what_limits(
        theory is not None and STRUCTURES[theory.chosen].solid, law != NO_CONTROL,
        "modes_in_file" in report.struck, limit_hz, model.full.frequency_limit_hz,
    )  # fmt: skip
    return f"{chosen} (requested: {asked:g}; {why})"


def missed(expected: float | None, asked: float) -> bool:
    """Whether a run expects more error than was asked for."""
    return expected is not None and expected > 1.001 * asked


def error_words(expected: float | None, asked: float) -> str:
    """The expected error of a run; where more was missed than a digit shows, with the digits that
    show it."""
    if expected is None or math.isinf(expected):
        return "unknown"
    words = (f"{expected:.{digits}g}" for digits in range(1, 17))
    if not missed(expected, asked):
        return next(words)
    return next(word for word in words if float(word) > asked)


def _full_model(full: model.FullModel) -> str:
    """What all modes that the step can carry would have cost."""
    limit = f"up to {full.frequency_limit_hz / 1e3:.4g} kHz = 1/(2 step)"
    if full.frequencies is None:
        return f"about {full.modes:.2g} modes {limit}, too many to count here"
    words = [f"{full.frequencies:,} frequencies {limit}"]
    if full.frequency_ratio is not None:
        words.append(f"{full.frequency_ratio:.3g} times as many")
    if full.measured_ratio is not None:
        words.append(f"a step under force takes {full.measured_ratio:.3g} times as long (measured)")
    elif full.frequency_ratio is not None:
        words.append("a ratio of frequencies, not of measured time")
    return "; ".join(words)


def _infinite_plate(report: RunReport, model: model.PlateModel) -> str:
    """Until when an infinite plate would have done, where the first contact is over by then."""
    until_s, impacts = model.infinite_until_s, report.judged.ran.figures.impacts
    if model.plate_model == "infinite" or until_s is None or not impacts:
        return ""
    if impacts[0].start_s + impacts[0].duration_s > until_s:
        return ""
    return (
        f"sufficient until {until_s * 1e3:.4g} ms, beyond the first contact "
        f"(run.plate_model, requested: {report.judged.requested_accuracy:g})"
    )


def verdict_lines(verdict: Sequence[str], unstable: bool) -> list[Text]:
    """The verdict on a run, the first sentence in bold."""
    lines = [Text(sentence, "" if i else "bold") for i, sentence in enumerate(verdict)]
    if lines and unstable:
        lines[0] = Text.assemble((UNSTABLE, "bold red"), verdict[0][len(UNSTABLE) :])
    return lines


def _verification_line(report: RunReport) -> Text:
    """What halving the step and doubling the modes changed."""
    found, asked = report.verification, report.judged.requested_accuracy
    if found is None:
        return unwrapped("Nothing to verify: no impact ends within the run.")
    met = ("met", "") if found.largest <= asked else ("missed", "red")
    return unwrapped(
        f"Verified with half the step and modes to {found.frequency_limit_hz / 1e3:.4g} kHz: "
        f"penetration {found.penetration:.1e}, rebound speed {found.rebound_speed:.1e}, "
        f"plate energy {found.plate_energy:.1e}; requested {asked:g}: ",
        met,
        ".",
    )


_MOST_WARNINGS = 8  # lines of neglected effects on the screen; --details prints all
# Label, span, key and format of a figure.
_FIGURES: tuple[tuple[str, str, str, str], ...] = (
    ("contacts, whole run", "whole_run", "contacts", ".0f"),
    ("contact time, first contact", "first_impact", "contact_time_s", ".4g"),
    ("peak contact force", "first_impact", "peak_force_n", ".4g"),
    ("rebound speed", "first_impact", "rebound_speed_m_s", ".3g"),
    ("rebound height", "first_impact", "rebound_height_m", ".3g"),
    ("plate energy, whole run", "whole_run", "plate_energy_j", ".4g"),
    ("plate energy", "first_impact", "plate_energy_j", ".4g"),
    ("radiated energy to 20 kHz", "first_impact", "radiated_j", ".4g"),
    ("largest plate speed", "first_impact", "plate_speed_max_m_s", ".4g"),
    ("peak pressure at 1 m (bound)", "first_impact", "peak_pressure_pa", ".3g"),
)
_IN_DB = {*meters.DECIBELS} - {"peak_force_n"}


def figures_table(ran: Ran, known: trust.Predictability, free: Figures | None = None) -> Table:
    """Return the table of at most ten figures that ends a run.

    Args:
        ran: The run.
        known: How well its figures, and those without control, can be known.
        free: The figures of the same run without control. None if there is no comparison.

    Returns:
        One row for each figure: with control, without control, and the change, in dB for energies
        and amplitudes, and in per cent of the value without control otherwise.
    """
    compare = free is not None and not ran.figures.stability.unstable
    cases = [(ran.figures, known.controlled), *([(free, known.uncontrolled)] if free else [])]
    own = "no control" if ran.scene_law == NO_CONTROL else "with control"
    right = [own, "without"][: len(cases)] + ["change"] * compare
    table = Table("figure", right=right, title="Figures of the first impact")
    for label, span, key, form in _FIGURES:
        found = [getattr(getattr(figures, span), key, math.nan) for figures, _ in cases]
        wrong = [_error_of(digits, span, key) for _, digits in cases]
        row = _cells(meters.SPAN_ROWS[key], found, wrong, form, "-")
        if compare:
            row.append("" if key == "contacts" else _change_of_figure(key, *found, *wrong))
        table.add_row(label, *(cell.strip() for cell in row))
    return table


def _error_of(digits: Sequence[trust.ImpactErrors] | None, span: str, key: str) -> float:
    """The largest absolute error of a figure; 0 if all its digits are predictable."""
    if span == "first_impact":
        errors = trust.errors_of(digits, 0) | trust.errors_of(digits, 0, "noise_errors")
        return errors.get(key, 0.0)
    if key != "plate_energy_j":
        return 0.0
    return sum(trust.errors_of(digits, i).get(key, 0.0) for i in range(len(digits or ())))


def _change_of_figure(
    key: str, value: float, reference: float, error: float, reference_error: float
) -> str:
    """The change that control makes; empty if it has no meaning."""
    if math.isnan(value) or math.isnan(reference) or reference == 0.0:
        return ""
    if key in _IN_DB:
        times = meters.DECIBELS[key]
        return _in_db(meters.change_db(value, reference, times, error, reference_error), "+.1f")
    if abs(value) > 1e3 * abs(reference) or reference < 0.0 or value < 0.0:
        return ""
    wrong = 100.0 * (error + reference_error * abs(value / reference)) / abs(reference)
    return _with_unit(known_digits(100.0 * (value / reference - 1.0), "+.0f", wrong), "%")


def warning_lines(found: Iterable[effects.Finding]) -> list[Text]:
    """One line for each effect outside its limit."""
    known = brief_warnings(found)
    lines = [Text.assemble((head, style), f" {words}") for head, style, words in known]
    if len(lines) > _MOST_WARNINGS:
        more = f"{len(lines) - _MOST_WARNINGS} more warnings: --details prints them."
        lines[_MOST_WARNINGS:] = [Text(more)]
    return lines


def print_run(
    console: Console, report: RunReport, details: bool = False, warning: Text | None = None
) -> None:
    """Print the end of a run: verdict, figures, warnings and the next command.

    Args:
        console: Where to print.
        report: The run.
        details: Whether to print all tables as well.
        warning: One more warning, on what is not in the recording.
    """
    judged, ends = report.judged, report.judged.conclusions
    ran, verdict = judged.ran, verdict_sentences(ends.verdict)
    controlled = ran.scene_law != NO_CONTROL
    said: list[Text | Table] = []
    if not verdict:
        said.append(Text(f"The run has {'' if controlled else 'no '}control.", "bold"))
    said += verdict_lines(verdict, ran.figures.stability.unstable)
    free = (judged.free or ran.figures) if controlled else None
    said.append(figures_table(ran, ends.predictability, free))
    said += warning_lines(ran.figures.neglected.findings)
    if warning is not None:
        said.append(warning)
    if details:
        said += _details(report)
    if report.verifies:
        said.append(_verification_line(report))
    said += pacing_lines(judged.pacing, report.repeats, report.differs)
    print_all(console, [*said, *_run_lines(report)])


def _run_lines(report: RunReport) -> list[Text]:
    """Scene, law, errors, recording and the next command."""
    setup, books, path = report.setup, report.books, str(report.recording.path)
    return [
        Text(
            f"Scene {setup.name}, seed {setup.seed}, {report.transport}, "
            f"{setup.steps:,} steps in {report.wall_s:.3g} s. "
            f"Law: {law_line(report.judged.law)}."
        ),
        Text.assemble(
            f"Model error {error_words(*report.expects)} "
            f"(requested {report.judged.requested_accuracy:g}",
            ("; missed", "yellow") if missed(*report.expects) else "",
            f"). Energy residual {books.energy_residual:.1e}, "
            f"momentum {books.momentum_residual:.1e}.",
        ),
        *next_lines(path),
    ]


def next_lines(path: str) -> list[Text]:
    """Where the recording is, and the next command."""
    return [
        unwrapped("Recording: ", (path, "bold"), ". --details prints all figures."),
        unwrapped("Next: ", (shlex.join(["hertzloop", "replay", path]), "bold")),
    ]


def _details(report: RunReport) -> list[Text | Table]:
    """All impacts, noise figures, properties of the run and neglected effects."""
    ran, known = report.judged.ran, report.judged.conclusions.predictability
    found, free = ran.figures, report.judged.free or ran.figures
    own, other = known.controlled, known.uncontrolled
    errors = [trust.errors_of(each, 0, "noise_errors") for each in (own, other)]
    if ran.scene_law != NO_CONTROL:
        tables = [
            impacts_table("Impacts with control", found.impacts, own),
            impacts_table("The same without control", free.impacts, other),
        ]
        if found.noise and free.noise:
            cases = [("with control", found.noise[0]), ("without", free.noise[0])]
            tables.append(noise_table(cases, not found.stability.unstable, errors))
    else:
        tables = [impacts_table("Impacts, no control", found.impacts, own)]
        if found.noise:
            tables.append(noise_table([("no control", found.noise[0])], errors=errors[:1]))
    return [*tables, run_table(report), *neglected_lines(found.neglected.findings)]


def theory_words(found: model.Theory) -> str:
    """Which theory a run took, and why."""
    size = f"Kirchhoff's theory may cost {found.kirchhoff_error.largest:.1g}"
    if STRUCTURES[found.chosen].solid:
        loud = "; a force that jumps has no limit as modes are added: give actuator.bandwidth_hz"
        return f"three dimensions; {size}{loud if found.jumps else ''}"
    if found.why_not_3d:
        return f"Kirchhoff; {size}, but {found.why_not_3d}"
    return f"Kirchhoff; {size}, no more than asked"


def tail_words(found: model.Tail) -> str:
    """What stands for the modes left out where that is no spring."""
    words, away = (
        f"one damped mode dissipated {found.lost_j * 1e6:.3g} uJ",
        found.wavelengths_to_edge,
    )
    if away >= found.needed:
        return words
    return f"{words}; not known so close to an edge, {away:.2g} of {found.needed:g} wavelengths"


def what_limits(
    solid: bool, controlled: bool, of_file: bool, limit_hz: float, full_hz: float
) -> str:
    """Why a run expects more error than was asked for, in words: of a solid, a controlled run, a
    file of modes, up to `limit_hz` where the step carries `full_hz`."""
    steps = (
        "the law's force jumps, or is held from sample to sample, and its steps cost that, not the "
        "modes; actuator.bandwidth_hz, or of a held force a smaller run.step_ns, makes them smaller"
    )
    if solid:
        allowed = "all that this step, or a contact as wide as the waves, allows"
        return f"{steps}; or it is {allowed}" if controlled else allowed
    if of_file:
        return "all modes of the file"
    if limit_hz < (1.0 - 1e-9) * full_hz:
        return steps
    return "the limit of this time step; a smaller run.step_ns supports more modes"


def pacing_lines(
    found: Pacing | None, repeats: Path | None = None, differs: str | None = None
) -> list[Text]:
    """What is to be said of pace and repetition, if anything."""
    lines = [unwrapped(sentence) for sentence in (pacing_sentences(found) if found else ())]
    if repeats:
        said = f"not the run in {repeats}: {differs}" if differs else (
            f"the same bytes as in {repeats}"
        )  # fmt: skip
        lines.append(unwrapped((f"Repeated: {said}.", "red" if differs else "bold")))
    return lines
