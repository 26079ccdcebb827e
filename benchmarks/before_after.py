"""The default scheme of two versions in one picture: order, speed against accuracy, stability.

`benchmarks.speed_accuracy` and `benchmarks.stability` draw them, with --before FOLDER.
"""

import csv
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.stability_pictures import NAMES
from hertzloop.studies.pages import pictures

_FLOOR = 1e-17  # below any residual but an exact zero
BeforeOption = Annotated[
    Path | None,
    typer.Option(
        "--before",
        help="Draw the default scheme beside that of another version, whose results of this "
        "program are in this folder.",
        show_default=False,
    ),
]


def _rows(path: Path) -> list[dict[str, Any]]:
    """The rows of the default scheme in a CSV file."""
    with path.open(encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["scheme"] == "modal"]


def draw_impacts(path: Path, before: Path, after: Path) -> None:
    """Error of the gap in the first contact against the step, and against CPU time."""
    found = {"before": before, "after": after}
    points = {name: _rows(folder / "speed_accuracy.csv") for name, folder in found.items()}
    scenes = list(dict.fromkeys(row["scene"] for row in points["after"]))
    picture, axes = pictures.sheet(2, len(scenes), 4.6 * len(scenes), 7.6)
    for (by_step, by_time), scene in zip(axes.T, scenes, strict=True):
        for i, (name, rows) in enumerate(points.items()):
            mine = [row for row in rows if row["scene"] == scene]
            steps = [float(row["setting"].split()[0]) for row in mine]
            times = [float(row["cpu_s_per_ms"]) for row in mine]
            errors = [float(row["error"]) for row in mine]
            by_step.loglog(steps, errors, label=name, **pictures.look(i, True))
            by_time.loglog(times, errors, label=name, **pictures.look(i, True))
        order = [errors[0] * (step / steps[0]) ** 4 for step in steps]
        by_step.loglog(steps, order, color="gray", linewidth=0.8, label="order 4")
        by_step.set(title=scene, xlabel="step (us)")
        by_time.set(xlabel="CPU time (s per simulated ms)")
        for axis in (by_step, by_time):
            axis.set(ylabel="error of the gap", ylim=(1e-12, 1.0))
            axis.xaxis.set_minor_formatter("")  # the numbers overlap
            axis.legend()
    pictures.save(picture, path)


def draw_stability(path: Path, before: Path, after: Path) -> None:
    """Worst energy residual, and most evaluations of a contact solve, against the step."""
    picture, axes = pictures.sheet(1, 2, 11.0, 4.2)
    for i, (name, folder) in enumerate({"before": before, "after": after}.items()):
        for j, (which, words) in enumerate(NAMES.items()):
            rows = _rows(folder / f"stability-{which}.csv")
            steps = list(dict.fromkeys(float(row["step"]) for row in rows))
            by_step = [[row for row in rows if float(row["step"]) == step] for step in steps]
            style = pictures.look(2 * j + i, True)
            worst = [max(abs(float(row["change"])) for row in some) for some in by_step]
            shown = [max(value, _FLOOR) for value in worst]
            axes[0, 0].loglog(steps, shown, label=f"{name}: {words}", **style)
            most = [max(int(row["evaluations"]) for row in some) for some in by_step]
            axes[0, 1].loglog(steps, most, label=f"{name}: {words}", **style)
    for axis, what in zip(axes[0], ("energy residual", "evaluations of a solve"), strict=True):
        axis.set(title=f"Worst {what} of each map", xlabel="step / contact time", ylabel=what)
    axes[0, 0].legend(fontsize=7, ncols=2)
    pictures.save(picture, path)
