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

from benchmarks import scenes
from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.schemes.discrete_gradient import known_to_scenes
from hertzloop.cli.terminal import fail, out
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.impacts import first_impact
from hertzloop.scene.loading import DEFAULT, shipped
from hertzloop.scene.setup import Setup, load
from hertzloop.views import replaying

NOTES = "pictures.json"
DOCS = Path(__file__).resolve().parent.parent / "docs"
WITHIN = 1e-6  # relative: processors differ in the last bits, changes of a model do not


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


_PACED = ("controller.law=velocity_feedback", "controller.kappa=0.1", "run.duration_s=0.003")
MORE = {"paced": Run("aluminium-3mm", _PACED, 0.003)}


def note_of(note: dict[str, Any]) -> dict[str, Any]:
    """What a noted picture shows today: metrics of the first impact of its cases, words of its
    replay."""
    replayed = note["replayed"]
    metrics = {case: dict(_metrics(case)) for case in note["metrics"]}
    return note | {"metrics": metrics, "words": _words(replayed) if replayed else []}


def _load(case: str) -> Setup:
    """The setup of a case, such as "aluminium-3mm sensors.bits=6"."""
    scene, *settings = case.split()
    return load(scene, settings)


@lru_cache
def _metrics(case: str) -> dict[str, float]:
    """Of the first impact, in the elastic copy of a shipped scene as in the programs that draw the
    picture; nothing without one."""
    with known_to_scenes():
        name, *settings = case.split()
        setup = scenes.load(name, settings)
        impact = first_impact(setup, simulate(setup).truth)
    if impact is None:
        return {}
    names = ("duration_s", "rebound_speed_m_s", "peak_force_n", "plate_energy_j")
    return {name: getattr(impact.impact, name) for name in names}


def _words(case: str) -> list[str]:
    """What a replay of a run writes, and the numbers in it, to the digits that can be read."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file = Path(folder) / f"{case.split()[0]}.mcap"
        record_in_process(_load(case), file, compiled=True)
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
    if noted["words"] != now["words"]:
        found.append(f"words was {noted['words']}, is {now['words']}")
    return found


def read_notes() -> dict[str, Any]:
    """The notes beside the pictures of the documentation, by the name of the picture.

    A note holds the `command` that draws it, the file that this `writes`, the case whose replay
    it is (`replayed`), and `metrics` of the cases that it draws, or of such as it draws.
    """
    return dict(json.loads((DOCS / NOTES).read_text(encoding="utf-8")))


def _draw(picture: Path, run: Run) -> None:
    """The replay of a run over the same without control."""
    with TemporaryDirectory(prefix="hertzloop-") as temporary:
        file = Path(temporary) / f"{run.scene}.mcap"
        try:
            run.record(file)
            replaying.replay(read(file), None, picture, None)
        except (RuntimeError, RecordingError) as error:
            fail(str(error), 1)


def _documented(folder: Path, only: list[str] | None, note: bool) -> None:
    """Draw the pictures of the documentation again, hours for all, and note what they show."""
    notes = read_notes()
    names = only or list(notes)
    for name in tracked("pictures", names):
        if not note:
            _draw_by_command(folder / name, notes[name])
        notes[name] = note_of(notes[name]) | {"drawn_with_note": not note}
        text = json.dumps(dict(sorted(notes.items())), indent=1, allow_nan=False)
        (folder / NOTES).write_text(text + "\n", encoding="utf-8")
        out.say(f"{'noted' if note else 'written'}: {folder / name}")
    out.say(f"{len(names)} pictures are {'noted' if note else 'drawn and noted'}.")


def _draw_by_command(picture: Path, note: dict[str, Any]) -> None:
    command = note["command"]
    with TemporaryDirectory(prefix="hertzloop-") as temporary:
        words = command.removeprefix("python -m ").replace("DIR", temporary).split()
        done = subprocess.run([sys.executable, "-m", *words], check=False)
        if done.returncode:
            fail(f"'{command}' ended with code {done.returncode}", 1)
        shutil.copyfile(Path(temporary) / note["writes"], picture)


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

    Also draws a paced run. Needs no screen. With --quick:
    the default scene only.

    Example: python -m benchmarks.pictures --only aluminium-20mm -o pictures
    """
    wanted = {name: Run(name) for name in shipped()} | MORE
    known = list(read_notes()) if documented else [*wanted]
    if unknown := [name for name in only or [] if name not in known]:
        fail(f"--only = {unknown[0]}: unknown picture. Choose one of {', '.join(known)}", 2)
    names = only or ([DEFAULT] if quick and not documented else list(wanted))
    with results_in(folder, "pictures") as results:
        if documented:
            _documented(results.folder, only, note)
            return
        rows = []
        for name in tracked("pictures", names):
            began = time.perf_counter()
            _draw(results.path(f"replay-{name}.png"), wanted[name])
            rows.append((name, time.perf_counter() - began))
        results.write_rows("pictures", ("name", "seconds"), rows)
        longest = max(seconds for _, seconds in rows)
        results.conclude(f"A picture takes {longest:.0f} s at most (pictures: {len(rows)}).")


if __name__ == "__main__":
    start("benchmarks.pictures")
