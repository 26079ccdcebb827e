"""Where methods fail: blow up, lose the energy, or let the actuator feed energy without bound.

Limits of free and damped vibration (`stability_limits`), energy over stiffness, mass, plate speed
and loss factor (`stability_maps`), and here the closed loop over gain and latency.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.analysis.impacts import consistent_impacts
from hertzloop.loop.compiled import simulate
from hertzloop.setup import load
from studies import pictures
from studies.stability import limits
from studies.stability import limits as maps
from studies.words import write_records, write_rows

_BALANCED = ("modal", "discrete_gradient")
_TITLES = {
    "stiffness": "Contact stiffness",
    "mass": "Sphere mass against plate impedance (marks as above)",
    "shaken": "Impact on a vibrating plate (marks as above)",
}  # fmt: skip
_NAMES = {
    "stiffness": "stiffness", "mass": "sphere mass", "shaken": "plate speed", "loss": "loss factor",
}  # fmt: skip
_FLOOR = 1e-17  # below any residual but an exact zero


def draw_limits(
    path: Path,
    free: list[tuple[str, float, float]],
    damped: list[tuple[str, float, float, float]],
    contact: list[maps.Outcome],
    thesis: list[tuple[float, float, float, float]],
    by_map: dict[str, maps.Map],
) -> None:
    """Where the textbook integrators blow up or are wrong, with the predicted limits."""
    figure, axes = pictures.sheet(3, 2, width=11.0, height=4.2)
    _free(axes[0, 0], free)
    _damped(axes[0, 1], damped)
    _contact(axes[1, 0], contact, thesis)
    for axis, name in zip((axes[1, 1], axes[2, 0], axes[2, 1]), _TITLES, strict=True):
        _borders(axis, name, *by_map[name])
    pictures.save(figure, path)


def _free(axis: Any, free: list[tuple[str, float, float]]) -> None:
    for i, scheme in enumerate(limits.TEXTBOOK):
        mine = [(x, g) for name, x, g in free if name == scheme and g < 3.0]
        axis.plot(*zip(*mine, strict=True), label=scheme, **pictures.look(i))
    for limit in limits.LIMITS.values():
        axis.axvline(limit, color="gray", linewidth=0.8)
        axis.text(limit + 0.03, 0.62, f"{limit:.3g}", color="dimgray")
    axis.axhline(1.0, color="black", linewidth=0.8, label="modal, discrete_gradient: exact")
    axis.set(title="Free vibration", xlabel="w h", ylabel="growth per step", ylim=(0.6, 2.0))
    axis.legend(loc="upper left")


def _damped(axis: Any, damped: list[tuple[str, float, float, float]]) -> None:
    for i, scheme in zip((0, 4, 1), limits.DAMPED, strict=True):
        mine = np.array([row[1:] for row in damped if row[0] == scheme])
        style = pictures.look(i, True)
        axis.plot(mine[:, 0], mine[:, 1], color=style["color"], linestyle=style["linestyle"])
        style |= {"linestyle": "none"}
        axis.plot(mine[:, 0], mine[:, 2], label=scheme, **style)
    axis.set(
        title="Free vibration with damping: lines predicted, marks measured", ylim=(1.0, 3.2),
        xlabel="loss factor", ylabel="largest stable w h",
    )  # fmt: skip
    axis.legend(loc="lower left")


def _contact(
    axis: Any, contact: list[maps.Outcome], thesis: list[tuple[float, float, float, float]]
) -> None:
    for i, scheme in enumerate([*limits.TEXTBOOK, "discrete_gradient", "modal"]):
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
        title="One contact: energy lost or gained", xlabel="step / contact time",
        ylabel="relative", ylim=(1e-17, 1e4),
    )  # fmt: skip
    axis.legend(fontsize=7, ncols=2, loc=(0.22, 0.32))


def _borders(
    axis: Any, name: str, predicted: list[maps.Predicted], found: list[maps.Outcome]
) -> None:
    """Borders of the textbook integrators; on the stiffness map in terms of the contact's
    frequency, on the others of the rigid plate's contact time."""
    stiffness = name == "stiffness"
    x = [one.contact_over_highest_mode if stiffness else one.where for one in predicted]
    unit = np.array([one.contact_frequency_step if stiffness else 1.0 for one in predicted])
    for i, scheme in enumerate(limits.TEXTBOOK):
        style = pictures.look(i, True)
        wrong = np.array([step for _, step in maps.border(found, scheme, maps.WRONG)])
        axis.plot(x, wrong * unit, label=f"{scheme}: 1 % wrong", **style)
        style |= {"linestyle": "none", "markerfacecolor": "none", "markersize": 8}
        doubled = np.array([step for _, step in maps.border(found, scheme, maps.BLOWN)])
        axis.plot(x, doubled * unit, label=f"{scheme}: doubled", **style)
    for scheme, line in zip(limits.LIMITS, ("-", "--"), strict=True):
        limit = np.array([getattr(one, scheme) for one in predicted])
        axis.plot(
            x, limit * unit, color="gray", linestyle=line, linewidth=2.5, alpha=0.6,
            label=f"{scheme}: predicted, {limits.LIMITS[scheme]:.3g}",
        )  # fmt: skip
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


