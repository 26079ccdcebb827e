"""One self-contained HTML page of a run."""

import base64
import io
import json
import shlex
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.decimation import extremes
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.plots import Plot, PlotCurve
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.recordings.replay.scene3d import with_unit
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.listening import write_sounds
from hertzloop.results.metrics import free_metrics
from hertzloop.results.predictability import errors_of
from hertzloop.results.recorded import law_of
from hertzloop.results.repeatability import why_not_repeatable
from hertzloop.results.verdict import RunAssessment, assess_recording
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import binding_mode, mode_line
from hertzloop.studies.margin.chart import draw
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.jitter import at_shortest_latency, jitter_margin_of
from hertzloop.studies.margin.sentences import jitter_lines, margin_lines
from hertzloop.studies.pages import pictures
from hertzloop.studies.pages.html import ResultTable, svg, template
from hertzloop.views import provenance
from hertzloop.views.effects import sentences_of
from hertzloop.views.impacts_table import impact_headings, impact_rows
from hertzloop.views.law_line import law_line, why_not_words
from hertzloop.views.noise_table import noise_rows
from hertzloop.views.provenance import text_of_law
from hertzloop.views.replaying import prepare, scene_of
from hertzloop.views.verdict import verdict_sentences

_POINTS = 1500  # a curve
_STYLES = {"F_a": 2, "F_c": 1, "measured": 4, "fed": 2, "contact": 1, "plate": 3}


def around_first_contact(shown: ReplayData) -> str:
    """Gap, forces, plate velocity and energies around the first contact."""
    return _sheet(shown.plots, shown.when.around_ns)


def whole_run(shown: ReplayData) -> str:
    """The same over all of the run."""
    truth = shown.recording.truth
    first, last = (int(truth.step_at(at)) * truth.step_ns for at in (0, truth.samples - 1))
    return _sheet(shown.plots, (first, last))


def spectra(shown: ReplayData) -> str:
    """Level of the plate velocity."""
    sheet, axes = pictures.sheet(1, 1, width=10.0, height=2.8)
    ax = axes[0, 0]
    for i, found in enumerate(shown.labels.spectra):
        ax.semilogx(found.frequency_hz, found.level_db, label=found.label, **pictures.look(i))
    ax.set(
        xlabel="frequency (Hz)",
        ylabel="level in 1/12 octaves\n(dB re 1 m/s)",
        title="Plate velocity at the contact, whole run",
    )
    _legend(ax)
    return svg(sheet)


