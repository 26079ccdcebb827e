"""The command that charts what latency, bits and gain do to every law."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from controller.loading.registry import shipped as shipped_laws
from hertzloop.commands.options import (
    JsonOption,
    SetOption,
    check_json,
    check_law,
    scene_from,
    write_json,
)
from hertzloop.commands.study_frame import results_in, resumable
from hertzloop.commands.terminal import fail, out, progress
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from studies.latency import Critical


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
    from studies import latency as study

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
    from studies import words

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