def draw_energy(
    path: Path,
    outcomes: dict[str, list[maps.Outcome]],
    latencies_us: np.ndarray,
    kappas: np.ndarray,
    plate_db: np.ndarray,
    fed_in: np.ndarray,
) -> None:
    """Energy residual and solves of the energy-keeping schemes; the closed loop, arrays of shape
    (kappas, latencies), without the first row, kappa = 0, which is no control."""
    figure, axes = pictures.sheet(2, 2, width=11.0, height=4.2)
    for j, scheme in enumerate(_BALANCED):
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
        title="Energy residual, worst of each map", xlabel="step / contact time", ylabel="relative",
        ylim=(1e-16, 1e-6),
    )  # fmt: skip
    axes[0, 0].legend(fontsize=7, ncols=2, loc="upper left")
    axes[0, 1].set(
        title="Most evaluations of a contact solve (90 or more: modal falls back)",
        xlabel="step / contact time",
        ylabel="evaluations",
    )
    titles = ("plate energy against none (dB)", "energy fed in / impact energy")
    for axis, values, title, levels in zip(
        axes[1], (plate_db, fed_in), titles, ((0.0, 2.0, 4.0, 6.0), (0.1, 0.5, 1.0, 2.0)),
        strict=True,
    ):  # fmt: skip
        grid = latencies_us, kappas[1:], values[1:]
        shown = axis.contourf(*grid, 16, cmap="viridis")
        lines = axis.contour(*grid, levels, colors="white", linewidths=1.2)
        labels = axis.clabel(lines, fmt="%g", colors="white", fontsize=9)
        for label in labels:
            label.set_bbox({"facecolor": "black", "alpha": 0.6, "pad": 1.0, "edgecolor": "none"})
        axis.set(title=f"aluminium-3mm: {title}", xlabel="latency (us)", ylabel="kappa")
        figure.colorbar(shown, ax=axis)
    pictures.save(figure, path)


_KAPPAS = np.linspace(0.0, 2.0, 21)
_LATENCIES_US = np.arange(0, 61, 3)
_NEWTON = 14  # evaluations of a contact solve; with more, bisection had to step in


@dataclass(frozen=True)
class LoopPoint:
    """First impact with the law at one gain and latency: energies over the impact's energy."""

    kappa: float
    latency_us: float
    injected: float
    plate_energy_db: float  # against no control
    contact_us: float


def loop_map(name: str = "aluminium-3mm") -> Iterator[LoopPoint]:
    """The slope-threshold law's first impact over gain and latency."""
    lasts = "run.duration_s=0.0016"
    off = load(name, [lasts, "controller.law=off"])
    free = consistent_impacts(off, simulate(off).rows)[0]
    for kappa in _KAPPAS:
        for latency_us in _LATENCIES_US:
            keys = [f"controller.kappa={kappa:.3f}", f"controller.latency_us={latency_us}"]
            setup = load(name, [lasts, *keys])
            truth = simulate(setup)
            first = consistent_impacts(setup, truth.rows)[0]
            yield LoopPoint(
                float(kappa),
                float(latency_us),
                truth.books.injected_j / truth.books.energy_start_j,
                10.0 * math.log10(first.plate_energy_j / free.plate_energy_j),
                1e6 * first.duration_s,
            )


def run(folder: Path) -> dict[str, str]:
    """Measure all; write stability.png, stability-energy.png and a CSV file for each map; key
    figures to print. Steps are over the contact time of the same sphere on a rigid plate."""
    free, damped, contact = (
        list(limits.growth()),
        list(limits.damped_limits()),
        maps.contact_drift(),
    )
    thesis = list(maps.thesis_contact())
    by_map = {
        "stiffness": maps.stiffness_map(), "mass": maps.mass_map(), "shaken": maps.shaken_map(),
    }  # fmt: skip
    outcomes = {name: found for name, (_, found) in by_map.items()} | {"loss": maps.loss_map()}
    loop = list(loop_map())
    write_rows(folder / "stability-growth.csv", ["scheme", "omega_h", "growth_per_step"], free)
    write_rows(
        folder / "stability-damped.csv",
        ["scheme", "loss_factor", "predicted_omega_h", "measured_omega_h"],
        damped,
    )
    write_records(folder / "stability-contact.csv", contact)
    write_rows(
        folder / "stability-thesis2008.csv",
        ["step", "contact_length", "energy_residual", "momentum_residual"],
        thesis,
    )
    for name, found in outcomes.items():
        write_records(folder / f"stability-{name}.csv", found)
    write_rows(
        folder / "stability-predicted.csv",
        ["map", *(field.name for field in fields(maps.Predicted))],
        ((name, *astuple(one)) for name, (predicted, _) in by_map.items() for one in predicted),
    )
    write_records(folder / "stability-loop.csv", loop)
    draw_limits(folder / "stability.png", free, damped, contact, thesis, by_map)
    shape = (len(_KAPPAS), len(_LATENCIES_US))
    draw_energy(
        folder / "stability-energy.png", outcomes, _LATENCIES_US, _KAPPAS,
        np.array([p.plate_energy_db for p in loop]).reshape(shape),
        np.array([p.injected for p in loop]).reshape(shape),
    )  # fmt: skip
    return (
        _of_limits(free, damped)
        | _of_maps(by_map)
        | _of_balance(outcomes)
        | _of_thesis(thesis)
        | _of_loop(loop)
    )


