"""Picture of where the published numerics fail."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from plant.schemes.registry import SCHEMES
from studies import pictures


def _bars(axes: Any, labels: list[str], values: list[float], published: list[bool]) -> None:
    for i, (value, is_published) in enumerate(zip(values, published, strict=True)):
        axes.barh(
            i, value, color=pictures.COLOURS[1 if is_published else 0],
            hatch="//" if is_published else "", edgecolor="black", linewidth=0.5,
        )  # fmt: skip
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)


_CALLED = {"modal": "consistent", "thesis2008": "published"}


def draw(path: Path, steps_us: tuple[float, ...], checks: dict[str, list[Any]]) -> None:
    """Draw the rows of all checks, by their names in `weaknesses.run`."""
    figure, axes = pictures.sheet(2, 2, width=13.0, height=4.6)
    rows = checks["momentum"]
    ratios = [row.ratio for row in rows]
    _bars(
        axes[0, 0], [r.scene for r in rows], ratios, [not SCHEMES[r.scheme].conserves for r in rows]
    )
    axes[0, 0].set(
        title="Does the contact force change the sphere's momentum?", xscale="log", xlim=(1e-5, 2),
        xlabel="contact impulse / momentum change (1 is right)",
    )  # fmt: skip
    for i, scheme in enumerate(("modal", "thesis2008")):
        mine = [row for row in checks["refinement"] if row.scheme == scheme]
        mine = [row for row in mine if row.rebound_error > 0.0]
        style = partial(pictures.look, i, True)
        axes[0, 1].loglog(
            [r.step_us for r in mine],
            [r.rebound_error for r in mine],
            label=_CALLED[scheme],
            **style(),
        )
    steps = np.array(steps_us)
    axes[0, 1].loglog(steps, 2e-5 * steps**2, color="gray", linestyle=":", label="order 2")
    axes[0, 1].set(
        title="Rebound speed as the step shrinks", xlabel="step (us)",
        ylabel="change against the finest step / impact speed",
    )  # fmt: skip
    axes[0, 1].set_xticks(steps, [f"{step:g}" for step in steps_us])
    axes[0, 1].minorticks_off()
    axes[0, 1].legend()
    found = checks["iterations"]
    labels = [
        f"{r.case}: {r.solve.replace('relaxation, ', 'relaxation ')}"
        + (f", {r.never} never end" if r.never else "")
        for r in found
    ]
    largest = [float(row.largest) for row in found]
    _bars(axes[1, 0], labels, largest, ["published" in row.solve for row in found])
    axes[1, 0].set(
        title="Work of one solve of the contact", xscale="log",
        xlabel="largest number of evaluations (100 000: cut there)",
    )  # fmt: skip
    axes[1, 0].tick_params(axis="y", labelsize=7)
    pulls = checks["adhesion"]
    shares = [100.0 * row.share for row in pulls]
    _bars(axes[1, 1], [row.scene for row in pulls], shares, [True] * len(pulls))
    axes[1, 1].set(
        title="Does the contact pull? (relaxation damping)",
        xlabel="most negative contact force (% of the largest)",
    )  # fmt: skip
    known = [
        Patch(facecolor=pictures.COLOURS[1], hatch="//", edgecolor="black", label="published"),
        Patch(facecolor=pictures.COLOURS[0], edgecolor="black", label="consistent"),
    ]
    figure.legend(handles=known, loc="outside upper center", ncols=2)
    pictures.save(figure, path)
