"""What the modes left out cost as a massless spring, and as one damped mode."""

from dataclasses import dataclass, replace

from plant.schemes.collocation import CollocationPlant
from studies.plate_models import runs

_HC = "contact.damping=hunt_crossley"
_OFF = "controller.law=off"
_SHORT, _LONG = "run.duration_s=60e-6", "run.duration_s=3.2e-3"
_BEST_HZ, _BEST_OAK_HZ = 4e6, 2e5
# Scene, settings, limits (Hz), limit of the reference.
_CASES: dict[str, tuple[str, list[str], tuple[float, ...], float]] = {
    "3 mm, e 0.7": (
        "aluminium-3mm", [_SHORT, _OFF, _HC, "contact.restitution=0.7"], (250e3,), _BEST_HZ
    ),
    "3 mm, e 0.2": (
        "aluminium-3mm", [_SHORT, _OFF, _HC, "contact.restitution=0.2"], (250e3,), _BEST_HZ
    ),
    "oak, e 0.6": ("oak-20mm", [_LONG, _OFF], (17.4e3,), _BEST_OAK_HZ),
    "oak, e 0.6, law": ("oak-20mm", [_LONG], (17.4e3,), _BEST_OAK_HZ),
    "3 mm, law at -0.6": (
        "aluminium-3mm", [_SHORT, "controller.v_thr_m_s=-0.6"], (125e3, 250e3), _BEST_HZ
    ),
    "3 mm, no damper, no law": ("aluminium-3mm", [_SHORT, _OFF], (125e3, 250e3), _BEST_HZ),
}  # fmt: skip
# Samples of 1 us on finer steps; the force of a sample acts 1 us after it, as with steps of 1 us.
_FINE = ["run.step_ns=250", "sensors.every_steps=4", "controller.latency_us=0.75"]


@dataclass(frozen=True)
class Tail:
    """Errors of plate energy and of rebound over impact speed with a spring and with a damped mode,
    the share of the plate energy that the mode took, and the largest residual of the books."""

    case: str
    limit_khz: float
    spring_energy: float
    spring_rebound: float
    damped_energy: float
    damped_rebound: float
    tail_share: float
    residual: float


def errors(names: tuple[str, ...] | None = None) -> list[Tail]:
    """All cases, or those named, against modes up to 16 times their limit or more."""
    found = []
    for name in names or tuple(_CASES):
        source, settings, limits, highest = _CASES[name]
        fine = _FINE if source == "aluminium-3mm" else []
        setup = runs.first_contact(source, [*settings, *fine])
        best = runs.run(setup, frequency_limit_hz=highest, damped_tail=True)
        for limit in limits:
            spring, damped = (
                runs.run(setup, frequency_limit_hz=limit, damped_tail=tail)
                for tail in (False, True)
            )
            by_spring = runs.changes(spring.impact, best.impact)
            by_mode = runs.changes(damped.impact, best.impact)
            found.append(
                Tail(
                    name,
                    limit / 1e3,
                    *by_spring[:2],
                    *by_mode[:2],
                    damped.tail_j / damped.impact.plate_energy_j,
                    max(spring.residual, damped.residual),
                )
            )
    return found


def cost() -> list[tuple[str, float, float]]:
    """Case, us of a step in contact with the spring, and how many times that with the mode."""
    found = []
    for damping in ("none", "hunt_crossley"):
        settings = [_OFF, f"contact.damping={damping}"]
        if damping == "hunt_crossley":
            settings.append("contact.restitution=0.7")
        setup = runs.first_contact("aluminium-20mm", [*settings, "run.duration_s=1e-3"])
        plants = []
        for tail in ("spring", "damped"):
            spec = replace(setup.plant, frequency_limit_hz=191e3, damped_tail=tail == "damped")
            plants.append(CollocationPlant(spec))
        name = f"damped mode against spring, contact.damping = '{damping}'"
        found.append((name, *runs.cost_ratios(*plants)))
    return found
