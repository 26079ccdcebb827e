"""Commands that measure: latency map, real plant, validity map, benchmarks."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_folder,
    check_json,
    check_law,
    check_picture,
    compile_first,
    fail,
    make_folder,
    out,
    progress,
    scene_from,
    write_json,
)
from hertzloop.cli.study_frame import results_in, resumable
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from hertzloop.studies.latency import Critical


def latency(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for charts and numbers.")],
    scene: Annotated[
        str | None,
        typer.Argument(
            help="A shipped scene's name, or a .toml file; the six scenes of the documentation if "
            "left out.",
            metavar="[SCENE]",
            show_default=False,
        ),
    ] = None,
    settings: SetOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="One scene's maps, coarser.")] = False,
    laws: Annotated[
        list[str] | None,
        typer.Option("--law", help="A law of your own, beside the shipped ones; several times."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Maps of every figure over latency, bits, sampling, gain; what latency each law survives. When
    killed, it goes on with the same command."""
    from hertzloop.studies import latency as study

    check_json(json_file)
    scenes: Sequence[study.Named] | None = None
    if scene is not None or settings:
        source = scene or DEFAULT
        resolved = scene_from(source, settings, None)
        scenes = (study.Named(resolved.name, source, tuple(settings or ()), "impact"),)
        if resolved.law_reference not in (*study.LAWS, "off", *(laws or [])):
            laws = [resolved.law_reference, *(laws or [])]
    try:
        for law in laws or []:
            check_law(((scenes or study.SCENES)[0].scene()).vary({"controller.law": law}))
    except SceneError as error:
        fail(str(error), 2)
    header = study.header_of(quick, tuple(laws or ()), scenes)
    with (
        results_in(folder, "modal"),
        resumable(folder, "latency", header) as finished,
        progress("latency", 100) as advance,
    ):
        found = study.run(
            folder, quick, lambda done, of: advance(round(100 * done / of)), tuple(laws or ()),
            finished.of, scenes,
        )  # fmt: skip
    for name in dict.fromkeys(c.scene for c in found):
        out.print(_survival_table(name, [c for c in found if c.scene == name]))
    best = list(study.best_laws(found))
    for name, law, survives, buys in best:
        out.print(f"{name}: {law} survives {survives:.0f} us, {buys:.0f} us more than two points")
    out.print(f"written: {folder}/latency-*.png and .csv", soft_wrap=True)
    keys = ("scene", "law", "survives_us", "more_than_two_points_us")
    data = {"critical": [vars(c) for c in found],
            "best": [dict(zip(keys, row, strict=True)) for row in best],
            "ran": finished.ran}  # fmt: skip
    write_json(json_file, data)


def _over_phases(words: str, ends: Iterable[float], digits: str, *names: str) -> str:
    """A number in words with its range over touch phases, where that is another one; `names`: of
    nan and of infinity."""
    least, most = (
        names[0] if math.isnan(x) else names[1] if math.isinf(x) else f"{x:{digits}}" for x in ends
    )
    ranged = least if least == most else f"{least} to {most}"
    return words if ranged == words else f"{words} ({ranged})"


def _survival_table(scene: str, found: "list[Critical]") -> Table:
    """What each law survives in a scene."""
    from hertzloop.studies import words

    table = Table(title=f"{scene}: what each law survives")
    for heading in ("law", "plate energy (dB)", "rebound", "latency (us)", "bits",
                    "bits to 0.5 dB"):  # fmt: skip
        table.add_column(heading, justify="left" if heading == "law" else "right")
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


_WANTED_DB = (0.1, 3.0)  # less than the first is no help


