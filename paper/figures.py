"""The study's figures, redrawn from our own runs: published scheme left, consistent right."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    conclude,
    number_table,
    out,
    progress,
    results_in,
    start,
    tracked,
    write_records,
    written,
)
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics import noise
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.schemes.thesis2008 import sampled
from hertzloop.plant.structures import radiation
from hertzloop.plant.structures.structure import oscillators
from hertzloop.plant.time_series import F_A, F_C, V_P, XI, XI_P, XI_S
from hertzloop.results.impacts import first_impact
from hertzloop.scene.setup import Setup, load
from hertzloop.studies import pictures
from hertzloop.studies.pictures import look
from paper import optima, weaknesses
from paper import table_a1 as appendix
from paper.restitution import calibrate_relaxation

PLATES = ("aluminium", "oak", "sylomer")
_OFF, _ON = "controller.law=off", "controller.law=slope_threshold"
_BEFORE = 5  # steps shown before the contact
_BOUNCES_S = 0.35


@lru_cache(maxsize=64)
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


_FIGURES = (penetration, forces, spectra, efficiencies, bounces)


def draw_figures(folder: Path) -> list[Path]:
    """All figures as PNG; the files written."""
    return [make(folder) for make in tracked("figures", _FIGURES)]


# The study's other figures, by one table of sheets.
#
# Left column: the published numerics with the 20 mm sphere; right: the consistent scheme with 3
# mm, whose contact is as short as the published one.

_SMALL = ("sphere.radius_m=0.003", "run.duration_s=0.0015")
COLUMNS = {
    "published": ("thesis-{}", ()),
    "consistent, 3 mm": ("{}-20mm", _SMALL),
}
# What a panel can show over the time since the touch: rows of truth -> values, and the label.
QUANTITIES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "xi": (lambda rows: rows[XI] * 1e6, "xi (um)"),
    "plate": (lambda rows: rows[XI_P] * 1e6, "xi_p (um)"),
    "v_p": (lambda rows: rows[V_P], "v_p (m/s)"),
    "contact": (lambda rows: rows[F_C], "F_c (N)"),
    "active": (lambda rows: rows[F_A], "F_a (N)"),
    "total": (lambda rows: rows[F_C], "contact force with damping (N)"),
    "height": (lambda rows: rows[XI_S] * 1e3, "sphere (mm)"),
}
_NO_LAW: tuple[str, ...] = ("controller.law=off",)


@dataclass(frozen=True)
class Curve:
    """What one curve is called, which plate, and the settings of its run."""

    label: str
    settings: tuple[str, ...] = _NO_LAW
    plate: str = "aluminium"


@dataclass(frozen=True)
class Sheet:
    """A picture: title, quantities (a row of panels each), curves; `lasts_s` where a run is shown
    beyond its first contact, `columns` of COLUMNS."""

    title: str
    quantities: tuple[str, ...]
    curves: tuple[Curve, ...]
    lasts_s: float = 0.0
    columns: tuple[str, ...] = tuple(COLUMNS)


def _study(force: str, kappa: float, t_a: int, name: str = "") -> Curve:
    config = optima.Config(force, kappa, t_a)
    return Curve(f"{name or force} ({kappa:g}, {t_a})", config.settings)


def _law(kappa: float, plate: str = "aluminium", v_thr: float = -0.25) -> Curve:
    settings = ("controller.law=slope_threshold", f"controller.kappa={kappa}",
                f"controller.v_thr_m_s={v_thr}")  # fmt: skip
    return Curve(f"kappa {kappa:g}, v_thr {v_thr:g} m/s", settings, plate)


_FREE = Curve("no control")
_FORCES = ("active", "contact", "xi", "v_p")
SHEETS = {
    "4-4-three-plates": Sheet(
        "Fig. 4.4: xi of the three plates", ("xi",),
        tuple(Curve(p, _NO_LAW, p) for p in ("aluminium", "oak", "sylomer")),
        columns=("published",),
    ),
    "5-1-worst-case": Sheet(
        "Fig. 5.1: constant force, kappa 2", _FORCES, (_study("F_a1", 2, 1), _FREE)
    ),
    "5-2-plate": Sheet(
        "Fig. 5.2: the plate under F_a2 and F_a6", ("plate", "active"),
        (_study("F_a2", 1, 1), _study("F_a6", 1, 1), _FREE),
    ),
    "5-3-single-optima": Sheet(
        "Fig. 5.3: single optima", _FORCES,
        (_study("F_a3", 0.8, 11, "F_F"), _study("F_a6", -1.0, 1, "F_sin"), _FREE),
    ),
    "5-4-single-optima": Sheet(
        "Fig. 5.4: single optima", _FORCES,
        (_study("F_a10", -0.4, 1, "F_cos,1"), _study("F_a11", -1.5, 11, "F_cos,2"), _FREE),
    ),
    "5-8-all-round-optima": Sheet(
        "Fig. 5.8 and 5.9: all-round optima", _FORCES,
        (_study("F_a4", 0.4, 12, "F_all,F"), _study("F_a8", 0.4, 18, "F_all,sin"),
         _study("F_a13", -0.4, 6, "F_all,cos"), _FREE),
    ),
    "5-10-law-on-aluminium": Sheet(
        "Fig. 5.10: slope-threshold law on aluminium", _FORCES,
        (_law(0.3), _law(0.5), _law(0.8), _FREE),
    ),
    "5-11-oak": Sheet(
        "Fig. 5.11: oak under the law", ("height", "xi"),
        (_law(0.5, "oak"), _law(0.7, "oak"), Curve("no control", _NO_LAW, "oak")), lasts_s=0.03,
        columns=("published",),
    ),
}  # fmt: skip


def _all_of(number: int, forces: tuple[str, ...]) -> Sheet:
    """All forces of a shape, a few of each sweep."""
    curves = []
    for force in forces:
        t_a = optima.AT_ONE_START.get(force)
        if t_a is None:
            curves += [_study(force, optima.AT_ONE_KAPPA[force], t) for t in (4, 16)]
        else:
            curves += [_study(force, kappa, t_a) for kappa in (1, -0.4)]
    title = f"Fig. B.{number}: forces {' to '.join(dict.fromkeys((forces[0], forces[-1])))}"
    return Sheet(title, ("active",), tuple(curves))


for _i, _forces in enumerate(
    (("F_a1",), *(tuple(f"F_a{i}" for i in range(i, i + 4)) for i in (2, 6, 10))), 1
):
    SHEETS[f"B-{_i}-forces"] = _all_of(_i, _forces)


def _relaxing(plate: str) -> Sheet:
    """The same plate with either damping for one restitution."""
    setup = load(f"thesis-{plate}")
    tau = weaknesses.RELAXATION_S[plate]
    spec = setup.plant
    s_tau = calibrate_relaxation(spec, spec.plate.material.restitution, tau)
    relaxation = (
        "contact.damping=relaxation", f"contact.relaxation_stiffness={s_tau}",
        f"contact.relaxation_s={tau}",
    )  # fmt: skip
    curves = (Curve("viscous", _NO_LAW, plate), Curve("relaxation", (*_NO_LAW, *relaxation), plate))
    return Sheet(f"Fig. 4.2 and 4.3: damping on {plate}", ("height", "total"), curves, 0.02,
                 ("published",))  # fmt: skip


@lru_cache(maxsize=128)
def _run_scene(curve: Curve, column: str, lasts_s: float) -> tuple[Setup, np.ndarray]:
    source, settings = COLUMNS[column]
    lasts = (f"run.duration_s={lasts_s}",) if lasts_s else ()
    setup = load(source.format(curve.plate), [*settings, *curve.settings, *lasts])
    return setup, simulate(setup).truth


def _series(curve: Curve, column: str, lasts_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time since the touch (us) and rows around the first contact, or of the whole run."""
    setup, rows = _run_scene(curve, column, lasts_s)
    impact = first_impact(setup, rows)
    if impact is None:
        raise ValueError(f"{setup.name}: no impact")
    end = rows.shape[1] if lasts_s else min(impact.end + 10, rows.shape[1])
    begin = max(impact.start - 5, 0)
    return (np.arange(begin, end) - impact.start) * setup.step_s * 1e6, rows[:, begin:end]


