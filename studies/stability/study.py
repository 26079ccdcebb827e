"""Where methods fail: blow up, lose the energy, or let the actuator feed energy without bound.

Limits of free and damped vibration (`stability_limits`), energy over stiffness, mass, plate speed
and loss factor (`stability_maps`), and here the closed loop over gain and latency.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from hertzloop.analysis.impacts import consistent_impacts
from hertzloop.loop.compiled import simulate
from hertzloop.setup import load
from studies.stability import limits as limits
from studies.stability import maps as maps
from studies.stability import pictures as stability_pictures
from studies.tabular import write_records, write_rows

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
    stability_pictures.draw_limits(folder / "stability.png", free, damped, contact, thesis, by_map)
    shape = (len(_KAPPAS), len(_LATENCIES_US))
    stability_pictures.draw_energy(
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
