"""Where the published numerics fail, beside the consistent scheme.

Two checks without control: contact impulse against momentum change; contact time and rebound
as the step shrinks.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from benchmarks.schemes import discrete_gradient_kernels
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.loop.simulate import simulate
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import (
    GRAVITY_M_S2,
    STEP,
    XI,
)
from hertzloop.plant.time_series import F_C
from hertzloop.results.impacts import first_impact
from hertzloop.studies.pages import pictures

_LAW = "controller.law=slope_threshold"
_OFF = "controller.law=off"
_LASTS = "run.duration_s=0.06"  # all contacts of the first arrival


def _bars(axes: Any, labels: list[str], values: list[float], published: list[bool]) -> None:
    for i, (value, is_published) in enumerate(zip(values, published, strict=True)):
        axes.barh(
            i,
            value,
            color=pictures.COLOURS[1 if is_published else 0],
            hatch="//" if is_published else "",
            edgecolor="black",
            linewidth=0.5,
        )
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)


_CALLED = {"modal": "consistent", "thesis2008": "published"}


def draw(path: Path, steps_us: tuple[float, ...], checks: dict[str, list[Any]]) -> None:
    """Draw the rows of all checks, by their names in `main`."""
    figure, axes = pictures.sheet(1, 2, width=13.0, height=4.6)
    rows = checks["momentum"]
    ratios = [row.ratio for row in rows]
    _bars(
        axes[0, 0], [r.scene for r in rows], ratios, [not SCHEMES[r.scheme].conserves for r in rows]
    )
    axes[0, 0].set(
        title="Does the contact force change the sphere's momentum?",
        xscale="log",
        xlim=(1e-5, 2),
        xlabel="contact impulse / momentum change (1 is right)",
    )
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
        title="Rebound speed as the step shrinks",
        xlabel="step (us)",
        ylabel="change against the finest step / impact speed",
    )
    axes[0, 1].set_xticks(steps, [f"{step:g}" for step in steps_us])
    axes[0, 1].minorticks_off()
    axes[0, 1].legend()
    known = [
        Patch(facecolor=pictures.COLOURS[1], hatch="//", edgecolor="black", label="published"),
        Patch(facecolor=pictures.COLOURS[0], edgecolor="black", label="consistent"),
    ]
    figure.legend(handles=known, loc="outside upper center", ncols=2)
    pictures.save(figure, path)


MATERIALS = ("aluminium", "oak", "sylomer")
STEPS_US = (4.0, 2.0, 1.0, 0.5, 0.25)
_REFERENCE_US = 0.0625


@dataclass(frozen=True)
class Momentum:
    """Impulse of the contact against the sphere's momentum change, N s, first impact."""

    scene: str
    scheme: str
    contact_impulse_n_s: float
    momentum_change_n_s: float  # gravity's share taken off
    ratio: float


@dataclass(frozen=True)
class Refinement:
    """First contact on aluminium at one step length; errors against the finest, in per cent
    of its value (consistent scheme) or against its own finest (published)."""

    scheme: str
    step_us: float
    contact_time_us: float
    rebound_m_s: float
    rebound_error: float  # relative to the impact speed, against the reference


def momentum() -> list[Momentum]:
    """Impulse and momentum change of the first impact, both schemes, three plates."""
    found = []
    for name in MATERIALS:
        for source in (f"thesis-{name}", f"{name}-20mm"):
            scene = load(source, ["controller.law=off"])
            rows = simulate(scene).truth
            impact = first_impact(scene, rows)
            if impact is None:
                raise ValueError(f"{source}: no impact")
            # A contact that the run cuts off has its speed at the last step but one.
            last = impact.end if impact.ended else impact.end - 2
            force = rows[F_C, impact.start : last]
            impulse = float(np.sum(force)) * scene.run.step_s
            mass = scene.plant.sphere.mass_kg
            noise = impact.noise
            change = mass * (noise.impact_speed_m_s + noise.next_impact_speed_m_s)
            change += mass * GRAVITY_M_S2 * len(force) * scene.run.step_s
            found.append(Momentum(source, scene.run.scheme, impulse, change, impulse / change))
    return found


