"""The spheres' bounces, by the published scheme and by the consistent one."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.loop.simulate import simulate
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.time_series import XI, XI_S
from hertzloop.results.impacts import first_impact
from hertzloop.scene.setup import Setup
from hertzloop.studies.pages import pictures
from hertzloop.studies.pages.pictures import look

PLATES = ("aluminium", "oak", "sylomer")
_OFF, _ON = "controller.law=off", "controller.law=slope_threshold"
_BOUNCES_S = 0.35


@lru_cache(maxsize=128)
def _run(source: str, *settings: str) -> tuple[Setup, np.ndarray]:
    """A scene and its rows of truth."""
    setup = load(source, list(settings))
    return setup, simulate(setup).truth


def _pair(plate: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Scene and title of the published and the consistent column."""
    return (
        (f"thesis-{plate}", f"{plate}, published (thesis2008)"),
        (f"{plate}-20mm", f"{plate}, consistent (modal)"),
    )


def _bouncing(source: str, law: str) -> tuple[Setup, np.ndarray]:
    """A long run. The published scheme, whose work grows as the square of a contact's steps,
    is followed until the sphere has stayed on the plate for a quarter of the run."""
    setup = load(source)
    if SCHEMES[setup.run.scheme].conserves:
        return _run(source, law, f"run.duration_s={_BOUNCES_S}")
    for part in (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1):
        setup, rows = _run(source, law, f"run.duration_s={_BOUNCES_S * part:.6f}")
        if np.all(rows[XI, -rows.shape[1] // 4 :] <= 0.0):
            break
    return setup, rows


def bounces(path: Path, plates: Sequence[str]) -> Path:
    """Height of the sphere over the plate's rest position, with and without control."""
    figure, axes = pictures.sheet(len(plates), 2)
    for row, plate in enumerate(tracked("plates", plates)):
        for column, (source, title) in enumerate(_pair(plate)):
            left = axes[row, column]
            for i, (law, what) in enumerate(((_OFF, "without control"), (_ON, "with"))):
                setup, rows = _bouncing(source, law)
                t = np.arange(rows.shape[1]) * setup.run.step_s
                every = slice(None, None, 100)
                ends = " (stays)" if rows.shape[1] * setup.run.step_s < 0.99 * _BOUNCES_S else ""
                left.plot(t[every] * 1e3, rows[XI_S, every] * 1e3, **look(i), label=what + ends)
            left.set(title=title, xlabel="time (ms)", ylabel="sphere (mm)")
            left.set_xlim(0.0, 1e3 * _BOUNCES_S)
            left.legend()
    return pictures.save(figure, path)


@dataclass(frozen=True)
class Contact:
    """The first contact of a plate without control, by one scheme."""

    plate: str
    scheme: str
    contact_time_us: float
    peak_force_n: float
    next_impact_speed_m_s: float


def first_contact(plate: str, source: str) -> Contact:
    """The first contact of a scene. Raises ValueError without one."""
    setup, rows = _run(source, _OFF)
    impact = first_impact(setup, rows)
    if impact is None:
        raise ValueError(f"{source}: no impact")
    time_us, speed = 1e6 * impact.noise.contact_time_s, impact.noise.next_impact_speed_m_s
    return Contact(plate, setup.run.scheme, time_us, impact.impact.peak_force_n, speed)


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Draw the bounces on each plate by the published and the consistent scheme.

    Also prints the first contacts. With --quick: aluminium alone.

    Example: python -m paper.figures --quick
    """
    plates = PLATES[:1] if quick else PLATES
    with results_in(folder, "figures", "modal", "thesis2008") as results:
        bounces(results.path("bounces.png"), plates)
        contacts = [first_contact(plate, source) for plate in plates for source, _ in _pair(plate)]
        results.write("figures", contacts)
        results.table(
            "First contact without control",
            {
                "plate": "{.plate}",
                "scheme": "{.scheme}",
                "contact time (us)": "{.contact_time_us:.0f}",
                "peak force (N)": "{.peak_force_n:.4g}",
                "next impact (m/s)": "{.next_impact_speed_m_s:.3g}",
            },
            contacts,
            text=2,
        )
        published, consistent = (c.contact_time_us for c in contacts[:2])
        results.conclude(
            f"The first contact on {plates[0]} lasts {published:.0f} us in the published scheme "
            f"and {consistent:.0f} us in the default scheme."
        )


if __name__ == "__main__":
    start("paper.figures")
