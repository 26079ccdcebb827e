"""Pictures of where integrators and the closed loop blow up or lose their energy."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.stability_limits import LIMITS, TEXTBOOK
from benchmarks.stability_maps import Outcome
from hertzloop.studies.pages import pictures

BALANCED = ("modal", "discrete_gradient")
NAMES = {
    "stiffness": "stiffness",
    "mass": "sphere mass",
    "shaken": "plate speed",
    "loss": "loss factor",
}
_FLOOR = 1e-17  # below any residual but an exact zero


def draw_limits(
    path: Path,
    free: list[tuple[str, float, float]],
    contact: list[Outcome],
    thesis: list[tuple[float, float, float, float]],
) -> None:
    """Where the textbook integrators blow up, and the energy that they lose in a contact."""
    picture, axes = pictures.sheet(1, 2, width=11.0, height=4.2)
    _free(axes[0, 0], free)
    _contact(axes[0, 1], contact, thesis)
    pictures.save(picture, path)


def _free(axis: Any, free: list[tuple[str, float, float]]) -> None:
    for i, scheme in enumerate(TEXTBOOK):
        mine = [(x, g) for name, x, g in free if name == scheme and g < 3.0]
        axis.plot(*zip(*mine, strict=True), label=scheme, **pictures.look(i))
    for limit in LIMITS.values():
        axis.axvline(limit, color="gray", linewidth=0.8)
        axis.text(limit + 0.03, 0.62, f"{limit:.3g}", color="dimgray")
    axis.axhline(1.0, color="black", linewidth=0.8, label="modal, discrete_gradient: exact")
    axis.set(title="Free vibration", xlabel="w h", ylabel="growth per step", ylim=(0.6, 2.0))
    axis.legend(loc="upper left")


def _contact(
    axis: Any, contact: list[Outcome], thesis: list[tuple[float, float, float, float]]
) -> None:
    for i, scheme in enumerate([*TEXTBOOK, "discrete_gradient", "modal"]):
        mine = [
            (one.step, max(abs(one.change), _FLOOR))
            for one in contact
            if one.scheme == scheme and abs(one.change) < 1e3
        ]
        axis.loglog(*zip(*mine, strict=True), label=scheme, **pictures.look(i, True))
    steps, _, energy, momentum = zip(*thesis, strict=True)
    axis.loglog(steps, energy, label="thesis2008", **pictures.look(4, True))
    axis.loglog(steps, momentum, label="thesis2008: momentum", **pictures.look(5, True))
    axis.set(
        title="One contact: energy lost or gained",
        xlabel="step / contact time",
        ylabel="relative",
        ylim=(1e-17, 1e4),
    )
    axis.legend(fontsize=7, ncols=2, loc=(0.22, 0.32))


def draw_energy(path: Path, outcomes: dict[str, list[Outcome]]) -> None:
    """Energy residual and solves of the energy-keeping schemes."""
    picture, axes = pictures.sheet(1, 2, width=11.0, height=4.2)
    for j, scheme in enumerate(BALANCED):
        for i, (name, found) in enumerate(outcomes.items()):
            mine = [one for one in found if one.scheme == scheme]
            steps = list(dict.fromkeys(one.step for one in mine))
            style = pictures.look(2 * i + j, True)
            label = f"{scheme}: {NAMES[name]}"
            worst = [max(abs(one.change) for one in mine if one.step == step) for step in steps]
            axes[0, 0].loglog(steps, np.maximum(worst, _FLOOR), label=label, **style)
            most = [max(one.evaluations for one in mine if one.step == step) for step in steps]
            axes[0, 1].loglog(steps, most, label=label, **style)
    axes[0, 0].set(
        title="Energy residual, worst of each map",
        xlabel="step / contact time",
        ylabel="relative",
        ylim=(1e-16, 1e-6),
    )
    axes[0, 0].legend(fontsize=7, ncols=2, loc="upper left")
    axes[0, 1].set(
        title="Most evaluations of a contact solve",
        xlabel="step / contact time",
        ylabel="evaluations",
    )
    pictures.save(picture, path)
