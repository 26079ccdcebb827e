"""How much latency, how few bits, how slow a sampler and how much chance a law survives.

"Survives": takes energy off the plate, against the same impact without control. Critical values
are read off by scanning and bisection, to one step of latency.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    SetOption,
    check_json,
    conclude,
    fail,
    number_table,
    out,
    progress,
    results_in,
    start,
    write_json,
    write_records,
    written,
)
from hertzloop.cli.many_cases import resumable
from hertzloop.cli.prepare import check_law, scene_from
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.results.cases import CASE_METRICS, Span, metrics_of_case
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup, load
from hertzloop.studies import pictures, words
from hertzloop.studies.sweeps.design import KEY as PHASE
from hertzloop.studies.sweeps.design import Design, phases, spread_of
from hertzloop.studies.sweeps.evaluate import Pool, Rows, evaluate
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.sweeps.sweep import work_of
from hertzloop.studies.tuning import LAWS
from hertzloop.studies.words import METRICS, write_rows

_BITS = tuple(range(3, 19))
_WITHIN_DB = 0.5
KAPPA = "controller.kappa"
_CHANCE_COLUMNS = (
    "controller.law", "run.seed", "controller.jitter_us", "controller.drop_out_probability",
    "plate_energy_db", "rebound_percent",
)  # fmt: skip
_SEEDS = tuple(range(1, 21))
Energies = Callable[[list[dict[str, Any]]], list[float]]  # of cases, dB; inf: unstable


@dataclass(frozen=True)
class Named:
    """A scene of the tables: its settings, and what its metrics are taken over."""

    name: str
    source: str
    settings: tuple[str, ...]
    span: Span

    @property
    def stem(self) -> str:
        """What files are called after it."""
        return Path(self.source).stem

    def scene(self) -> Setup:
        """The scene, with an ideal line."""
        return load(self.source, [*self.settings, "sensors.bits=ideal"])


# As long as the sphere needs to leave for good, or as the first impact; feedback acts for as long
# as the plate moves, here 0.6 ms.
_SHORT = "run.duration_s=0.0016"
SCENES = (
    Named("aluminium-3mm", "aluminium-3mm", (_SHORT,), "impact"),
    Named("aluminium-3mm, early", "aluminium-3mm", (_SHORT, "controller.v_thr_m_s=-0.6"), "impact"),
    Named("aluminium-20mm", "aluminium-20mm", ("run.duration_s=0.014",), "run"),
    Named("oak-20mm", "oak-20mm", ("run.duration_s=0.02",), "run"),
    Named("offcentre-6mm", "offcentre-6mm", (_SHORT,), "impact"),
    Named("sylomer-20mm", "sylomer-20mm", (), "run"),
)


@dataclass(frozen=True)
class Critical:
    """What a law survives in a scene, alone and one at a time.

    `ideal_db`: plate energy at no latency with an ideal converter; `critical_latency_us`: the
    largest latency up to which it is below that without control, nan if it never is, inf if it
    still is at the largest latency tried, `most_latency_us`; `critical_bits`: fewest bits from
    which on every finer converter takes energy off the plate (nan: none does);
    `settled_bits`: the same for plate energies within 0.5 dB of the ideal converter's. All that at
    a touch in the middle of a step; `mean_db`, `least_db`, `most_db`: of the ideal one over touch
    phases, `least_latency_us`, `most_survived_us`: range of the critical latency over them.
    """

    scene: str
    law: str
    kappa: float
    ideal_db: float
    ideal_rebound_percent: float
    critical_latency_us: float
    most_latency_us: float
    critical_bits: float
    settled_bits: float
    mean_db: float
    least_db: float
    most_db: float
    least_latency_us: float
    most_survived_us: float


def rigid_time_us(scene: Setup) -> float:
    """Contact time on a rigid plate, us: the scale of a scene's latencies."""
    spec = scene.plant
    seconds = rigid_contact_time_s(
        spec.sphere.mass_kg, spec.contact.stiffness, spec.sphere.impact_speed_m_s
    )
    return 1e6 * seconds