def real(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    quick: Annotated[bool, typer.Option("--quick", help="The 3 mm sphere alone.")] = False,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="One of the scenes alone; several times.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """What each law does in an ideal plant, and where contact, plate, actuator, sensor are real."""
    from hertzloop.studies import real as study
    from hertzloop.studies.sweeps.pool import SweepFailed

    check_json(json_file)
    known = [named.name for named in study.SCENES]
    names = tuple(dict.fromkeys(scenes or (known[:2] if quick else known)))
    for name in names:
        if name not in known:
            fail(f"--scene {name} is none of {', '.join(known)}", 2)
    try:
        with results_in(folder, "modal"), progress("real", 100) as advance:
            found = study.run(folder, names, lambda done, of: advance(round(100 * done / of)))
    except SweepFailed as error:
        fail(str(error), 1)
    for scene in names:
        out.print(_table(scene, [e for e in found if e.scene == scene]))
    for scene in names:
        out.print(f"{scene}, real plant, off the plate at every touch phase:")
        for wanted_db, us in product(_WANTED_DB, study.LATENCIES_US):
            mine = (e for e in found if (e.scene, e.plant) == (scene, "real"))
            laws = [e.law for e in mine if e.takes_off(us, wanted_db)]
            out.print(
                f"  {wanted_db:g} dB or more at {us} us: {', '.join(laws) or 'none'}",
                soft_wrap=True,
            )
    changed = " ".join(f"--set {key}={value}" for key, value in study.REAL.items())
    noise = f"noise of {study.NOISE:g} of the converter's range (noise_rms in real.csv)"
    out.print(
        f"real: {changed}, and {noise}; without contact.plasticity and plate.theory where the "
        "scene's contact has a damper",
        soft_wrap=True,
    )
    out.print(f"written: {folder}/real.png and .csv", soft_wrap=True)
    write_json(json_file, {"effects": [asdict(e) for e in found], "real": study.REAL})


def _critical(e: Any) -> str:
    """A critical latency with its range over touch phases."""

    def one(x: float) -> str:
        return "never" if math.isnan(x) else f"> {e.tried_us:.0f}" if math.isinf(x) else f"{x:.0f}"

    least, most = one(e.least_us), one(e.most_us)
    return least if least == most else f"{least} to {most}"


def _table(scene: str, found: list[Any]) -> Table:
    """Ideal and real plant side by side, a line a law and plant."""
    from hertzloop.studies import words

    table = Table(title=f"{scene}: plate energy (dB), mean (range) over phases")
    for heading in ("law", "plant"):
        table.add_column(heading)
    for latency_us in found[0].energies:
        table.add_column(f"at {latency_us} us", justify="right")
    table.add_column("helps up to (us)", justify="right")
    for heading in ("bits", "to 0.5 dB"):
        table.add_column(heading, justify="right")
    for e in found:
        energies = ["unstable" if math.isnan(s.mean) else str(s) for s in e.energies.values()]
        bits = ("none" if math.isnan(x) else f"{x:.0f}" for x in (e.critical_bits, e.settled_bits))
        table.add_row(words.law(e.law), e.plant, *energies, _critical(e), *bits)
    return table


def validity(
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    seed: SeedOption = None,
    json_file: JsonOption = None,
) -> None:
    """What a scene leaves out, every indicator with its size, threshold and formula."""

    resolved = scene_from(scene, settings, seed)
    check_json(json_file)
    compile_first(resolved)

    from hertzloop.analysis.validity import State, neglected_of_scene
    from hertzloop.views.effects import effects_as_json, show_left_out, table_of

    try:
        neglected = neglected_of_scene(resolved)
    except SceneError as error:
        fail(str(error), 2)
    found = {"stable": neglected.stable, **effects_as_json(neglected)}
    if not neglected.stable:
        out.print("The closed loop is unstable: what else it leaves out would say nothing.")
    elif not found["validity"]:
        out.print("No contact within the run, so nothing is left out of one.")
    else:
        out.print(table_of(found["validity"]))
        show_left_out(out, found["validity"])
        for finding in found["validity"]:
            if finding["state"] == State.NOT_KNOWN:
                out.print(f"Not known: {finding['sentence']}.", soft_wrap=True)
    write_json(json_file, {"scene": resolved.name, **found})


def validity_map(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
) -> None:
    """Which theory and effects matter, over radius and thickness, for a scene's materials."""
    from hertzloop.studies import validity as study

    resolved = scene_from(scene, settings, None)
    make_folder(folder)
    try:
        sizes = study.run(resolved, folder)
    except SceneError as error:
        fail(str(error), 2)
    except OSError as error:
        fail(f"cannot write into {folder}: {error.strerror}", 1)
    for name, size in sizes.items():
        shares = (f"{100.0 * (size > level).mean():.0f} %" for level in (1e-3, 1e-1))
        out.print("{}: above 0.1 % in {} of the map, above 10 % in {}".format(name, *shares))
    out.print(f"written: {folder}/validity.png and .csv", soft_wrap=True)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(validity)


What = Literal["costs", "exchange", "laws", "exported", "cases", "replay"]


def bench(
    what: Annotated[
        What,
        typer.Argument(
            help="costs: steps, exchanges, loop; exchange: ours and others'; laws: one's own; "
            "exported: a plant in a C program; cases: of a sweep; replay: of a recording."
        ),
    ] = "costs",
    picture: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture of `exchange` to draw.")
    ] = None,
    rounds: Annotated[
        int, typer.Option(min=1, help="How often all but `costs` and `exchange` measure each.")
    ] = 7,
    json_file: JsonOption = None,
) -> None:
    """What a plant step, an exchange and the whole loop cost on this machine; what one sample out
    and one force back cost in the fast lane, over the bus, and with other tools; or what a law of
    one's own costs, as a Python file and as a C library, against a shipped one; or what an exported
    plant's step costs in a C program, against the compiled loop; or how many cases of a sweep a
    core runs in a second, and what part of that time is the compiled loop; or how long the way from
    a recording to the viewer takes, and a frame there."""
    check_folder(picture)
    check_json(json_file, picture)
    if picture is not None and what != "exchange":
        fail("--out draws `bench exchange` only", 2)
    if picture is not None:
        check_picture(picture)
    if what == "exchange":
        _exchange(picture, json_file)
    elif what == "laws":
        _laws(rounds, json_file)
    elif what == "exported":
        _exported(rounds, json_file)
    elif what == "cases":
        _cases(rounds, json_file)
    elif what == "replay":
        _replay(rounds, json_file)
    else:
        _costs(json_file)