def _sheet(plots: list[Plot], span_ns: tuple[int, int]) -> str:
    lines = -(-len(plots) // 2)
    sheet, axes = pictures.sheet(lines, 2, width=10.0, height=2.4)
    for ax, plot in zip(axes.ravel(), plots, strict=False):
        for curve in plot.curves:
            _draw(ax, curve, span_ns)
        limits = tuple(1e-6 * t for t in span_ns)
        ax.set(title=plot.title, xlabel="simulated time (ms)", xlim=limits)
        if plot.most is not None:
            ax.set_ylim(-plot.most, plot.most)
        _legend(ax)
    for ax in axes.ravel()[len(plots) :]:
        ax.remove()
    return svg(sheet)


def _draw(ax: Any, curve: PlotCurve, span_ns: tuple[int, int]) -> None:
    times, values = curve.time_ns, curve.values
    a, b = np.searchsorted(times, span_ns)
    if b - a >= len(times) - 1 and curve.overview is not None:  # all of it, evenly
        times, values = times[curve.overview], values[curve.overview]
    else:
        times, values = times[a : b + 1], values[a : b + 1]
    if not len(values) or not np.isfinite(values).any():
        return
    chosen = extremes(np.nan_to_num(values), _POINTS)
    style = pictures.look(_STYLES.get(curve.name, 0))
    style = {"color": "#888888", "linestyle": "--", "linewidth": 1.1} if curve.faint else style
    ax.plot(1e-6 * times[chosen], values[chosen], label=curve.label or curve.name, **style)


def _legend(ax: Any) -> None:
    """Beside the axes, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize=7)


_FRAMES = 240
_LEVELS = 127  # of a deflection, each way


def page_of(recording: Recording) -> str:
    """The page. Raises RecordingError if the recording cannot be read or replayed."""
    setup, shown = scene_of(recording), prepare(recording, drawn="Dashed")
    without = free_metrics(setup) if shown.labels.reference is not None else None
    found = assess_recording(setup, recording, without, why_not_repeatable(recording))
    metrics, verdict = found.result.metrics, found.assessment.verdict
    unstable = metrics.stability.unstable
    sounds, silent = _sounds(recording, setup)
    law, law_text, lawless = _law(recording)
    again, commands = _again(recording, setup, bool(law_text))
    margin, margin_png = _margin(recording, setup)
    return template("run.html.j2").render(
        title=shown.labels.heading,
        lines=[line.replace("**", "") for line in shown.labels.lines],
        problems=recording.problems,
        unstable=unstable,
        verdict=verdict_sentences(verdict),
        neglected=sentences_of(metrics.neglected.checks),
        margin=margin,
        margin_png=margin_png,
        tables=_tables(found, not unstable),
        around=around_first_contact(shown) if shown.contacts else "",
        whole=whole_run(shown),
        spectra=spectra(shown) if shown.labels.spectra else "",
        flat="" if shown.deflection.known else "The mode file has no shapes: drawn flat.",
        animation=json.dumps(_animation(shown)),
        sounds=sounds,
        silent=silent,
        scene=recording.scene_toml,
        law=law,
        law_text=law_text,
        lawless=lawless,
        again=again,
        commands=commands,
        versions=_versions(recording),
    )


def _tables(found: RunAssessment, compare: bool) -> list[ResultTable]:
    """Noise metrics of the first impact and all impacts as `run` prints them, those without
    control, too; none where a run has no impact."""
    runs = [found.result.metrics, *([found.free] if found.free else [])]
    if not all(run.noise for run in runs):
        return []
    known = found.assessment.predictability
    digits = [known.controlled, known.uncontrolled][: len(runs)]
    names = ["with control", "without"] if found.free else ["this run"]
    compare = compare and found.free is not None
    rows = noise_rows(
        [run.noise[0] for run in runs],
        compare,
        [errors_of(each, 0, "noise_errors") for each in digits],
    )
    columns = ["metric of the first impact", *names, *(["change"] if compare else [])]
    tables = [ResultTable("", columns, rows)]
    for name, run, each in zip(names, runs, digits, strict=True):
        why_not = why_not_words(known.not_repeatable) if run is runs[0] else ""
        rows, notes = impact_rows(run.impacts, each, why_not)
        numbered = [[str(i), *row] for i, row in enumerate(rows, 1)]
        headings = [f"impacts, {name}", *impact_headings(run.impacts)]
        tables.append(ResultTable("", headings, numbered, "; ".join(notes)))
    return tables


def _law(recording: Recording) -> tuple[str, str, str]:
    result = law_line(law_of(recording))
    try:
        return result, text_of_law(recording), ""
    except RecordingError as error:
        return result, "", str(error)


def _margin(recording: Recording, setup: Setup) -> tuple[list[str], str]:
    """What linear theory says about the loop, in sentences, and its picture as base64 of a PNG.

    Empty without a linear loop, and for laws that are not shipped: a report runs no user's code.
    """
    if law_of(recording).law not in shipped_laws() or not law_of(recording).as_announced:
        return [], ""
    try:
        constant = at_shortest_latency(setup)
        found = margin_of(constant)
        if not found.applicable:
            return [], ""
        lines = margin_lines(found) + jitter_lines(jitter_margin_of(setup, found))
        at_hz = found.binding_frequency_hz
        if at_hz is not None:
            lines.append(mode_line(binding_mode(constant, at_hz), at_hz))
        png = io.BytesIO()
        draw(constant, found).savefig(png, format="png", dpi=90)
    except SceneError as error:
        return [f"No margin: {error}"], ""
    return lines, base64.b64encode(png.getvalue()).decode()


def _animation(shown: ReplayData) -> dict[str, Any]:
    """Deflections around the first contact in 127 levels each way, and what a canvas needs."""
    plate: Deflection = shown.deflection
    low, high = shown.when.selection_ns
    inside = np.flatnonzero((plate.times_ns >= low) & (plate.times_ns <= high))
    if len(inside) < 2:
        inside = np.arange(len(plate.times_ns))
    inside = inside[np.unique(np.linspace(0, len(inside) - 1, _FRAMES).astype(int))]
    full = shown.drawn.full_colour_m
    levels = np.clip(np.round(np.nan_to_num(plate.w_m[inside]) / full * _LEVELS), -127, 127)
    # Rows of a picture go down, y goes up.
    frames = np.ascontiguousarray(levels.astype(np.int8).transpose(0, 2, 1)[:, ::-1])
    gap_m, force_n = (shown.at_frames[name][inside] for name in ("xi_m", "f_a_n"))
    corner, size = plate.low_m, plate.size_m

    def place(point: tuple[float, float]) -> list[float]:
        return [(point[0] - corner[0]) / size[0], 1.0 - (point[1] - corner[1]) / size[1]]

    actuator = shown.labels.actuator_m
    return {
        "frames": base64.b64encode(frames.tobytes()).decode(),
        "count": len(inside),
        "nx": len(plate.x_m),
        "ny": len(plate.y_m),
        "x": ((plate.x_m - corner[0]) / size[0]).tolist(),
        "y": (1.0 - (plate.y_m[::-1] - corner[1]) / size[1]).tolist(),
        "aspect": size[1] / size[0],
        "size": [f"{1e3 * side:g} mm" for side in size],
        "times": [f"{1e-6 * t:z.4f} ms" for t in plate.times_ns[inside].tolist()],
        "touching": (gap_m < 0.0).tolist(),
        "force": [with_unit(float(f), "N") for f in np.nan_to_num(force_n)],
        "contact": place(plate.contact_point_m),
        "actuator": place(actuator) if actuator else None,
        "full": "" if shown.drawn.flat else with_unit(full, "m"),
    }


def _sounds(recording: Recording, setup: Setup) -> tuple[list[dict[str, str]], str]:
    """Sounds at 1 m, their data as base64 of a WAV file, or why there are none."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        try:
            heard = write_sounds(recording, setup, Path(folder), (0.0, 0.0, 1.0), 1.0, 0.3)
        except SceneError as error:
            return [], str(error)
        return [
            {
                "label": name.replace("-", " "),
                "level": f"{run['level_db']:z.1f} dB sound exposure level",
                "data": base64.b64encode(Path(run["file"]).read_bytes()).decode(),
            }
            for name, run in heard["runs"].items()
        ], ""


def _again(recording: Recording, setup: Setup, has_text: bool) -> tuple[str, list[str]]:
    """How to come to the same samples, in words and as commands."""
    file, result = shlex.quote(recording.path.name), law_of(recording)
    (name, changed), saved = provenance.closest_shipped(setup), "# the scene below, saved"
    again = shlex.quote(f"{recording.path.stem}-again.mcap")
    if not result.as_announced:
        own = result.law or "not named by the controller"
        return (
            f"The forces came from a controller outside hertzloop with the law {own}. Start that "
            "controller and these two processes in three terminals, in any order.",
            [
                f"hertzloop node recorder --out {again}",
                f"hertzloop node plant {setup.name}.toml    {saved}",
                f"hertzloop compare {again} {file}    # afterwards",
            ],
        )
    if "held_steps" in recording.truth.arrays:
        return (
            "Some forces arrived late in this run. The repetition applies them with the same "
            "delay.",
            [f"hertzloop run --repeat {file} --out {again}", f"hertzloop compare {again} {file}"],
        )
    same = "The same scene, seed and processor give the same bytes."
    if name == setup.name and not changed:
        return same, [f"hertzloop run {name} --seed {setup.seed}"]
    run, first = f"hertzloop run {setup.name}.toml", []
    if result.law not in shipped_laws() and has_text:
        law = str(result.law).partition(":")
        first = [f"hertzloop inspect {file} --law {shlex.quote(law[0])}"]
        run += f" --set {shlex.quote('controller.law=' + ''.join(law))}"
    return same, [*first, f"{run} --out {again}    {saved}", f"hertzloop compare {again} {file}"]


def _versions(recording: Recording) -> list[tuple[str, str]]:
    try:
        found = json.loads(recording.metadata.get("versions", "{}"))
    except json.JSONDecodeError:
        return []
    return [(str(name), str(number)) for name, number in dict(found).items()]