def _sheet(sheet: Sheet, path: Path) -> Path:
    rows_of_panels = len(sheet.quantities)
    height = 2.4 if rows_of_panels > 1 else 3.6
    figure, axes = pictures.sheet(rows_of_panels, len(sheet.columns), height=height)
    for row, name in enumerate(sheet.quantities):
        value, label = QUANTITIES[name]
        lasts_s = sheet.lasts_s if name == "height" else 0.0
        for column, plant in enumerate(sheet.columns):
            axis = axes[row, column]
            for i, curve in enumerate(sheet.curves):
                t, rows = _series(curve, plant, lasts_s)
                t = t / 1e3 if lasts_s else t
                axis.plot(t, value(rows), **look(i), label=curve.label)
            axis.set(xlabel="time (ms)" if lasts_s else "time (us)", ylabel=label)
            axis.set_title(plant if row == 0 else "")
    axes[0, 0].legend(fontsize=6)
    figure.suptitle(sheet.title)
    return pictures.save(figure, path)


def _damping(plate: str, path: Path) -> Path:
    return _sheet(_relaxing(plate), path)


def _pressure(path: Path) -> Path:
    """Fig. 3.1: bound of the peak pressure over delta = c t0/(pi R), relative to rho0 c v0."""
    delta = np.geomspace(0.05, 20.0, 300)
    radius, speed = 0.02, 1.0
    times = delta * np.pi * radius / noise.SOUND_SPEED_M_S
    bound = [noise.peak_pressure_pa(radius, speed, float(t), radius) for t in times]
    figure, axes = pictures.sheet(1, 1, width=6.0, height=3.6)
    unit = noise.AIR_DENSITY_KG_M3 * noise.SOUND_SPEED_M_S * speed
    axes[0, 0].loglog(delta, np.array(bound) / unit, **look(0))
    for plate, t0 in (("aluminium", 3.5e-5), ("oak", 1.77e-4), ("sylomer", 6.98e-4)):
        at = noise.SOUND_SPEED_M_S * t0 / (np.pi * radius)
        axes[0, 0].axvline(at, color="gray", linewidth=0.8)
        axes[0, 0].annotate(plate, (at, 2e-3), rotation=90, fontsize=7)
    axes[0, 0].set(xlabel="delta = c t0/(pi R)", ylabel="bound at r = R / (rho0 c v0)",
                   title="Fig. 3.1: bound of the peak pressure")  # fmt: skip
    return pictures.save(figure, path)