def _costs(json_file: Path | None) -> None:
    from benchmarks import links as groups
    from benchmarks import roofline
    from hertzloop.bus.port import BusError
    from hertzloop.processes.launcher import RunFailed

    compile_first()
    try:
        data = groups.measure()
        shares = [asdict(share) for share in roofline.shares()]
    except (RunFailed, BusError) as error:
        fail(str(error), 1)
    for title, costs in data.items():
        out.print(_cost_table(title, costs))
    out.print(roofline_table("roofline of the default scheme's step", shares))
    write_json(json_file, {**data, "roofline": shares})


def _exchange(picture: Path | None, json_file: Path | None) -> None:
    from benchmarks import exchange

    found = exchange.measure()
    table = Table("way", "us, median", "us, least", "exchanges/s", "times HELICS")
    for row in found.rows:
        ratio = "" if row.times_helics is None else f"{row.times_helics:.2g}"
        us = f"{row.median_us:.3g}", f"{row.least_us:.3g}"
        table.add_row(row.way, *us, f"{1e6 / row.median_us:,.0f}", ratio)
    out.print(table)
    for way, why in found.left_out.items():
        out.print(f"left out: {way}: {why}", soft_wrap=True, markup=False)
    out.print(found.conditions, soft_wrap=True, markup=False)
    if picture is not None:
        exchange.draw(found, picture)
    write_json(json_file, asdict(found))


def _laws(rounds: int, json_file: Path | None) -> None:
    from benchmarks import laws as study

    with study.own_laws() as laws:
        same = study.same_bytes(laws)
        rates = study.rates(laws, rounds)
    starts = study.starts(rounds)
    table = Table(title=f"{study.LAW} in cases of one core")
    for heading in ("task", "law", "cases/s", "of shipped"):
        table.add_column(heading)
    for row in rates:
        share = f"{row['share']:.2f}"
        table.add_row(row["task"], row["law"], f"{row['cases_per_s']:.0f}", share)
    out.print(table)
    out.print(f"same bytes however it is given: {'yes' if same else 'NO'}")
    out.print(
        f"to the first step: {starts['shipped_s']:.2f} s with the shipped law, "
        f"{starts['new_law_more_s']:+.2f} s with a new one in Python, "
        f"{starts['new_law_whole_more_s']:+.2f} s where what it knows ahead is asked for, too",
        soft_wrap=True,
    )
    write_json(json_file, {"same_bytes": same, "rates": rates, **starts})


