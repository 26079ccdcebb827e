"""Studies of one recording: another law on its samples, and response times of a paced run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.recordings.recording import Recording
from hertzloop.results.recorded import SHARES, Pacing, Responses
from hertzloop.results.rounding import time_words
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup, parse
from hertzloop.studies.pages import pictures, words

_AROUND_STEPS = 100  # shown before and after the first difference


@dataclass(frozen=True)
class ForceComparison:
    """Forces (N) of every step that both know, and the first step at which they differ."""

    recorded_n: np.ndarray
    other_n: np.ndarray
    first: int | None
    step_s: float


def scene_with(recording: Recording, law: str, settings: dict[str, object]) -> Setup:
    """The recorded scene with another law, and other keys. Raises SceneError."""
    setup = parse(recording.scene_toml, recorded=True)
    fixed = {"sensors.quantity": setup.quantity}
    return setup.vary({"controller.law": law, **fixed, **settings})


def law_on(recording: Recording, setup: Setup) -> ForceComparison:
    """Feed the recorded samples to the scene's law and line. Raises SceneError, LawFault."""
    controller = build_controller(setup)
    other = controller.process(recording.daq_values).forces
    recorded = recording.force.arrays.get("force_n", np.empty(0))
    count = min(len(other), len(recorded))
    other, recorded = other[:count].copy(), recorded[:count]
    differing = np.flatnonzero(other.view(np.int64) != recorded.view(np.int64))
    first = int(differing[0]) if len(differing) else None
    return ForceComparison(recorded, other, first, setup.step_s)


def draw(found: ForceComparison, names: tuple[str, str], path: Path) -> Path:
    """Both forces over the whole run, and around the first difference."""
    at = found.first if found.first is not None else int(np.argmax(np.abs(found.recorded_n)))
    near = slice(max(at - _AROUND_STEPS, 0), at + _AROUND_STEPS)
    metric, axes = pictures.sheet(2, 1)
    for axis, span, scale, unit in (
        (axes[0, 0], slice(None), 1e3, "ms"),
        (axes[1, 0], near, 1e6, "us"),
    ):
        time = scale * found.step_s * np.arange(len(found.recorded_n))[span]
        for i, force in enumerate((found.recorded_n, found.other_n)):
            axis.step(time, force[span], where="post", label=names[i], **pictures.look(i))
        axis.set(xlabel=f"time ({unit})", ylabel="force (N)")
        axis.legend()
    if found.first is not None:
        axes[1, 0].axvline(1e6 * found.step_s * at, color="0.5", linewidth=0.8)
        axes[1, 0].set_title(f"around the first difference, step {at}")
    return pictures.save(metric, path)


_A_BAR = 4  # classes


def draw_response(path: Path, responses: Responses, found: Pacing) -> None:
    """Answers by response time, and the share that took longer; the run has a `clock`."""
    clock = found.clock
    assert clock is not None
    sheet, axes = pictures.sheet(1, 2, width=10.0, height=3.6)
    ends, answers = responses.ends_us, responses.answers
    there = np.flatnonzero(answers)
    shown = slice(int(there[0]), int(there[-1]) + 1)
    left, right = axes[0]
    # Bars of four classes; those of single ones are too thin to be told apart.
    bars = np.add.reduceat(answers, np.arange(0, len(answers), _A_BAR))
    tops = np.append(ends[_A_BAR - 1 :: _A_BAR], ends[-1])[: len(bars)]
    feet = np.concatenate([[ends[0] / 2.0], tops[:-1]])
    left.bar(feet, bars, tops - feet, align="edge", color=pictures.COLOURS[0])
    left.set_xlim(ends[shown][0] / 1.5, ends[shown][-1] * 1.5)
    left.set_yscale("log")
    left.set_ylabel("answers")
    longer = 1.0 - np.cumsum(answers) / np.sum(answers)
    right.step(ends[shown], longer[shown], where="post", color=pictures.COLOURS[0])
    right.set_yscale("log")
    right.set_ylim(0.5 / np.sum(answers), 1.0)
    right.set_ylabel("share that took longer")
    for name, share in SHARES.items():
        at = responses.within_us(share)
        right.plot(at, 1.0 - share, "o", color=pictures.COLOURS[1])
        right.annotate(
            f"{name} {time_words(at)}",
            (at, 1.0 - share),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    for ax in (left, right):
        ax.axvline(
            clock.slack_us,
            color="black",
            linestyle="--",
            linewidth=0.8,
            label=f"{time_words(clock.slack_us)} that the pace leaves",
        )
        ax.set_xscale("log")
        ax.set_xlabel("from a sample to its answer (us)")
        ax.legend()
    sheet.suptitle(f"Pace {clock.pace:g}: {found.late_forces:,} of {found.steps:,} forces late")
    pictures.save(sheet, path)


def write_table(path: Path, responses: Responses) -> None:
    """The classes that are not empty, as CSV."""
    rows = [
        (f"{responses.ends_us[at]:.6g}", f"{responses.answers[at]:z.0f}")
        for at in np.flatnonzero(responses.answers)
    ]
    words.write_rows(path, ("response_us_below", "answers"), rows)
