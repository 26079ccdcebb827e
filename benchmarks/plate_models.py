"""First impacts of scenes on plates with other limits and theories, and what steps cost."""

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    bars,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_records,
    written,
)
from hertzloop.loop.simulate import simulate
from hertzloop.plant.estimates.plate_theory import (
    expected_kirchhoff_error,
    thickness_number,
    zener_inelasticity,
)
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.state_kernels import F_C
from hertzloop.plant.time_series import series_under
from hertzloop.scene.setup import Setup, load

_ROUNDS, _STEPS = 201, 400  # of the timing; the plants take turns


@dataclass(frozen=True)
class Run:
    """First impact of a run, what its truncated modes took (J), the largest residual of its
    balance, and the number of frequencies."""

    impact: Impact
    truncated_j: float
    residual: float
    frequencies: int


def run(setup: Setup, **changes: Any) -> Run:
    """A scene in its closed loop, its plant's description changed."""
    spec = replace(setup.plant, **changes)
    plant = CollocationPlant(spec)
    done = simulate(setup, own_plant=plant)
    balance = done.balance
    residual = max(abs(balance.energy_residual), abs(balance.momentum_residual))
    found = impacts_in(spec, done.truth)[0]
    return Run(found, balance.truncated_dissipated_j, residual, len(plant.modes.omega))


def changes(run: Impact, best: Impact) -> tuple[float, float, float, float]:
    """Of plate energy, rebound over impact speed, peak force and contact time, relative."""
    return (
        run.plate_energy_j / best.plate_energy_j - 1.0,
        (run.rebound_speed_m_s - best.rebound_speed_m_s) / best.impact_speed_m_s,
        run.peak_force_n / best.peak_force_n - 1.0,
        run.duration_s / best.duration_s - 1.0,
    )


def cost_ratios(base: Plant, other: Plant) -> tuple[float, float]:
    """us of a step of `base` in contact, and how many times as long one of `other` takes: of the
    quickest tenth of rounds of both in turn, each from the touch on."""
    started = []
    for plant in (base, other):
        while plant.state.body[F_C] == 0.0:
            series_under(plant, np.zeros(1))
        started.append([array.copy() for array in plant.state])
    times = np.empty((2, _ROUNDS))
    for i in range(_ROUNDS + 1):
        for j, plant in enumerate((base, other)):
            for array, kept in zip(plant.state, started[j], strict=True):
                array[:] = kept
            before = time.perf_counter()
            series_under(plant, np.zeros(_STEPS))
            if i:  # the first round warms up
                times[j, i - 1] = (time.perf_counter() - before) / _STEPS
    quick = np.quantile(times, 0.1, axis=1)
    return 1e6 * float(quick[0]), float(quick[1] / quick[0])


def first_contact(name: str, settings: list[str]) -> Setup:
    """A scene cut to what its first contact needs, the plate by its modes."""
    return load(name, ["run.lead_in_s=2.5e-6", "run.plate_model=modal", *settings])


def shown(value: float) -> str:
    """A change as it is printed."""
    return "" if math.isnan(value) else f"{value:+.1e}"


_HC = "contact.damping=hunt_crossley"
_WITHOUT_LAW = "controller.law=off"
_SHORT, _LONG = "run.duration_s=60e-6", "run.duration_s=3.2e-3"
_BEST_HZ, _BEST_OAK_HZ = 4e6, 2e5
# Scene, settings, limits (Hz), limit of the reference.
_TAIL_CASES: dict[str, tuple[str, list[str], tuple[float, ...], float]] = {
    "3 mm, e 0.7": (
        "aluminium-3mm", [_SHORT, _WITHOUT_LAW, _HC, "contact.restitution=0.7"], (250e3,), _BEST_HZ
    ),
    "3 mm, e 0.2": (
        "aluminium-3mm", [_SHORT, _WITHOUT_LAW, _HC, "contact.restitution=0.2"], (250e3,), _BEST_HZ
    ),
    "oak, e 0.6": ("oak-20mm", [_LONG, _WITHOUT_LAW], (17.4e3,), _BEST_OAK_HZ),
    "oak, e 0.6, law": ("oak-20mm", [_LONG], (17.4e3,), _BEST_OAK_HZ),
    "3 mm, law at -0.6": (
        "aluminium-3mm", [_SHORT, "controller.v_thr_m_s=-0.6"], (125e3, 250e3), _BEST_HZ
    ),
    "3 mm, no damper, no law": ("aluminium-3mm", [_SHORT, _WITHOUT_LAW], (125e3, 250e3), _BEST_HZ),
}  # fmt: skip
# Samples of 1 us on finer steps; the force of a sample acts 1 us after it, as with steps of 1 us.
_FINE = ["run.step_ns=250", "sensors.every_steps=4", "controller.latency_us=0.75"]