def _exported(rounds: int, json_file: Path | None) -> None:
    from benchmarks import exported
    from hertzloop.interop.fmu import NoCompiler
    from hertzloop.interop.objects import CompileFault

    compile_first()
    try:
        rows = exported.measure(("host", "x86-64-v3", "x86-64"), rounds)
    except NoCompiler as error:
        fail(str(error), 2)
    except CompileFault as error:
        fail(str(error), 1)
    table = Table(title="the plant of aluminium-3mm in a C program")
    for heading in ("for", "us/step", "of the loop's speed", "same bytes", "first impact",
                    "whole run", "code, kB", "arrays, kB"):  # fmt: skip
        table.add_column(heading)
    for row in rows:
        table.add_row(
            row.cpu, f"{row.us_a_step:.2f}", f"{row.share:.2f}", "yes" if row.same else "no",
            f"{row.first:.0e}", f"{row.whole:.0e}", f"{row.code_kb:.0f}", f"{row.arrays_kb:.0f}",
        )  # fmt: skip
    out.print(table)
    out.print("first impact, whole run: largest difference of the contact force, of its largest")
    write_json(json_file, {"exported": [asdict(row) for row in rows]})


def _cases(rounds: int, json_file: Path | None) -> None:
    from benchmarks import cases

    compile_first()
    rows = cases.measure(rounds)
    table = Table(title="cases of a sweep, of one core")
    for heading in ("sweep", "cases/s", "ms a case", "in the loop, ms", "share"):
        table.add_column(heading, justify="left" if heading == "sweep" else "right")
    for row in rows:
        table.add_row(
            row.sweep, f"{1e3 / row.case_ms:.0f}", f"{row.case_ms:.3f}", f"{row.loop_ms:.3f}",
            f"{row.loop_ms / row.case_ms:.0%}",
        )  # fmt: skip
    out.print(table)
    write_json(json_file, {"cases": [asdict(row) for row in rows]})


def _replay(rounds: int, json_file: Path | None) -> None:
    from benchmarks import exported as replay

    compile_first()
    found = replay.measure_replay(rounds)
    table = Table(title=f"replay of {found.steps:,} steps")
    for heading in ("case", "median", "least"):
        table.add_column(heading, justify="left" if heading == "case" else "right")
    for row in found.cases:
        table.add_row(row.case, f"{row.median:.3g}", f"{row.least:.3g}")
    out.print(table)
    out.print(f"the file has {found.megabytes:.1f} MB")
    if found.no_frames:
        out.print(f"frames not measured: {found.no_frames}", soft_wrap=True, markup=False)
    write_json(json_file, {"replay": asdict(found)})


def _cost_table(title: str, costs: list[dict[str, Any]]) -> Table:
    """Measured costs of a group; the first case is the yardstick."""
    table = Table(title=title)
    table.add_column("case")
    for heading in ("median", "least", "ratio"):
        table.add_column(heading, justify="right")
    for cost in costs:
        figures = (f"{cost[key]:.3g}" for key in ("median_us", "least_us", "ratio"))
        table.add_row(cost["case"], *figures)
    return table


def roofline_table(title: str, shares: list[dict[str, Any]]) -> Table:
    """What the parts of a step reach of the processor's peaks; rows of `benchmarks.roofline`."""
    table = Table(title=title)
    table.add_column("case")
    for heading in ("modes", "floor us", "pass us", "share", "step us", "share", "loops"):
        table.add_column(heading, justify="right")
    for share in shares:
        floor, alone, step = (share[key] for key in ("floor_us", "pass_us", "step_us"))
        case = share["case"].rsplit(", ", 1)[0]
        table.add_row(
            case, str(share["frequencies"]), f"{floor:.3f}", f"{alone:.3f}",
            f"{floor / alone:.0%}", f"{step:.3f}", f"{floor / step:.0%}",
            f"{share['of_two_pass']:.2f}",
        )  # fmt: skip
    rates = [share["gigabytes_s"] for share in shares]
    table.caption = (
        f"peaks: {shares[0]['gigaoperations_s']:.1f} G multiply-adds/s, {min(rates):.0f} to "
        f"{max(rates):.0f} GB/s; share: of the floor; loops: step in two-pass loops over 1104"
    )
    return table