def latencies_of(scene: Setup, count: int) -> list[int]:
    """Whole latencies from 0 to twice the contact time on a rigid plate, or 1.2 times that on the
    scene's, but less than half the run; us."""
    most = max(2.0 * rigid_time_us(scene), 1.2 * _contact_us(scene))
    most = min(most, 0.45e6 * (scene.duration_s - scene.lead_in_s))
    step = max(1, math.ceil(most / count))
    return [i * step for i in range(count + 1)]


@lru_cache(maxsize=16)
def _contact_us(scene: Setup) -> float:
    return metrics_of_case(scene.without_control()).contact_us


def law_values(law: str, settings: Sequence[str] = ()) -> dict[str, Any]:
    """Feedback of velocity is tried at half the gain, unless `settings` name one: at 0.8 of the
    plate's impedance it is unstable without latency."""
    values: dict[str, Any] = {"controller.law": law}
    given = any(setting.partition("=")[0].strip() == KAPPA for setting in settings)
    return values | {KAPPA: 0.4} if law.endswith("feedback") and not given else values


def _first_failure(better: list[bool]) -> int:
    """Index of the first value that is not better; the length if all are."""
    return better.index(False) if False in better else len(better)


def _fewest_bits(good: list[bool]) -> float:
    """Fewest of _BITS from which on all are good."""
    last_bad = max((i for i, ok in enumerate(good) if not ok), default=-1)
    return float(_BITS[last_bad + 1]) if last_bad + 1 < len(_BITS) else math.nan


def bits_needed(energies: Energies) -> tuple[float, float]:
    """Fewest bits from which on every finer converter takes energy off the plate, and from which on
    the plate energy stays within 0.5 dB of the ideal one's; nan if none does."""
    ideal, *coarse = energies([{"sensors.bits": bits} for bits in ("ideal", *_BITS)])
    helps = [db < 0.0 for db in coarse]
    return _fewest_bits(helps), _fewest_bits([abs(db - ideal) <= _WITHIN_DB for db in coarse])


def survived_us(energies: Energies, latencies: list[int]) -> tuple[list[float], float]:
    """Plate energies (dB) at some latencies, and the largest latency up to which they are below 0,
    to 1 us: nan if none is, inf if all are."""
    scan = energies([{"controller.latency_us": latency} for latency in latencies])
    at = _first_failure([db < 0.0 for db in scan])
    if at == 0:
        return scan, math.nan
    if at == len(latencies):
        return scan, math.inf
    low, high = latencies[at - 1], latencies[at]
    while high - low > 1:
        middle = (low + high) // 2
        if energies([{"controller.latency_us": middle}])[0] < 0.0:
            low = middle
        else:
            high = middle
    return scan, float(low)


def critical(pool: Pool, named: Named, law: str, points: int) -> Critical:
    """Critical latency and bits of one law in one scene."""
    scene, base = named.scene(), law_values(law, named.settings)
    latencies = latencies_of(scene, points)

    def energies(cases: list[dict[str, Any]]) -> list[float]:
        rows = evaluate(pool, scene, named.span, [base | case for case in cases])
        # A loop that is unstable has no metrics; it is worse than none.
        return [math.inf if row["status"] else float(row["plate_energy_db"]) for row in rows]

    scan, survived = survived_us(energies, latencies)
    ranged = over_phases(energies, survived, latencies[-1])
    critical_bits, settled_bits = bits_needed(energies)
    ideal = evaluate(pool, scene, named.span, [base])[0]
    return Critical(
        scene=named.name,
        law=law,
        kappa=getattr(scene.vary(base).scene.controller.keys, "kappa", math.nan),
        ideal_db=scan[0],
        ideal_rebound_percent=math.nan if ideal["status"] else ideal["rebound_percent"],
        critical_latency_us=survived,
        most_latency_us=float(latencies[-1]),
        critical_bits=critical_bits,
        settled_bits=settled_bits,
        **ranged,
    )


