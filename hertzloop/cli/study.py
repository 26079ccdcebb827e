"""The commands `hertzloop study ...`: charts over many cases."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hertzloop.cli.options import (
    JsonOption,
    SetOption,
    check_json,
    check_law,
    scene_from,
    write_json,
)
from hertzloop.cli.study_frame import results_in, resumable
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.extras import need
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from hertzloop.studies.latency import Critical


def latency(
    folder: Annotated[
        Path,
        typer.Option(
            "--out-dir", "-o", help="Write charts and numbers into this folder.", metavar="DIR"
        ),
    ],
    scene: Annotated[
        str | None,
        typer.Argument(
            help="A shipped scene's name, or a .toml file; default: the six scenes of the "
            "documentation.",
            metavar="[SCENE]",
            show_default=False,
        ),
    ] = None,
    settings: SetOption = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Compute coarser maps of one scene.")
    ] = False,
    laws: Annotated[
        list[str] | None,
        typer.Option("--law", help="Add your own law to the shipped ones; repeatable."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Map every law's figures over latency, bits and sampling period.

    It also prints how much latency each law tolerates. When killed, it goes on with the same
    command.
    """
    from hertzloop.studies import latency as study

    need("matplotlib")
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
        out.print(f"{name}: {law} tolerates {survives:.0f} us, {buys:.0f} us more than two points")
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

    table = Table(title=f"{scene}: latency and bits that each law tolerates")
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


def real_plant(
    folder: Annotated[
        Path,
        typer.Option(
            "--out-dir", "-o", help="Write picture and numbers into this folder.", metavar="DIR"
        ),
    ],
    quick: Annotated[bool, typer.Option("--quick", help="Use the 3 mm sphere only.")] = False,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="Use only this scene; repeatable.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compare every law in the ideal plant and in a realistic plant.

    In the real plant the contact yields, the plate has a thickness, and actuator and sensor have
    limits.
    """
    from hertzloop.studies import real as study
    from hertzloop.studies.sweeps.pool import SweepFailed

    need("matplotlib")
    check_json(json_file)
    known = [named.name for named in study.SCENES]
    names = tuple(dict.fromkeys(scenes or (known[:2] if quick else known)))
    for name in names:
        if name not in known:
            fail(f"--scene = {name}: unknown scene. Use one of {', '.join(known)}.", 2)
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
