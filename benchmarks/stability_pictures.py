"""Pictures of where integrators and the closed loop blow up or lose their energy."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.stability_limits import DAMPED, LIMITS, TEXTBOOK
from benchmarks.stability_loop import LoopPoint
from benchmarks.stability_maps import BLOWN, WRONG, Map, Outcome, Predicted, border
from hertzloop.studies.pages import pictures

BALANCED = ("modal", "discrete_gradient")
_TITLES = {
    "stiffness": "Contact stiffness",
    "mass": "Sphere mass against plate impedance (marks as above)",
    "shaken": "Impact on a vibrating plate (marks as above)",
}
_NAMES = {
    "stiffness": "stiffness",
    "mass": "sphere mass",
    "shaken": "plate speed",
    "loss": "loss factor",
}
_FLOOR = 1e-17  # below any residual but an exact zero


def draw_limits(
    path: Path,
    free: list[tuple[str, float, float]],
    damped: list[tuple[str, float, float, float]],
    contact: list[Outcome],
    thesis: list[tuple[float, float, float, float]],
    by_map: dict[str, Map],
) -> None:
    """Where the textbook integrators blow up or are wrong, with the predicted limits."""
    metric, axes = pictures.sheet(3, 2, width=11.0, height=4.2)
    _free(axes[0, 0], free)
    _damped(axes[0, 1], damped)
    _contact(axes[1, 0], contact, thesis)
    for axis, name in zip((axes[1, 1], axes[2, 0], axes[2, 1]), _TITLES, strict=True):
        _borders(axis, name, *by_map[name])
    pictures.save(metric, path)


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


def _damped(axis: Any, damped: list[tuple[str, float, float, float]]) -> None:
    for i, scheme in zip((0, 4, 1), DAMPED, strict=True):
        mine = np.array([row[1:] for row in damped if row[0] == scheme])
        style = pictures.look(i, True)
        axis.plot(mine[:, 0], mine[:, 1], color=style["color"], linestyle=style["linestyle"])
        style |= {"linestyle": "none"}
        axis.plot(mine[:, 0], mine[:, 2], label=scheme, **style)
    axis.set(
        title="Free vibration with damping: lines predicted, marks measured",
        ylim=(1.0, 3.2),
        xlabel="loss factor",
        ylabel="largest stable w h",
    )
    axis.legend(loc="lower left")


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
    axis.loglog(steps, energy, label="thesis2008", **pictures.look(6, True))
    axis.loglog(steps, momentum, label="thesis2008: momentum", **pictures.look(7, True))
    axis.set(
        title="One contact: energy lost or gained",
        xlabel="step / contact time",
        ylabel="relative",
        ylim=(1e-17, 1e4),
    )
    axis.legend(fontsize=7, ncols=2, loc=(0.22, 0.32))


def _borders(axis: Any, name: str, predicted: list[Predicted], found: list[Outcome]) -> None:
    """Borders of the textbook integrators; on the stiffness map in terms of the contact's
    frequency, on the others of the rigid plate's contact time."""
    stiffness = name == "stiffness"
    x = [one.contact_over_highest_mode if stiffness else one.where for one in predicted]
    unit = np.array([one.contact_frequency_step if stiffness else 1.0 for one in predicted])
    for i, scheme in enumerate(TEXTBOOK):
        style = pictures.look(i, True)
        wrong = np.array([step for _, step in border(found, scheme, WRONG)])
        axis.plot(x, wrong * unit, label=f"{scheme}: 1 % wrong", **style)
        style |= {"linestyle": "none", "markerfacecolor": "none", "markersize": 8}
        doubled = np.array([step for _, step in border(found, scheme, BLOWN)])
        axis.plot(x, doubled * unit, label=f"{scheme}: doubled", **style)
    for scheme, line in zip(LIMITS, ("-", "--"), strict=True):
        limit = np.array([getattr(one, scheme) for one in predicted])
        axis.plot(
            x,
            limit * unit,
            color="gray",
            linestyle=line,
            linewidth=2.5,
            alpha=0.6,
            label=f"{scheme}: predicted, {LIMITS[scheme]:.3g}",
        )
    labels = {
        "stiffness": ("contact frequency / highest mode's", "contact frequency x step"),
        "mass": ("sphere mass / (plate impedance x contact time)", "step / contact time"),
        "shaken": ("plate speed / impact speed", "step / contact time"),
    }
    axis.set(title=_TITLES[name], yscale="log", xlabel=labels[name][0], ylabel=labels[name][1])
    if name == "shaken":
        axis.set_xscale("symlog", linthresh=0.1)
        axis.set_xlim(-0.02, 150)
    else:
        axis.set_xscale("log")
    if stiffness:
        axis.legend(fontsize=7, ncols=2, loc="lower right")


def draw_energy(path: Path, outcomes: dict[str, list[Outcome]], loop: list[LoopPoint]) -> None:
    """Energy residual and solves of the energy-keeping schemes; the closed loop without kappa = 0,
    which is no control."""
    kappas, latencies_us = (
        list(dict.fromkeys(getattr(p, name) for p in loop)) for name in ("kappa", "latency_us")
    )
    plate_db, fed_in = (
        np.array([getattr(p, name) for p in loop]).reshape(len(kappas), len(latencies_us))
        for name in ("plate_energy_db", "injected")
    )
    metric, axes = pictures.sheet(2, 2, width=11.0, height=4.2)
    for j, scheme in enumerate(BALANCED):
        for i, (name, found) in enumerate(outcomes.items()):
            mine = [one for one in found if one.scheme == scheme]
            steps = list(dict.fromkeys(one.step for one in mine))
            style = pictures.look(2 * i + j, True)
            label = f"{scheme}: {_NAMES[name]}"
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
        title="Most evaluations of a contact solve (90 or more: modal falls back)",
        xlabel="step / contact time",
        ylabel="evaluations",
    )
    titles = ("plate energy against none (dB)", "energy fed in / impact energy")
    for axis, values, title, levels in zip(
        axes[1],
        (plate_db, fed_in),
        titles,
        ((0.0, 2.0, 4.0, 6.0), (0.1, 0.5, 1.0, 2.0)),
        strict=True,
    ):
        grid = latencies_us, kappas[1:], values[1:]
        shown = axis.contourf(*grid, 16, cmap="viridis")
        lines = axis.contour(*grid, levels, colors="white", linewidths=1.2)
        labels = axis.clabel(lines, fmt="%g", colors="white", fontsize=9)
        for label in labels:
            label.set_bbox({"facecolor": "black", "alpha": 0.6, "pad": 1.0, "edgecolor": "none"})
        axis.set(title=f"aluminium-3mm: {title}", xlabel="latency (us)", ylabel="kappa")
        metric.colorbar(shown, ax=axis)
    pictures.save(metric, path)