def over_phases(energies: Energies, middle_us: float, most_us: int) -> dict[str, float]:
    """Range of a critical latency over touch phases, from that at a touch in the middle of a step;
    plate energies (dB) without latency. A phase moves it by a step or so, so each is followed from
    there."""
    found = []
    for phase in phases():

        def helps(latency_us: int, phase: float = phase) -> bool:
            return energies([{"controller.latency_us": latency_us, PHASE: phase}])[0] < 0.0

        at = most_us if middle_us == math.inf else -1 if math.isnan(middle_us) else round(middle_us)
        if at >= 0 and not helps(at):
            while at >= 0 and not helps(at):
                at -= 1
        else:
            while at < most_us and helps(at + 1):
                at += 1
        found.append(math.inf if at >= most_us else -1.0 if at < 0 else float(at))
    ideal = spread_of(energies([{"controller.latency_us": 0, PHASE: p} for p in phases()]))
    least, most = (math.nan if us < 0.0 else us for us in (min(found), max(found)))
    return {
        "mean_db": ideal.mean, "least_db": ideal.least, "most_db": ideal.most,
        "least_latency_us": least, "most_survived_us": most,
    }  # fmt: skip


def best_laws(found: list[Critical]) -> Iterator[tuple[str, str, float, float]]:
    """Scene, the law that survives most latency there, how much (us), and what it buys over the
    two-point law (one that never helps counts as 0)."""
    for name in dict.fromkeys(c.scene for c in found):
        mine = [c for c in found if c.scene == name]

        def survives(c: Critical) -> float:
            us = c.critical_latency_us
            return 0.0 if math.isnan(us) else min(us, c.most_latency_us)

        best = max(mine, key=lambda c: (survives(c), -c.ideal_db))
        two_point = next(c for c in mine if c.law == "slope_threshold")
        yield name, best.law, survives(best), survives(best) - survives(two_point)


def map_axes(scene: Setup, count: int) -> dict[str, list[Any]]:
    """What is mapped against the latency: key and values."""
    axes = {
        "sensors.bits": list(_BITS),
        "sensors.every_steps": [1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20],
        KAPPA: [round(x, 3) for x in np.linspace(0.0, 2.0, count)],
        "controller.v_thr_m_s": [round(x, 3) for x in np.linspace(-0.95, 0.0, count)],
    }
    own = vars(scene.scene.controller.keys)  # a law need not have all of these
    return {
        key: values
        for key, values in axes.items()
        if key.startswith("sensors.") or key.partition(".")[2] in own
    }


def maps(pool: Pool, named: Named, count: int) -> dict[str, Rows]:
    """Rows of every map of a scene, latency slowest."""
    scene = named.scene()
    found = {}
    for key, values in map_axes(scene, count).items():
        cases = [
            {"controller.latency_us": latency, key: value}
            for latency in latencies_of(scene, count)
            for value in values
        ]
        found[key] = evaluate(pool, scene, named.span, cases)
    return found


def chance(pool: Pool, named: Named, laws: tuple[str, ...]) -> Rows:
    """Plate energy over jitter and drop-outs, for many seeds and some laws."""
    scene = named.scene()
    most = max(1, round(rigid_time_us(scene)))
    cases: list[dict[str, Any]] = []
    for law in laws:
        for seed in _SEEDS:
            both = law_values(law, named.settings) | {"run.seed": seed}
            cases += [
                both | {"controller.jitter_us": round(share * most)}
                for share in np.linspace(0.0, 0.6, 13)
            ]
            cases += [
                both | {"controller.drop_out_probability": float(round(p, 3))}
                for p in np.linspace(0.0, 0.9, 13)
            ]
    return evaluate(pool, scene, named.span, cases)


def header_of(
    quick: bool, more_laws: tuple[str, ...], scenes: Sequence[Named] | None = None
) -> dict[str, Any]:
    """What decides the cases of the study, and what comes of them."""
    scenes = scenes or SCENES
    found = [named.scene() for named in scenes]
    settings = [named.settings for named in scenes]
    return work_of(found, more_laws, Design(())) | {"quick": quick, "settings": settings}


