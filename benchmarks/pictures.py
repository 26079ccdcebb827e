"""The pictures of the documentation: what makes each, and what it shows in a few numbers.

The numbers are kept beside the pictures, in pictures.json. A picture is stale when they change: the
same runs give other metrics today, or a replay says other words. That is cheap to see, and neither
a comment in the code nor the last bits of a processor make a difference.
"""

import json
import math
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    conclude,
    fail,
    out,
    results_in,
    start,
    tracked,
    written,
)
from benchmarks.schemes.discrete_gradient import known_to_scenes
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.impacts import first_impact
from hertzloop.scene.loading import DEFAULT, shipped
from hertzloop.scene.setup import load
from hertzloop.studies.report.page import page_of
from hertzloop.studies.words import write_rows
from hertzloop.views import replaying

NOTES = "pictures.json"
WITHIN = 1e-6  # relative: processors differ in the last bits, changes of a model do not
_SHORT_3MM = "run.duration_s=0.0016"
_SHORT_20MM = "run.duration_s=0.009"

Case = tuple[str, tuple[str, ...]]  # scene and what is changed


@dataclass(frozen=True)
class Run:
    """A scene, what of it is changed, and the pace if it has one."""

    scene: str
    changed: tuple[str, ...] = ()
    pace: float | None = None

    def record(self, file: Path) -> None:
        """Record it: in one compiled call, a paced one as processes. Raises RuntimeError."""
        if self.pace is None:
            record_in_process(load(self.scene, self.changed), file, compiled=True)
            return
        settings = [word for key in self.changed for word in ("--set", key)]
        command = [sys.executable, "-m", "hertzloop", "run", self.scene, *settings]
        command += ["--pace", str(self.pace), "--out", str(file)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the paced run failed: {done.stderr.strip()}")


_SHORT_14MS = "run.duration_s=0.014"
_OTHER = ("controller.law=shifted_threshold", "controller.kappa=0.9", "controller.v_thr_m_s=-0.9")
_FEEDBACK = "controller.law=velocity_feedback"
MORE = {
    "comparison": [
        Run("aluminium-20mm", (_SHORT_14MS,)), Run("aluminium-20mm", (_SHORT_14MS, *_OTHER))
    ],
    "unstable": [
        Run("aluminium-20mm", (_FEEDBACK, "controller.kappa=0.4", "run.duration_s=0.013"))
    ],
    "paced": [
        Run("aluminium-3mm", (_FEEDBACK, "controller.kappa=0.1", "run.duration_s=0.003"), 0.003)
    ],
}  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """`command` writes the picture as `writes` into DIR; `cases`: runs that it draws, or such as it
    draws; `replayed`: the case whose replay or report it is."""

    command: str
    writes: str
    cases: tuple[Case, ...] = ()
    replayed: Case | None = None


def _laws(scene: str, short: str, *changes: tuple[str, ...]) -> tuple[Case, ...]:
    return tuple((scene, (short, *change)) for change in changes)


_KAPPAS = _laws(
    "aluminium-20mm", _SHORT_20MM, (), ("controller.kappa=0.4",), ("sensors.bits=6",),
    ("controller.latency_us=30",), ("controller.law=shifted_threshold",),
)  # fmt: skip
_SCHEMES = _laws(
    "aluminium-3mm", _SHORT_3MM, (), ("run.step_ns=250",),
    ("run.scheme=discrete_gradient", "controller.law=off"),
)  # fmt: skip
_PUBLISHED = tuple(
    (name, ("run.duration_s=0.02",)) for name in ("thesis-aluminium", "thesis-oak")
) + _laws("aluminium-20mm", _SHORT_20MM, ("controller.law=off",))
_PLANTS = tuple((name, (_SHORT_20MM, "controller.law=off")) for name in (
    "aluminium-3mm", "aluminium-20mm", "oak-20mm", "offcentre-6mm"
))  # fmt: skip
_DEFAULT: Case = (DEFAULT, ())
[_PACED] = MORE["paced"]
_TUNED = ("controller.law=shifted_threshold", "controller.kappa=0.99", "controller.v_thr_m_s=-0.99")
_LATENCY = "python -m benchmarks.latency -o DIR"
_TUNE = (
    "hertzloop tune aluminium-20mm --law slope_threshold --law shifted_threshold --law predicted "
    "--law force_feedback --span run --set run.duration_s=0.014 -o DIR"
)

_MARGIN = "hertzloop margin oak-20mm --law velocity_feedback --set controller.kappa=0.4 -o DIR"
# The filter of docs/tutorials/design-a-filter.md: a Butterworth low-pass of order 1 at 5 kHz.
_ROW = "[-2.3199437104655045,-2.3199437104655045,-0.0,1.0,-0.9690674171937933,0.0]"
_FILTER = (
    "controller.law=linear", f"controller.sections=[{_ROW}]", "controller.latency_us=20",
)  # fmt: skip

PICTURES = {
    "replay.png": Drawn(
        f"python -m benchmarks.pictures --only {DEFAULT} -o DIR", f"replay-{DEFAULT}.png",
        replayed=_DEFAULT,
    ),
    "replay-paced.png": Drawn(
        "python -m benchmarks.pictures --only paced -o DIR", "replay-paced.png",
        replayed=(_PACED.scene, _PACED.changed),
    ),
    "report.png": Drawn(
        "python -m benchmarks.pictures --only report -o DIR", "report.png",
        replayed=("aluminium-3mm", ()),
    ),
    "tune.png": Drawn(
        _TUNE, "tune-aluminium-20mm.png", (*_KAPPAS, ("aluminium-20mm", (_SHORT_20MM, *_TUNED)))
    ),
    "margin.png": Drawn(
        _MARGIN, "margin.png",
        (("oak-20mm", ("controller.law=velocity_feedback", "controller.kappa=0.4")),),
    ),
    "margin-filter.png": Drawn(
        f"hertzloop margin oak-20mm --set {' --set '.join(_FILTER)} -o DIR", "margin.png",
        (("oak-20mm", _FILTER),),
    ),
    "latency.png": Drawn(_LATENCY, "latency-aluminium-3mm.png", _KAPPAS),
    "latency-chance.png": Drawn(_LATENCY, "latency-chance.png", _KAPPAS),
    "real.png": Drawn("python -m benchmarks.real_plant -o DIR", "real.png", _KAPPAS),
    "model_order.png": Drawn("python -m benchmarks.model_order -o DIR", "model_order.png", _PLANTS),
    "validity.png": Drawn("python -m benchmarks.validity_map -o DIR", "validity.png", _PLANTS),
    "speed_accuracy.png": Drawn(
        "python -m benchmarks.speed_accuracy -o DIR", "speed_accuracy.png", _SCHEMES
    ),
    "stability.png": Drawn("python -m benchmarks.stability -o DIR", "stability.png", _SCHEMES),
    "stability-energy.png": Drawn(
        "python -m benchmarks.stability -o DIR", "stability-energy.png", (*_SCHEMES, *_KAPPAS)
    ),
    "weaknesses.png": Drawn("python -m paper.weaknesses -o DIR", "weaknesses.png", _PUBLISHED),
    "bounces.png": Drawn("python -m paper.figures -o DIR", "bounces.png", _PUBLISHED),
}  # fmt: skip


def note_of(picture: Drawn) -> dict[str, Any]:
    """What a picture shows: metrics of the first impact of its cases, words of its replay."""
    return {
        "command": picture.command,
        "metrics": {_name(case): dict(_metrics(case)) for case in picture.cases},
        "words": [] if picture.replayed is None else _words(picture.replayed),
    }


def _name(case: Case) -> str:
    return " ".join([case[0], *case[1]])


@lru_cache
def _metrics(case: Case) -> dict[str, float]:
    """Of the first impact; nothing without one."""
    with known_to_scenes():
        scene = load(*case)
        impact = first_impact(scene, simulate(scene).truth)
    if impact is None:
        return {}
    found = impact.impact
    return {
        "duration_s": found.duration_s,
        "rebound_speed_m_s": found.rebound_speed_m_s,
        "peak_force_n": found.peak_force_n,
        "plate_energy_j": found.plate_energy_j,
    }


def _words(case: Case) -> list[str]:
    """What a replay of a run writes, and the numbers in it, to the digits that can be read."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file = Path(folder) / f"{case[0]}.mcap"
        record_in_process(load(*case), file, compiled=True)
        return words_of(replaying.prepare(read(file)))


def words_of(shown: ReplayData) -> list[str]:
    """What is written in a replay: what ran, titles, legends, the first contact."""
    said = [shown.labels.heading, *shown.labels.lines, f"heights {shown.drawn.in_words}"]
    for plot in shown.plots:
        said.append(f"{plot.title}: {', '.join(c.label or c.name for c in plot.curves)}")
    for contact in shown.contacts[:3]:
        length = contact.end - contact.first
        said.append(f"{length} steps, {contact.peak_n:.3g} N, {1e6 * contact.deepest_m:.3g} um")
    return [*said, *(spectrum.label for spectrum in shown.labels.spectra)]


def differences(noted: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """In what two notes differ, in sentences."""
    found = []
    for name, metrics in now["metrics"].items():
        before = noted["metrics"].get(name, {})
        for metric, value in metrics.items():
            if not math.isclose(before.get(metric, math.nan), value, rel_tol=WITHIN):
                found.append(f"{name}: {metric} was {before.get(metric)}, is {value}")
    for key in ("command", "words"):
        if noted[key] != now[key]:
            found.append(f"{key} was {noted[key]}, is {now[key]}")
    return found


def read_notes(folder: Path) -> dict[str, Any]:
    """The notes beside the pictures; empty where there are none yet."""
    path = folder / NOTES
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def write_note(folder: Path, name: str, drawn_again: bool) -> None:
    """Note what a picture shows today; whether it was drawn just now."""
    notes = read_notes(folder)
    notes[name] = note_of(PICTURES[name]) | {"drawn_with_note": drawn_again}
    ordered = {key: notes[key] for key in sorted(notes)}
    text = json.dumps(ordered, indent=1, allow_nan=False)
    (folder / NOTES).write_text(text + "\n", encoding="utf-8")


_REPORT = "report"
_BROWSERS = ("chromium", "chromium-browser", "chrome")


def main(
    folder: OutDirOption = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="Draw this picture only, by its name; repeat for more."),
    ] = None,
    documented: Annotated[
        bool,
        typer.Option("--docs", help="Draw the pictures of the documentation, each by its command."),
    ] = False,
    note: Annotated[
        bool, typer.Option("--note", help="With --docs: only note what the pictures show today.")
    ] = False,
    quick: QuickOption = False,
) -> None:
    """Draw the replay of every shipped scene over the same run without control.

    Also draws two laws compared, an unstable run and a paced one; with --only report the page of a
    run. Needs no screen. With --quick: the default scene only.

    Example: python -m benchmarks.pictures --only aluminium-20mm -o pictures
    """
    wanted = {name: [Run(name)] for name in shipped()} | MORE
    _check(only, list(PICTURES) if documented else [*wanted, _REPORT])
    names = only or ([DEFAULT] if quick and not documented else list(wanted))
    with results_in(folder, "pictures") as made:
        if documented:
            _documented(made, only, note)
            return
        rows = []
        for name in tracked("pictures", names):
            began = time.perf_counter()
            if name == _REPORT:
                picture = made / f"{_REPORT}.png"
                _photograph_report(picture)
            else:
                picture = made / f"replay-{name}.png"
                _draw(picture, wanted[name])
            rows.append((name, picture.name, f"{time.perf_counter() - began:.2f}"))
        write_rows(made / "pictures.csv", ["name", "file", "seconds"], rows)
    written(made, *(row[1] for row in rows), "pictures.csv")
    longest = max(float(row[2]) for row in rows)
    conclude(f"A picture takes {longest:.0f} s at most (number of pictures: {len(rows)}).")


def _check(only: list[str] | None, known: list[str]) -> None:
    unknown = [name for name in only or [] if name not in known]
    if unknown:
        fail(f"--only = {unknown[0]}: unknown picture. Choose one of {', '.join(known)}", 2)


def _draw(picture: Path, runs: list[Run]) -> None:
    """The replay of one run, over a second one if there is one."""
    with TemporaryDirectory(prefix="hertzloop-") as temporary:
        files = []
        for i, run in enumerate(runs):
            files.append(Path(temporary) / f"{run.scene}{'-other' * i}.mcap")
            try:
                run.record(files[-1])
            except RuntimeError as error:
                fail(str(error), 1)
        try:
            first, *others = (read(file) for file in files)
            replaying.replay(first, None, picture, others[0] if others else None)
        except RecordingError as error:
            fail(str(error), 1)


def _documented(folder: Path, only: list[str] | None, note: bool) -> None:
    """Draw the pictures of the documentation again, hours for all, and note what they show."""
    names = only or list(PICTURES)
    for name in tracked("pictures", names):
        picture = PICTURES[name]
        if not note:
            with TemporaryDirectory(prefix="hertzloop-") as temporary:
                words = picture.command.removeprefix("python -m ").replace("DIR", temporary)
                done = subprocess.run([sys.executable, "-m", *words.split()], check=False)
                if done.returncode:
                    fail(f"'{picture.command}' ended with code {done.returncode}", 1)
                shutil.copyfile(Path(temporary) / picture.writes, folder / name)
        write_note(folder, name, drawn_again=not note)
        out.print(f"{'noted' if note else 'written'}: {folder / name}", soft_wrap=True)
    conclude(f"{len(names)} pictures are {'noted' if note else 'drawn and noted'}.")


def _photograph_report(picture: Path) -> None:
    """The top of the page of the scene `aluminium-3mm`, by Chromium."""
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        fail(f"the picture of the page needs a browser: {', '.join(_BROWSERS)}", 1)
    with TemporaryDirectory(prefix="hertzloop-") as temporary:
        file, page = Path(temporary) / "aluminium-3mm.mcap", Path(temporary) / "page.html"
        Run("aluminium-3mm").record(file)
        page.write_text(page_of(read(file)), encoding="utf-8")
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        command += [f"--user-data-dir={temporary}/profile", "--window-size=1100,2500"]
        command += ["--virtual-time-budget=1500", f"--screenshot={picture}", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not picture.exists():
        fail(f"{browser} took no picture: {done.stderr.strip()[-200:]}", 1)


if __name__ == "__main__":
    start("benchmarks.pictures")