def refinement() -> list[Refinement]:
    """Contact time and rebound of the first impact on aluminium under smaller steps.

    Published: all modes to pi/dt, as it prescribes, with the damping calibrated at 1 us.
    Consistent: the 125 kHz that the largest step carries at every step, so that what changes is
    the step alone.
    """
    found = []
    for scheme, measure, finest in (
        ("thesis2008", _published_contact, STEPS_US[-1]),
        ("modal", _consistent_contact, _REFERENCE_US),
    ):
        reference = measure(finest)[1]
        for step_us in STEPS_US:
            time_us, rebound = measure(step_us)
            found.append(
                Refinement(scheme, step_us, time_us, rebound, abs(rebound - reference) / 0.99045)
            )
    return found


def _published_contact(step_us: float) -> tuple[float, float]:
    scene = load(
        "thesis-aluminium",
        ["controller.law=off", "controller.lead_us=0", f"run.step_ns={round(step_us * 1000)}"],
    )
    impact = first_impact(scene, simulate(scene).truth)
    if impact is None or not impact.ended:
        raise ValueError(f"the published contact does not end at a step of {step_us} us")
    return impact.noise.contact_time_s * 1e6, impact.noise.next_impact_speed_m_s


def _consistent_contact(step_us: float) -> tuple[float, float]:
    spec = load("aluminium-20mm").plant
    spec = replace(
        spec, step_s=step_us * 1e-6, frequency_limit_hz=125e3, lead_in_s=10.0 * step_us * 1e-6
    )
    return consistent_first_contact(spec, 2e-3)


def consistent_first_contact(spec: PlantSpec, longest_s: float) -> tuple[float, float]:
    """Contact time (us) and sphere speed (m/s) after the first contact without control."""
    plant = DiscreteGradientPlant(spec)
    body = plant.state.body
    began = None
    for _ in range(round(longest_s / spec.step_s)):
        gap = float(body[XI])
        discrete_gradient_kernels.step(plant.model, plant.state, 0.0)
        after = float(body[XI])
        at = (float(plant.state.counts[STEP]) - after / (after - gap)) if after != gap else 0.0
        if began is None and after < 0.0:
            began = at
        elif began is not None and after > 0.0:
            late_s = (float(plant.state.counts[STEP]) - at) * spec.step_s
            speed = plant.sphere_speed_m_s() + GRAVITY_M_S2 * late_s
            return (at - began) * spec.step_s * 1e6, speed
    raise ValueError(f"the first contact does not end within {longest_s} s")


def _cell(name: str) -> Callable[[Any], str]:
    """The text of a field."""

    def text(row: Any) -> str:
        value = getattr(row, name)
        if isinstance(value, float):
            return f"{value:.4g}"
        return f"{value:,}" if isinstance(value, int) else str(value)

    return text


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Show where the published numerics fail, beside the consistent scheme.

    --quick changes nothing: it takes seconds.

    Example: python -m paper.weaknesses --quick
    """
    measures: dict[str, tuple[str, Callable[[], list[Any]]]] = {
        "momentum": ("Contact impulse against momentum change", momentum),
        "refinement": ("First contact on aluminium under smaller steps", refinement),
    }
    with results_in(folder, "weaknesses", "modal", "thesis2008") as results:
        checks: dict[str, list[Any]] = {}
        for name, (title, measure) in tracked("weaknesses", measures.items()):
            rows = checks[name] = measure()
            results.write(f"weaknesses-{name}", rows)
            names = [field.name for field in fields(rows[0])]
            columns = {name.replace("_", " "): _cell(name) for name in names}
            results.table(title, columns, rows, text=0)
        draw(results.path("weaknesses.png"), STEPS_US, checks)
        ratios: dict[str, list[float]] = {}
        for one in checks["momentum"]:
            ratios.setdefault(one.scheme, []).append(one.ratio)
        off = max(abs(ratio - 1.0) for ratio in ratios["modal"])
        results.conclude(
            f"The contact impulse of the published scheme is at most "
            f"{100.0 * max(ratios['thesis2008']):.2g} % of the momentum change; that of the "
            f"default scheme equals it within {off:.0e} of its size."
        )


if __name__ == "__main__":
    start("paper.weaknesses")