def run(
    folder: Path,
    quick: bool,
    on_progress: Callable[[int, int], None] = lambda done, of: None,
    more_laws: tuple[str, ...] = (),
    through: Callable[[Pool], Pool] = lambda pool: pool,
    scenes: Sequence[Named] | None = None,
) -> list[Critical]:
    """Measure all, write pictures and CSV files; the table of critical values, also of
    `more_laws`. `through`: what stands between the study and the processes that run its cases;
    `scenes`: those of the documentation if left out."""
    scenes = scenes or SCENES
    tabled = (*LAWS, *more_laws)
    count = 15 if quick else 30
    mapped = scenes[:1] if quick else scenes[:3:2]
    steps, done = len(mapped) + 1 + len(scenes) * len(tabled), 0
    found = []
    with local_pool() as cores:
        pool = through(cores)
        for named in mapped:
            rows = maps(pool, named, count)
            for key, some in rows.items():
                name = f"latency-{named.stem}-{key.split('.')[1]}.csv"
                write_rows(folder / name, list(some[0]), (list(row.values()) for row in some))
            draw_maps(folder / f"latency-{named.stem}.png", named.name, rows, _CHANGES)
            done += 1
            on_progress(done, steps)
        early = scenes[min(1, len(scenes) - 1)]
        laws = ("slope_threshold", "predicted", "force_feedback")
        rows_of_chance = chance(pool, early, laws)
        write_rows(
            folder / "latency-chance.csv",
            _CHANCE_COLUMNS,
            ([row.get(key, 0) for key in _CHANCE_COLUMNS] for row in rows_of_chance),
        )
        draw_chance(folder / "latency-chance.png", early.name, rows_of_chance, laws)
        done += 1
        on_progress(done, steps)
        for named in scenes:
            for law in tabled:
                found.append(critical(pool, named, law, 20 if quick else 40))
                done += 1
                on_progress(done, steps)
    write_records(folder / "latency-critical.csv", found)
    return found


_CHANGES = {
    name: words for name, words in METRICS.items() if CASE_METRICS[name].unit in ("dB", "%")
}
_EMPTY = {"rebound_percent": 1.0}  # a row that changes by less is left out; else by 0.05 dB
_LEAST_DB = 0.05
_COLOURS = "RdBu_r"
_UNSTABLE = "#b8b8b8"
_LINE = "as without control"
_LEVELS = 16  # an even number: the band in the middle is around zero, and white
_FLAT = 0.02  # of a scale: less than this has no line


def draw_maps(
    path: Path, title: str, maps: dict[str, list[dict[str, Any]]], metrics: dict[str, str]
) -> None:
    """A row a metric with one scale, zero in its middle; a column a map. Rows that show nothing are
    left out, and named."""
    grids = {metric: [_grid(rows, key, metric) for key, rows in maps.items()] for metric in metrics}
    reaches = {metric: _reach(found) for metric, found in grids.items()}
    kept = [f for f in metrics if reaches[f] >= _EMPTY.get(f, _LEAST_DB)]
    dropped = [metrics[f].partition(" (")[0] for f in metrics if f not in kept]
    sheet, axes = pictures.sheet(max(1, len(kept)), len(maps), width=13.0, height=2.3)
    for line, metric in enumerate(kept):
        reach = pictures.round_above(reaches[metric])
        for column, (key, found) in enumerate(zip(maps, grids[metric], strict=True)):
            ax = axes[line, column]
            shown = _draw_map(ax, *found, reach)
            ax.set_ylabel(words.AXES[key])
            if key == "sensors.bits":
                ax.yaxis.set_major_locator(MaxNLocator(integer=True))
            if line == len(kept) - 1:
                ax.set_xlabel(words.AXES["controller.latency_us"])
        unit = "points" if metric == "rebound_percent" else "dB"
        name = metrics[metric].partition(" (")[0]
        bar = sheet.colorbar(
            shown, ax=list(axes[line]), label=f"{name}:\nchange ({unit})",
            ticks=np.linspace(-reach, reach, 5), aspect=12, pad=0.01,
        )  # fmt: skip
        bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value:+g}" if value else "0")
    left_out = f"\nNot shown, as hardly changed: {', '.join(dropped)}" if dropped else ""
    sheet.suptitle(f"{title}: change against no control. Blue: less{left_out}")
    known: list[Any] = [Line2D([], [], color="black", linestyle="--", label=_LINE)]
    if any(np.isnan(z).any() for found in grids.values() for _, _, z in found):
        known.append(Patch(color=_UNSTABLE, label="unstable"))
    sheet.legend(handles=known, loc="outside upper right", ncols=len(known))
    pictures.save(sheet, path)