def _green(path: Path) -> Path:
    """Fig. 4.5: v_p of the three plates and the velocity that a unit impulse gives."""
    figure, axes = pictures.sheet(3, 2, height=2.4)
    for row, plate in enumerate(("aluminium", "oak", "sylomer")):
        curve = Curve(plate, _NO_LAW, plate)
        setup, _ = _run_scene(curve, "published", 0.0)
        t, rows = _series(curve, "published", 0.0)
        axes[row, 0].plot(t, rows[V_P], **look(0))
        axes[row, 0].set(title=f"{plate}: v_p", xlabel="time (us)", ylabel="v_p (m/s)")
        spec = setup.plant
        _, (_, velocity, _) = sampled(
            spec.simply_supported, spec.contact_point_m, setup.step_s, len(t)
        )
        axes[row, 1].plot(np.arange(len(t)) * setup.step_s * 1e6, velocity, **look(1))
        axes[row, 1].set(title="response to a unit impulse", xlabel="time (us)",
                         ylabel="velocity (m/(N s^2))")  # fmt: skip
    figure.suptitle("Fig. 4.5: v_p and g_c (read as the sampled Green's function)")
    return pictures.save(figure, path)


_SPECTRA = (
    ("Fig. 5.5: F_F", (_study("F_a3", 0.8, 11, "F_F"), _FREE), 20e3),
    ("Fig. 5.6: F_sin", (_study("F_a6", -1.0, 1, "F_sin"), _FREE), 20e3),
    ("Fig. 5.7: both beyond", (_study("F_a3", 0.8, 11, "F_F"),
                               _study("F_a6", -1.0, 1, "F_sin"), _FREE), 150e3),
)  # fmt: skip


_BEYOND = 60  # steps


def _spectra(path: Path) -> Path:
    """Fig. 5.5 to 5.7: spectra of the total force on the plate."""
    figure, axes = pictures.sheet(len(_SPECTRA), len(COLUMNS))
    for row, (title, curves, limit_hz) in enumerate(_SPECTRA):
        f = np.linspace(50.0, limit_hz, 500)
        for column, plant in enumerate(COLUMNS):
            for i, curve in enumerate(curves):
                setup, rows = _run_scene(curve, plant, 0.0)
                impact = first_impact(setup, rows)
                assert impact is not None
                # As the study formed them: over the contact. A consistent force may outlast it.
                beyond = _BEYOND if SCHEMES[setup.scheme].conserves else 0
                contact = np.pad(impact.contact_n, (0, beyond))
                force = rows[F_A, impact.start : impact.end + beyond] - contact
                level = np.abs(noise.force_spectrum(force, setup.step_s, f))
                axes[row, column].plot(f / 1e3, 20.0 * np.log10(level), **look(i),
                                       label=curve.label)  # fmt: skip
            axes[row, column].set(title=f"{title}, {plant}", xlabel="frequency (kHz)",
                                  ylabel="|F| (dB re 1 N s)")  # fmt: skip
            axes[row, column].legend(fontsize=6)
    return pictures.save(figure, path)


