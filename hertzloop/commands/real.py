"""The command `chart real`: what the laws do in an ideal plant and in a real one."""

import math
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.commands.options import JsonOption, check_json, write_json
from hertzloop.commands.study_frame import results_in
from hertzloop.commands.terminal import fail, out, progress
from hertzloop.views.format import Table

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
    from studies import real as study
    from studies.sweeps.pool import SweepFailed

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
    from studies import words

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
