"""The study's figures, redrawn from our own runs: published scheme left, consistent right."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from hertzloop.analysis.impacts import F_A, F_C, V_P, XI, XI_S, first_impact
from hertzloop.loop.compiled import simulate
from hertzloop.setup import Setup, load
from plant.figures import noise
from plant.schemes.registry import SCHEMES
from plant.structures import radiation
from plant.structures.structure import oscillators
from studies import pictures
from studies.pictures import look

PLATES = ("aluminium", "oak", "sylomer")
_OFF, _ON = "controller.law=off", "controller.law=slope_threshold"
_BEFORE = 5  # steps shown before the contact
_BOUNCES_S = 0.35


@lru_cache(maxsize=64)
def _run(source: str, *settings: str) -> tuple[Setup, np.ndarray]:
    """A scene and its rows of truth."""
    setup = load(source, list(settings))
    return setup, simulate(setup).rows


def _pair(plate: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Scene and title of the published and the consistent column."""
    return (
        (f"thesis-{plate}", f"{plate}, published (thesis2008)"),
        (f"{plate}-20mm", f"{plate}, consistent (modal)"),
    )


def _first_contact(source: str, law: str) -> tuple[np.ndarray, np.ndarray]:
    """Time since the start (s) and rows around the first contact."""
    setup, rows = _run(source, law)
    impact = first_impact(setup, rows)
    if impact is None:
        raise ValueError(f"{source}: no impact")
    length = impact.end - impact.start
    end = min(impact.end + max(length // 10, 3), rows.shape[1])
    begin = max(impact.start - _BEFORE, 0)
    return (np.arange(begin, end) - impact.start) * setup.step_s, rows[:, begin:end]


def penetration(folder: Path) -> Path:
    """xi and v_p of the three plates during the first contact, without control."""
    figure, axes = pictures.sheet(len(PLATES), 2)
    for row, plate in enumerate(PLATES):
        for column, (source, title) in enumerate(_pair(plate)):
            t, rows = _first_contact(source, _OFF)
            left = axes[row, column]
            left.plot(t * 1e6, rows[XI] * 1e6, **look(0), label="xi")
            left.set(title=title, xlabel="time (us)", ylabel="xi (um)")
            right = left.twinx()
            right.grid(visible=False)
            right.plot(t * 1e6, rows[V_P], **look(1), label="v_p")
            right.set_ylabel("v_p (m/s)")
            lines = left.get_lines() + right.get_lines()
            left.legend(lines, [str(line.get_label()) for line in lines], loc="lower right")
    return pictures.save(figure, folder / "penetration.png")


def forces(folder: Path) -> Path:
    """Contact and active force of the slope-threshold law, and the contact force without it."""
    figure, axes = pictures.sheet(len(PLATES), 2)
    for row, plate in enumerate(PLATES):
        for column, (source, title) in enumerate(_pair(plate)):
            left = axes[row, column]
            t, rows = _first_contact(source, _ON)
            left.plot(t * 1e6, rows[F_C], **look(0), label="F_c with control")
            left.plot(t * 1e6, rows[F_A], **look(1), label="F_a")
            t, rows = _first_contact(source, _OFF)
            left.plot(t * 1e6, rows[F_C], **look(2), label="F_c without")
            left.set(title=title, xlabel="time (us)", ylabel="force (N)")
            left.legend()
    return pictures.save(figure, folder / "forces.png")


def _density(source: str, law: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Frequencies (Hz), |F|^2 Re Y/pi and the same radiated (J s), critical frequency (Hz).

    On 400 frequencies up to 20 kHz, with the loss factor raised to 0.05 where it is smaller:
    single resonances of a lightly damped plate would hide the curve.
    """
    setup, rows = _run(source, law)
    impact = first_impact(setup, rows)
    if impact is None:
        raise ValueError(f"{source}: no impact")
    spec = setup.plant
    plate = spec.simply_supported
    force = rows[F_A, impact.start : impact.end] - impact.contact_n
    f = np.linspace(50.0, noise.RADIATED_UP_TO_HZ, 400)
    modes = oscillators(plate, spec.contact_point_m, spec.contact_point_m, 4e5)
    smooth = replace(modes, eta=max(plate.eta, 0.05))
    spectrum = np.abs(noise.force_spectrum(force, setup.step_s, f)) ** 2
    density = spectrum * noise.mobility(smooth, f).real / np.pi
    efficiency = radiation.efficiency_fahy(plate, f)
    return f, density, density * efficiency, radiation.critical_frequency_hz(plate)


def spectra(folder: Path) -> Path:
    """Energy spectra of the first impact, into the plate and radiated, with and without law."""
    figure, axes = pictures.sheet(len(PLATES), 2)
    for row, plate in enumerate(PLATES):
        for column, (source, title) in enumerate(_pair(plate)):
            left = axes[row, column]
            for i, (law, what) in enumerate(((_OFF, "without"), (_ON, "with control"))):
                f, taken, radiated, critical = _density(source, law)
                left.semilogy(f / 1e3, taken, **look(i), label=f"transmitted, {what}")
                left.semilogy(f / 1e3, radiated, **look(i + 2), label=f"radiated, {what}")
            if critical < noise.RADIATED_UP_TO_HZ:
                left.axvline(critical / 1e3, color="gray", linewidth=0.8)
            left.set(title=title, xlabel="frequency (kHz)", ylabel="energy density (J s)")
            left.legend(fontsize=6)
    return pictures.save(figure, folder / "spectra.png")


def efficiencies(folder: Path) -> Path:
    """Both radiation efficiencies of the three plates."""
    figure, axes = pictures.sheet(1, 2, height=3.4)
    f = np.geomspace(50.0, noise.RADIATED_UP_TO_HZ, 800)
    titles = ("the study's", "Maidanik's")
    forms = (radiation.efficiency_fahy, radiation.efficiency_maidanik)
    for axis, title, form in zip(axes[0], titles, forms, strict=True):
        for i, plate in enumerate(PLATES):
            struck = load(f"{plate}-20mm").plant.simply_supported
            critical = radiation.critical_frequency_hz(struck)
            label = f"{plate}, f_c = {critical:.0f} Hz"
            axis.loglog(f, form(struck, f), **look(i), label=label)
        axis.set(title=f"Radiation efficiency, {title}", xlabel="frequency (Hz)", ylim=(1e-3, 10))
        axis.legend()
    return pictures.save(figure, folder / "radiation-efficiency.png")


def _bouncing(source: str, law: str) -> tuple[Setup, np.ndarray]:
    """A long run. The published scheme, whose work grows as the square of a contact's steps,
    is followed until the sphere has stayed on the plate for a quarter of the run."""
    setup = load(source)
    if SCHEMES[setup.scheme].conserves:
        return _run(source, law, f"run.duration_s={_BOUNCES_S}")
    for part in (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1):
        setup, rows = _run(source, law, f"run.duration_s={_BOUNCES_S * part:.6f}")
        if np.all(rows[XI, -rows.shape[1] // 4 :] <= 0.0):
            break
    return setup, rows


def bounces(folder: Path) -> Path:
    """Height of the sphere over the plate's rest position, with and without control."""
    figure, axes = pictures.sheet(len(PLATES), 2)
    for row, plate in enumerate(PLATES):
        for column, (source, title) in enumerate(_pair(plate)):
            left = axes[row, column]
            for i, (law, what) in enumerate(((_OFF, "without control"), (_ON, "with"))):
                setup, rows = _bouncing(source, law)
                t = np.arange(rows.shape[1]) * setup.step_s
                every = slice(None, None, 100)
                ends = " (stays)" if rows.shape[1] * setup.step_s < 0.99 * _BOUNCES_S else ""
                left.plot(t[every] * 1e3, rows[XI_S, every] * 1e3, **look(i), label=what + ends)
            left.set(title=title, xlabel="time (ms)", ylabel="sphere (mm)")
            left.set_xlim(0.0, 1e3 * _BOUNCES_S)
            left.legend()
    return pictures.save(figure, folder / "bounces.png")


def draw(folder: Path) -> list[Path]:
    """All figures as PNG; the files written."""
    return [make(folder) for make in (penetration, forces, spectra, efficiencies, bounces)]