def _appendix(path: Path) -> Path:
    """Fig. A.1: the readings of F_a,Y, and the contact force without control."""
    figure, axes = pictures.sheet(1, 2, height=3.4)
    for axis, scheme in zip(axes[0], ("thesis2008", "modal"), strict=True):
        contact = appendix.model(scheme).contact_n
        axis.plot(contact, **look(len(appendix.READINGS)), label="F_c without control")
        for i, reading in enumerate(appendix.READINGS):
            axis.plot(appendix.force_n(reading, scheme), **look(i), label=f"F_a,Y, {reading}")
        axis.set(title=f"Fig. A.1, {scheme}, 20 mm", xlabel="time (us)", ylabel="force (N)")
        axis.legend()
    return pictures.save(figure, path)


def draw(
    folder: Path,
    on_progress: Callable[[int], None] = lambda done: None,
    only: tuple[str, ...] | None = None,
) -> list[Path]:
    """All sheets as PNG, or some by their names; the files written."""
    drawn: dict[str, Callable[[Path], Path]] = {
        "3-1-pressure": _pressure, "4-5-green": _green, "5-5-spectra": _spectra,
        "A-1-simplified": _appendix,
    }  # fmt: skip
    for name, sheet in SHEETS.items():
        drawn[name] = partial(_sheet, sheet)
    for plate in weaknesses.MATERIALS:
        drawn[f"4-2-damping-{plate}"] = partial(_damping, plate)
    found = []
    for name in sorted(drawn) if only is None else only:
        found.append(drawn[name](folder / f"published-{name}.png"))
        on_progress(len(found))
    return found


COUNT = len(SHEETS) + 7


_QUICK_SHEETS = ("3-1-pressure",)


@dataclass(frozen=True)
class Contact:
    """The first contact of a plate without control, by one scheme."""

    plate: str
    scheme: str
    contact_time_us: float
    peak_force_n: float
    next_impact_speed_m_s: float


def first_contacts(plates: tuple[str, ...] = PLATES) -> list[Contact]:
    """The first contact on each plate, published and consistent. Raises ValueError without one."""
    found = []
    for plate in plates:
        for source, _ in _pair(plate):
            setup, rows = _run(source, _OFF)
            impact = first_impact(setup, rows)
            if impact is None:
                raise ValueError(f"{source}: no impact")
            noise = impact.noise
            found.append(
                Contact(plate, setup.scheme, 1e6 * noise.contact_time_s,
                        impact.impact.peak_force_n, noise.next_impact_speed_m_s)
            )  # fmt: skip
    return found


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Draw the study's figures again from runs of the published and the consistent scheme.

    With --quick: two of the figures.

    Example: python -m paper.figures --quick
    """
    with results_in(folder, "figures", "modal", "thesis2008") as made:
        found = [penetration(made)] if quick else draw_figures(made)
        only = _QUICK_SHEETS if quick else None
        with progress("sheets", len(only or ()) or COUNT) as advance:
            found += draw(made, advance, only)
        contacts = first_contacts()
        write_records(made / "figures.csv", contacts)
    headings = ("plate", "scheme", "contact time (us)", "peak force (N)", "next impact (m/s)")
    out.print(number_table("First contact without control", headings, (
        (c.plate, c.scheme, f"{c.contact_time_us:.0f}", f"{c.peak_force_n:.4g}",
         f"{c.next_impact_speed_m_s:.3g}") for c in contacts
    ), text=2))  # fmt: skip
    written(made, *(path.name for path in found), "figures.csv")
    published, consistent = (c.contact_time_us for c in contacts[:2])
    conclude(
        f"{len(found)} figures are drawn; the first contact on {PLATES[0]} lasts "
        f"{published:.0f} us in the published scheme and {consistent:.0f} us in the default scheme."
    )


if __name__ == "__main__":
    start("paper.figures")
