"""The command `chart plate-models`: what a plate's theory and the modes left out cost."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.study_frame import numbers, results_in
from hertzloop.commands.terminal import out


def plate_models(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the numbers.")],
) -> None:
    """What thickness does to an impact, what the modes left out cost, and what both models take."""
    from studies import plate_models as tail
    from studies import plate_models as theory
    from studies.plate_models import shown
    from studies.words import write_records

    with results_in(folder, "modal"):
        effects, errors, costs = theory.effects(), tail.errors(), tail.cost()
        write_records(folder / "plate_theory.csv", effects)
        write_records(folder / "plate_tail.csv", errors)
    out.print(numbers(
        "Three dimensions against Kirchhoff: changes, the most expected, modes, us a step",
        ("impact", "kh", "lambda", "energy", "rebound", "peak", "time", "most",
         "modes", "3-D", "us", "times"),
        ((e.case, f"{e.k_h:.2f}", f"{e.inelasticity:.2g}", shown(e.plate_energy), shown(e.rebound),
          shown(e.peak_force), shown(e.contact_time), f"{e.expected:.1e}", str(e.frequencies),
          str(e.frequencies_3d), f"{e.step_us:.3g}", f"{e.times_as_long:.2f}") for e in effects),
    ))  # fmt: skip
    out.print(numbers(
        "Modes left out: error of plate energy (of rebound)",
        ("impact", "limit kHz", "spring", "damped mode", "it took"),
        ((t.case, f"{t.limit_khz:g}", f"{shown(t.spring_energy)} ({shown(t.spring_rebound)})",
          f"{shown(t.damped_energy)} ({shown(t.damped_rebound)})", f"{t.tail_share:.1e}")
         for t in errors),
    ))  # fmt: skip
    for name, step_us, ratio in costs:
        out.print(f"{name}: a step of {step_us:.3g} us takes {ratio:.3f} times as long")
    residual = max(*(e.residual for e in effects), *(t.residual for t in errors))
    out.print(f"books of energy and momentum: {residual:.1e} at most")
    out.print(f"written: {folder}/plate_theory.csv and plate_tail.csv", soft_wrap=True)
