"""The commands `published ...`: what the study holds beside its tables B.1 to B.17."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.commands.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    check_json,
    compile_first,
    make_folder,
    scene_from,
    write_json,
)
from hertzloop.commands.terminal import fail, out, progress
from hertzloop.scenes.errors import SceneError
from hertzloop.views.format import Table

# What no program can find in the study, and why.
LEFT_OUT = (
    "table 5.6, which figure its last column names: cannot be assigned to rows",
    "table 5.3, vnext 8 % for F_a6 (-1.0): the appendix and table 5.7 say 28 %; 8 % is reb",
    "table A.1, how the optimum is taken and brought back into time: not printed; of figure A.1 "
    "only the axis is left",
    "Heitkaemper's approximation of radiated energy (appendix C.1): no formula is printed",
)

OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="Folder for the numbers as CSV.")
]


def _ready(*schemes: str) -> None:
    from hertzloop.processes.warmup import of_scheme

    for scheme in schemes:
        compile_first(of_scheme(scheme))


def _columns(title: str, headings: list[str], text: int) -> Table:
    """A table whose first `text` columns are words."""
    table = Table(title=title)
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="left" if i < text else "right")
    return table


def optima(folder: OutOption = None, json_file: JsonOption = None) -> None:
    """Tables 5.3 to 5.7 searched again over the study's grid of 184 forces, in three plants."""
    from studies.published import optima as study
    from studies.words import write_records

    check_json(json_file)
    if folder:
        make_folder(folder)
    _ready("thesis2008", "modal")
    configs = study.grid()
    with progress("optima", len(configs) * len(study.PLANTS)) as advance:
        found = study.compute(configs, study.PLANTS, advance)
    best, rows = study.optima(configs, found), study.listed(configs, found)
    for plant in dict.fromkeys(b.plant for b in best):
        table = _columns(
            f"Optima of the grid: published numerics against {plant}",
            ["figure", "best as published", "best there", "value", "value", "rank there", "corr."],
            3,
        )
        for b in (b for b in best if b.plant == plant):
            table.add_row(
                b.figure, b.best_published, b.best_here, f"{b.value_published:.2f}",
                f"{b.value_here:.2f}", f"{b.rank_here} of {b.of}", f"{b.rank_correlation:+.2f}",
            )  # fmt: skip
        out.print(table)
    table = _columns(
        "Published optima, computed again (published numerics)",
        ["table", "force (kappa, t_a)", "optimum of the grid", "published", "off by"], 3,
    )  # fmt: skip
    for r in rows:
        what = r.what if r.published == r.published else ""
        numbers = (f"{x:.2f}" if x == x else "" for x in (r.published, r.difference))
        table.add_row(f"{r.table} {what}", r.config, r.best, *numbers)
    out.print(table)
    for reason in LEFT_OUT:
        out.print(f"cannot be reproduced: {reason}", soft_wrap=True)
    if folder:
        write_records(folder / "optima.csv", best)
        write_records(folder / "optima-published.csv", rows)
        out.print(f"written: {folder}/optima.csv and optima-published.csv", soft_wrap=True)
    data = {"optima": [asdict(b) for b in best], "published": [asdict(r) for r in rows]}
    write_json(json_file, data | {"not_reproducible": list(LEFT_OUT)})


def a1(
    folder: OutOption = None,
    scheme: Annotated[str, typer.Option(help="thesis2008 or modal.")] = "thesis2008",
    json_file: JsonOption = None,
) -> None:
    """Table A.1, the force of a simplified model, by each reading of its incomplete formula."""
    from studies.published import appendix, tables

    if scheme not in ("thesis2008", "modal"):
        fail(f"--scheme {scheme} is neither thesis2008 nor modal", 2)
    check_json(json_file)
    if folder:
        make_folder(folder)
    _ready(scheme)
    data: dict[str, Any] = {}
    for reading, words in appendix.READINGS.items():
        rows = appendix.computed(reading, scheme)
        data[reading] = {"rows": rows, "agreement": [asdict(a) for a in tables.agreement(rows)]}
        out.print(f"{reading}: {words}", soft_wrap=True)
        if folder:
            name = reading.replace(", ", "-")
            tables.write_table(folder / f"table_a1-{name}.csv", list(rows[0]), rows)
    table = _columns(
        f"Table A.1 by {scheme}: differences, median and worst of 8 rows", ["figure", *data], 1
    )
    for i, figure in enumerate(tables.FIGURES):
        found = [each["agreement"][i] for each in data.values()]
        unit = tables.UNITS.get(figure, "dB")
        table.add_row(
            f"{figure} ({unit})", *(f"{a['median']:.2f}, {a['worst']:.2f}" for a in found)
        )
    out.print(table)
    out.print(f"cannot be reproduced: {LEFT_OUT[2]}", soft_wrap=True)
    write_json(json_file, {"scheme": scheme, **data})


def equations(
    scene: SceneArgument = "aluminium-3mm", settings: SetOption = None, json_file: JsonOption = None
) -> None:
    """Equations 3.1, 3.3, 3.8b and the limits of 3.13 for a scene's first impact, no control."""
    from studies.published import appendix as study

    resolved = scene_from(scene, settings, None)
    check_json(json_file)
    _ready(resolved.scheme)
    try:
        found = study.lines(resolved)
    except (SceneError, ValueError) as error:
        fail(str(error), 2)
    table = _columns(f"{resolved.name}, first impact without control",
                     ["equation", "what", "value", "unit"], 2)  # fmt: skip
    for line in found:
        table.add_row(line.equation, line.what, f"{line.value:.4g}", line.unit)
    out.print(table)
    write_json(json_file, {"lines": [asdict(line) for line in found]})


def register(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="What the published study holds, again.", no_args_is_help=True)
    for command in (optima, a1, equations):
        group.command()(command)
    app.add_typer(group, name="published")