@dataclass(frozen=True)
class Truncation:
    """Errors of plate energy and of rebound over impact speed with a spring and with a damped mode,
    the share of the plate energy that the mode took, and the largest residual of the balance."""

    case: str
    limit_khz: float
    spring_energy: float
    spring_rebound: float
    damped_energy: float
    damped_rebound: float
    residual_share: float
    residual: float


def errors(names: tuple[str, ...] | None = None) -> list[Truncation]:
    """All cases, or those named, against modes up to 16 times their limit or more."""
    found = []
    for name in tracked("omitted modes", names or tuple(_TAIL_CASES)):
        source, settings, limits, highest = _TAIL_CASES[name]
        fine = _FINE if source == "aluminium-3mm" else []
        setup = first_contact(source, [*settings, *fine])
        best = run(setup, frequency_limit_hz=highest, damped_residual=True)
        for limit in limits:
            spring, damped = (
                run(setup, frequency_limit_hz=limit, damped_residual=truncation)
                for truncation in (False, True)
            )
            by_spring = changes(spring.impact, best.impact)
            by_mode = changes(damped.impact, best.impact)
            found.append(
                Truncation(
                    name,
                    limit / 1e3,
                    *by_spring[:2],
                    *by_mode[:2],
                    damped.truncated_j / damped.impact.plate_energy_j,
                    max(spring.residual, damped.residual),
                )
            )
    return found


def cost() -> list[tuple[str, float, float]]:
    """Case, us of a step in contact with the spring, and how many times that with the mode."""
    found = []
    for damping in ("none", "hunt_crossley"):
        settings = [_WITHOUT_LAW, f"contact.damping={damping}"]
        if damping == "hunt_crossley":
            settings.append("contact.restitution=0.7")
        setup = first_contact("aluminium-20mm", [*settings, "run.duration_s=1e-3"])
        plants = []
        for truncation in ("spring", "damped"):
            spec = replace(
                setup.plant, frequency_limit_hz=191e3, damped_residual=truncation == "damped"
            )
            plants.append(CollocationPlant(spec))
        name = f"damped mode against spring, contact.damping = '{damping}'"
        found.append((name, *cost_ratios(*plants)))
    return found


_OFF = "controller.law=off"
# Name, changes of the scene, length of the run (s).
_THEORY_CASES: dict[str, tuple[str, list[str], float]] = {
    "h 1.5, R 3 mm": ("aluminium-3mm", ["plate.thickness_m=0.0015"], 80e-6),
    "h 3, R 3 mm": ("aluminium-3mm", [], 45e-6),
    "h 6, R 4 mm, off centre": (
        "aluminium-3mm",
        [
            "plate.thickness_m=0.006",
            "sphere.radius_m=0.004",
            "plate.size_m=[0.6, 0.4]",
            "plate.contact_point_m=[0.22, 0.17]",
            "sphere.drop_height_m=0.119",
        ],
        50e-6,
    ),
    "h 10, R 5 mm": ("aluminium-3mm", ["plate.thickness_m=0.01", "sphere.radius_m=0.005"], 70e-6),
    "h 3, R 20 mm": ("aluminium-20mm", [], 2.5e-3),
}


@dataclass(frozen=True)
class Effect:
    """What thickness does to a first impact without control, relative to Kirchhoff's plate: plate
    energy, rebound over impact speed, peak force, contact time; what was expected before as its
    largest; both criteria; frequencies at the scene's accuracy, and the ratio of a step's time."""

    case: str
    k_h: float
    inelasticity: float
    plate_energy: float
    rebound: float
    peak_force: float
    contact_time: float
    expected: float
    frequencies: int
    frequencies_3d: int
    step_us: float
    times_as_long: float
    residual: float