def _of_limits(
    free: Iterable[tuple[str, float, float]], damped: list[tuple[str, float, float, float]]
) -> dict[str, str]:
    found = {}
    for scheme, limit in limits.LIMITS.items():
        grows = [phase for name, phase, factor in free if name == scheme and factor > 1.0 + 1e-9]
        found[f"{scheme} grows from w h ="] = f"{min(grows):.2f} (predicted {limit:.2f})"
    for scheme in limits.DAMPED:
        mine = [row for row in damped if row[0] == scheme]
        low, high = min(row[3] for row in mine), max(row[3] for row in mine)
        off = max(abs(row[3] - row[2]) for row in mine)
        found[f"{scheme}: limit of w h, loss factor 0 to 1"] = (
            f"{low:.2f} to {high:.2f} (off the predicted by {off:.0e})"
        )
    return found


def _range(values: Iterable[float]) -> str:
    known = [value for value in values if not math.isnan(value)]
    return f"{min(known):.2g} to {max(known):.2g}" if known else "none"


def _of_maps(by_map: dict[str, maps.Map]) -> dict[str, str]:
    """How the textbook integrators' borders lie on the maps, steps over contact time."""
    found = {}
    for name, (predicted, outcomes) in by_map.items():
        for scheme in limits.TEXTBOOK:
            wrong = maps.border(outcomes, scheme, maps.WRONG)
            doubled = maps.border(outcomes, scheme, maps.BLOWN)
            text = f"1 % wrong from {_range(b for _, b in wrong)} contact times"
            text += f", doubled from {_range(b for _, b in doubled)}"
            if scheme in limits.LIMITS:
                ratios = [
                    b / getattr(one, scheme) for (_, b), one in zip(doubled, predicted, strict=True)
                ]
                text += f" ({_range(ratios)} of the predicted limit)"
            found[f"{name} map: {scheme}"] = text
    return found


def _of_balance(outcomes: dict[str, list[maps.Outcome]]) -> dict[str, str]:
    found = {}
    for scheme in ("modal", "discrete_gradient"):
        for name, some in outcomes.items():
            mine = [one for one in some if one.scheme == scheme]
            worst = max(mine, key=lambda one: abs(one.change))
            slow = min((one.step for one in mine if one.evaluations > _NEWTON), default=math.inf)
            found[f"{scheme}, {name} map, steps of 0.01 to 100 contact times:"] = (
                f"worst energy residual {abs(worst.change):.1e}, "
                f"up to {max(one.contacts for one in mine)} contacts; "
                f"Newton's method needs help from {slow:.2g} contact times on, "
                f"{max(one.evaluations for one in mine)} evaluations at most"
            )
    return found


def _of_thesis(thesis: list[tuple[float, float, float, float]]) -> dict[str, str]:
    energy, momentum = [row[2] for row in thesis], [row[3] for row in thesis]
    lengths = [row[1] for row in thesis]
    return {
        "thesis2008, one contact, steps of 0.01 to 3 contact times:": (
            f"energy residual {_range(energy)}, momentum residual {_range(momentum)}, "
            f"contact {_range(lengths)} contact times long"
        )
    }


def _of_loop(loop: list[LoopPoint]) -> dict[str, str]:
    most = max(loop, key=lambda p: p.injected)
    better = [p for p in loop if p.plate_energy_db < -0.1]
    own = [p for p in loop if p.injected > 1.0]
    return {
        "most energy fed in by the actuator, of the impact's": (
            f"{most.injected:.2f} at kappa {most.kappa:g}, latency {most.latency_us:g} us"
        ),
        "the actuator feeds in more than the impact brought from kappa =": (
            f"{min(p.kappa for p in own):g}" if own else "none of those tried"
        ),
        "settings that take 0.1 dB or more off the plate": f"{len(better)} of {len(loop)}",
    }