def _grid(rows: list[dict[str, Any]], key: str, metric: str) -> tuple[list[Any], list[Any], Any]:
    """Latencies, values of the key, and the metric's change, (values, latencies); nan: unstable."""
    latencies = sorted({row["controller.latency_us"] for row in rows})
    values = sorted({row[key] for row in rows})
    z = np.array([np.nan if row[metric] is None else row[metric] for row in rows], float)
    z = z.reshape(len(latencies), len(values)).T - CASE_METRICS[metric].without
    return latencies, values, z


def _reach(found: list[tuple[list[Any], list[Any], Any]]) -> float:
    """Largest change of a row, without the last 2 % of a map's cases: the map in the middle counts,
    as one gain may drown all else."""
    sizes = [np.abs(z[np.isfinite(z)]) for _, _, z in found]
    reaches = [float(np.percentile(size, 98)) for size in sizes if len(size)]
    return float(np.median(reaches)) if reaches else 0.0


def _draw_map(ax: Any, latencies: list[Any], values: list[Any], z: Any, reach: float) -> Any:
    ax.set_facecolor(_UNSTABLE)
    levels = np.linspace(-reach, reach, _LEVELS)
    shown = ax.contourf(latencies, values, z, levels, cmap=_COLOURS, extend="both")
    ax.grid(False)
    if np.nanmin(z) < -_FLAT * reach and np.nanmax(z) > _FLAT * reach:
        ax.contour(latencies, values, z, [0.0], colors="black", linestyles="--")
    return shown


def draw_chance(path: Path, title: str, rows: list[dict[str, Any]], laws: tuple[str, ...]) -> None:
    """Median and 5 to 95 % of the seeds over jitter and over the share of lost commands."""
    sheet, axes = pictures.sheet(1, 2, width=10.0, height=3.6)
    for ax, key in (
        (axes[0, 0], "controller.jitter_us"),
        (axes[0, 1], "controller.drop_out_probability"),
    ):
        for i, law in enumerate(laws):
            mine = [row for row in rows if key in row and row["controller.law"] == law]
            places = sorted({row[key] for row in mine})
            spread = [[row["plate_energy_db"] for row in mine if row[key] == x] for x in places]
            low, middle, high = np.percentile(np.array(spread), [5, 50, 95], axis=1)
            look = pictures.look(i)
            ax.plot(places, middle, label=words.law(law), **look)
            ax.fill_between(places, low, high, color=look["color"], alpha=0.2)
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set(xlabel=words.AXES[key], ylabel=words.against_none("plate_energy_db"))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    sheet.suptitle(f"{title}: median, and 5 to 95 % of 20 seeds")
    pictures.save(sheet, path)


def _over_phases(words: str, ends: Iterable[float], digits: str, *names: str) -> str:
    """A number in words with its range over touch phases, where that is another one; `names`: of
    nan and of infinity."""
    least, most = (
        names[0] if math.isnan(x) else names[1] if math.isinf(x) else f"{x:{digits}}" for x in ends
    )
    ranged = least if least == most else f"{least} to {most}"
    return words if ranged == words else f"{words} ({ranged})"


