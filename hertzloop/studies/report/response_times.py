"""Response times of a paced run, as a chart and as a table."""

from pathlib import Path

import numpy as np

from hertzloop.results.recorded import SHARES, Pacing, Responses
from hertzloop.results.rounding import time_words
from hertzloop.studies.pages import pictures, words

_CLASSES_A_BAR = 4  # bars of single classes are too thin to be told apart


def draw_response(path: Path, responses: Responses, found: Pacing) -> None:
    """Draw answers by response time, and the share that took longer. The run has a `clock`.

    Raises:
        NotWritten: the file cannot be written.
    """
    clock = found.clock
    assert clock is not None
    sheet, axes = pictures.sheet(1, 2, width=10.0, height=3.6)
    ends, answers = responses.ends_us, responses.answers
    there = np.flatnonzero(answers)
    shown = slice(int(there[0]), int(there[-1]) + 1)
    left, right = axes[0]
    bars = np.add.reduceat(answers, np.arange(0, len(answers), _CLASSES_A_BAR))
    tops = np.append(ends[_CLASSES_A_BAR - 1 :: _CLASSES_A_BAR], ends[-1])[: len(bars)]
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
    """Write the classes that are not empty, as CSV. Raises NotWritten."""
    rows = [
        (f"{responses.ends_us[at]:.6g}", f"{responses.answers[at]:z.0f}")
        for at in np.flatnonzero(responses.answers)
    ]
    words.write_rows(path, ("response_us_below", "answers"), rows)