def _scenes(name: str) -> tuple[Setup, Setup]:
    source, settings, lasts_s = _THEORY_CASES[name]
    cut = [*settings, _OFF, f"run.duration_s={lasts_s}"]
    thin, solid = (
        first_contact(source, [*cut, f"plate.theory={theory}"]) for theory in ("kirchhoff", "3d")
    )
    return thin, solid


def effects(names: tuple[str, ...] | None = None, *, timed: bool = True) -> list[Effect]:
    """All cases, or those named; both theories with the modes that their accuracy asks for."""
    found = []
    for name in tracked("plate theory", names or tuple(_THEORY_CASES)):
        thin_scene, solid_scene = _scenes(name)
        thin, solid = run(thin_scene), run(solid_scene)
        spec = thin_scene.plant
        plate = thin_scene.mechanics.local_plate
        step_us, ratio = math.nan, math.nan
        if timed:
            step_us, ratio = cost_ratios(
                CollocationPlant(spec), CollocationPlant(solid_scene.plant)
            )
        found.append(
            Effect(
                name,
                thickness_number(plate, solid.impact.duration_s),
                zener_inelasticity(spec.sphere, plate, spec.contact),
                *changes(solid.impact, thin.impact),
                expected_kirchhoff_error(spec.sphere, plate, spec.contact).largest,
                thin.frequencies,
                solid.frequencies,
                step_us,
                ratio,
                max(thin.residual, solid.residual),
            )
        )
    return found


_QUICK_THEORY, _QUICK_TRUNCATION = ("h 3, R 3 mm",), ("3 mm, e 0.7", "3 mm, no damper, no law")


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Measure what plate thickness does to an impact, and what omitted modes cost.

    Compares the three-dimensional plate with Kirchhoff's, and a massless spring with a damped mode
    in the place of the omitted modes: errors, and time a step.

    Example: python -m benchmarks.plate_models --quick
    """
    with results_in(folder, "plate_models", "modal") as made:
        theory = effects(_QUICK_THEORY if quick else None)
        truncations = errors(_QUICK_TRUNCATION if quick else None)
        costs = cost()
        write_records(made / "plate_theory.csv", theory)
        write_records(made / "plate_truncation.csv", truncations)
        shares = [
            (f"{t.case}, {t.limit_khz:g} kHz, {what}", abs(value))
            for t in truncations
            for what, value in (("spring", t.spring_energy), ("damped mode", t.damped_energy))
        ]
        title = "Omitted modes: error of the plate energy"
        bars(made / "plate_truncation.png", title, "relative error", shares, log=True)
    out.print(number_table(
        "Three dimensions against Kirchhoff: changes, the most expected, modes, us a step",
        ("impact", "kh", "lambda", "energy", "rebound", "peak", "time", "most",
         "modes", "3-D", "us", "times"),
        ((e.case, f"{e.k_h:.2f}", f"{e.inelasticity:.2g}", shown(e.plate_energy), shown(e.rebound),
          shown(e.peak_force), shown(e.contact_time), f"{e.expected:.1e}", str(e.frequencies),
          str(e.frequencies_3d), f"{e.step_us:.3g}", f"{e.times_as_long:.2f}") for e in theory),
    ))  # fmt: skip
    out.print(number_table(
        "Modes left out: error of plate energy (of rebound)",
        ("impact", "limit kHz", "spring", "damped mode", "it took"),
        ((t.case, f"{t.limit_khz:g}", f"{shown(t.spring_energy)} ({shown(t.spring_rebound)})",
          f"{shown(t.damped_energy)} ({shown(t.damped_rebound)})", f"{t.residual_share:.1e}")
         for t in truncations),
    ))  # fmt: skip
    for name, step_us, ratio in costs:
        out.print(f"{name}: a step of {step_us:.3g} us takes {ratio:.3f} times as long")
    residual = max(*(e.residual for e in theory), *(t.residual for t in truncations))
    out.print(f"energy and momentum balance: residual {residual:.1e} at most")
    written(made, "plate_theory.csv", "plate_truncation.csv", "plate_truncation.png")
    by_spring, by_mode = (
        max(abs(getattr(t, field)) for t in truncations)
        for field in ("spring_energy", "damped_energy")
    )
    conclude(
        f"In the place of the omitted modes, a damped mode leaves an error of the plate energy of "
        f"{by_mode:.1e} at most and a spring {by_spring:.1e}, over {len(truncations)} cases."
    )


if __name__ == "__main__":
    start("benchmarks.plate_models")