def _survival_table(scene: str, found: list[Critical]) -> Any:
    """What each law tolerates in a scene."""
    headings = ("law", "plate energy (dB)", "rebound", "latency (us)", "bits", "bits to 0.5 dB")
    table = number_table(f"{scene}: latency and bits that each law tolerates", headings, (), text=1)
    for c in found:
        us, rebound = c.critical_latency_us, c.ideal_rebound_percent
        energy = "unstable" if c.ideal_db == math.inf else f"{c.ideal_db:.2f}"
        survives = "never" if math.isnan(us) else f"{us:.0f}"
        if us == math.inf:
            survives = f"> {c.most_latency_us:.0f}"
        law = words.law(c.law) if c.law in shipped_laws() else Path(c.law).name
        table.add_row(
            law + ("" if math.isnan(c.kappa) else f", kappa {c.kappa:g}"),
            _over_phases(energy, (c.least_db, c.most_db), ".2f", "unstable", "unstable"),
            "" if math.isnan(rebound) else f"{rebound:.0f} %",
            _over_phases(
                survives, (c.least_latency_us, c.most_survived_us), ".0f", "never",
                f"> {c.most_latency_us:.0f}",
            ),
            *("none" if math.isnan(x) else f"{x:.0f}" for x in (c.critical_bits, c.settled_bits)),
        )  # fmt: skip
    table.caption = "in brackets: least to most over touch phases"
    return table


def main(
    scene: Annotated[
        str | None,
        typer.Argument(
            help="A shipped scene's name, or a .toml file; default: the six scenes of the "
            "documentation.",
            metavar="[SCENE]",
            show_default=False,
        ),
    ] = None,
    folder: OutDirOption = None,
    settings: SetOption = None,
    quick: QuickOption = False,
    laws: Annotated[
        list[str] | None,
        typer.Option("--law", help="Add your own law to the shipped ones; repeatable."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Map every law's metrics over latency, bits and sampling period.

    It also prints how much latency each law tolerates. When killed, it goes on with the same
    command. With --quick there is one scene, and the maps are coarser.

    Example: python -m benchmarks.latency aluminium-3mm --quick
    """
    check_json(json_file)
    scenes: Sequence[Named] = SCENES[:1] if quick else SCENES
    if scene is not None or settings:
        source = scene or DEFAULT
        resolved = scene_from(source, settings, None)
        scenes = (Named(resolved.name, source, tuple(settings or ()), "impact"),)
        if resolved.law_reference not in (*LAWS, "off", *(laws or [])):
            laws = [resolved.law_reference, *(laws or [])]
    try:
        for law in laws or []:
            check_law((scenes[0].scene()).vary({"controller.law": law}))
    except SceneError as error:
        fail(str(error), 2)
    header = header_of(quick, tuple(laws or ()), scenes)
    with (
        results_in(folder, "latency", "modal") as made,
        resumable(made, "latency", header) as finished,
        progress("latency", 100) as advance,
    ):
        found = run(
            made, quick, lambda done, of: advance(round(100 * done / of)), tuple(laws or ()),
            finished.of, scenes,
        )  # fmt: skip
    for name in dict.fromkeys(c.scene for c in found):
        out.print(_survival_table(name, [c for c in found if c.scene == name]))
    best = list(best_laws(found))
    keys = ("scene", "law", "survives_us", "more_than_two_points_us")
    data = {"critical": [vars(c) for c in found],
            "best": [dict(zip(keys, row, strict=True)) for row in best],
            "ran": finished.ran}  # fmt: skip
    written(made, "latency-*.png", "latency-*.csv")
    conclude("; ".join(
        f"in {name} {law} tolerates most latency, {survives:.0f} us, {buys:.0f} us more than "
        "slope_threshold" for name, law, survives, buys in best
    ).capitalize() + ".")  # fmt: skip
    write_json(json_file, data)


if __name__ == "__main__":
    start("benchmarks.latency")
