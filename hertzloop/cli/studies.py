"""Commands that run a study; each loads what it needs when it is called."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.cli.latency import latency, real, validity_map
from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    check_folder,
    check_json,
    compile_first,
    err,
    fail,
    make_folder,
    out,
    progress,
    scene_from,
    write_json,
)
from hertzloop.cli.recordings import FileArgument, read_or_fail
from hertzloop.cli.study_frame import numbers, results_in
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
from hertzloop.setup import load
from hertzloop.views.format import Table


def plate_models(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the numbers.")],
) -> None:
    """What thickness does to an impact, what the modes left out cost, and what both models take."""
    from benchmarks import plate_models as tail
    from benchmarks import plate_models as theory
    from benchmarks.plate_models import shown
    from hertzloop.studies.words import write_records

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


def response(
    file: FileArgument,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    json_file: JsonOption = None,
) -> None:
    """How long the answers of a paced run took, and what they had."""
    from hertzloop.analysis.recorded import pacing_of, responses_of
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.studies import law_on as picture
    from hertzloop.views.data import pacing_as_json
    from hertzloop.views.sentences import pacing_sentences

    check_json(json_file)
    recording = read_or_fail(file)
    try:
        responses, found = responses_of(recording), pacing_of(recording)
    except RecordingError as error:
        fail(str(error), 1)
    if responses is None or found is None or found.clock is None:
        fail(f"{file} has no response times; those of 'hertzloop run --pace' have", 2)
    make_folder(folder)
    try:
        picture.draw_response(folder / "response.png", responses, found)
        picture.write_table(folder / "response.csv", responses)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}", 1)
    for sentence in pacing_sentences(found):
        out.print(sentence, soft_wrap=True)
    out.print(f"written: {folder}/response.png and .csv", soft_wrap=True)
    write_json(json_file, pacing_as_json(found) or {})


SchemeName = Literal["thesis2008", "modal"]


def tables(
    rows_file: Annotated[Path, typer.Argument(metavar="ROWS.csv", help="Rows to compute.")],
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Table to write; to the screen if left out.")
    ] = None,
    scheme: Annotated[SchemeName, typer.Option(help="How the plant is computed.")] = "thesis2008",
    maidanik: Annotated[
        bool, typer.Option("--maidanik", help="Erad by eq. 3.13, not by the study's 3.12.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Compute every row of a published table again, beside what was published."""
    from hertzloop.processes.warmup import of_scheme
    from paper import tables as study

    check_folder(out_file)
    check_json(json_file, out_file)
    if out_file is not None and out_file.resolve() == rows_file.resolve():
        fail(f"{out_file} is the table to read; write to another file", 2)
    try:
        header, rows = study.read_rows(rows_file)
        compile_first(of_scheme(scheme))
        with progress(rows_file.name, len(rows)) as advance:
            new_header, new_rows, endless = study.compute_table(
                header, rows, scheme, advance, study.WITH_MAIDANIK if maidanik else study.FIGURES
            )
    except study.RowError as error:
        fail(str(error), 2)
    try:
        study.write_table(out_file, new_header, new_rows)
    except OSError as error:
        fail(f"cannot write {out_file}: {error.strerror}", 1)
    console = out if out_file else err
    agreements, shares = study.agreement(new_rows), study.shares(new_rows)
    if agreements:
        console.print(_agreement_table(scheme, [vars(a) for a in agreements], study.UNITS))
    for what, share in shares.items():
        console.print(f"{what}: {100.0 * share:.0f} % of the rows")
    if endless:
        console.print(f"{endless} of {len(new_rows)} contacts do not end; their cells are empty")
    if out_file:
        console.print(f"{len(new_rows)} rows written: {out_file}", soft_wrap=True)
    data = {"agreement": [vars(a) for a in agreements], "shares": shares, "endless": endless}
    write_json(json_file, {"rows": len(new_rows), "scheme": scheme, **data})


def _agreement_table(scheme: str, agreements: list[dict[str, Any]], units: dict[str, str]) -> Table:
    table = Table(title=f"{scheme} against the published rows")
    for heading in ("figure", "rows", "median off by", "worst", "in row"):
        table.add_column(heading, justify="left" if heading == "figure" else "right")
    for a in agreements:
        unit = units.get(a["column"], "dB")
        table.add_row(
            a["column"], str(a["rows"]), f"{a['median']:.3f} {unit}", f"{a['worst']:.3f} {unit}",
            str(a["worst_row"]),
        )  # fmt: skip
    return table


def calibrate(
    scene: SceneArgument = "thesis-aluminium",
    restitution: Annotated[
        float | None,
        typer.Option(help="Target, relative velocity after over before; the plate material's."),
    ] = None,
    relaxation_s: Annotated[
        float, typer.Option(min=1e-7, help="Time constant tau of the relaxation, s.")
    ] = 1e-3,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Damping parameters of the published scheme for a coefficient of restitution."""
    from hertzloop.plant.schemes import thesis2008 as calibration

    resolved = scene_from(scene, settings, None)
    check_json(json_file)
    target = restitution or resolved.structure.material.restitution
    spec = resolved.plant
    data = {"restitution": target, "relaxation_s": relaxation_s}
    try:
        data["viscous_n_s_m"] = calibration.calibrate_viscous(spec, target)
        data["relaxation_stiffness"] = calibration.calibrate_relaxation(spec, target, relaxation_s)
    except ValueError as error:
        fail(str(error), 2)
    for key, value in data.items():
        out.print(f"{key} = {value:.8g}")
    write_json(json_file, data)


def weaknesses(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for chart and numbers.")],
) -> None:
    """Where the published numerics fail, beside the consistent scheme: chart and numbers."""
    from paper import weaknesses as study

    with results_in(folder, "modal", "thesis2008"):
        found = study.run(folder)
    for table in found:
        out.print(table)
    out.print(f"written: {folder}", soft_wrap=True)


def figures(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the pictures.")],
) -> None:
    """The study's figures redrawn from our own runs, published and consistent scheme."""
    from paper import figures as study

    with results_in(folder, "modal", "thesis2008"):
        found = study.draw_figures(folder)
    for path in found:
        out.print(f"written: {path}", soft_wrap=True)


def published(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the pictures.")],
) -> None:
    """The study's other figures redrawn: single and all-round optima, damping, spectra, forces."""
    from paper import figures as gallery

    with (
        results_in(folder, "modal", "thesis2008"),
        progress("published", gallery.COUNT) as advance,
    ):
        found = gallery.draw(folder, advance)
    for path in found:
        out.print(f"written: {path}", soft_wrap=True)


def speed_accuracy(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for chart and numbers.")],
    quick: Annotated[bool, typer.Option("--quick", help="Two scenes, fewer rounds.")] = False,
) -> None:
    """Error against CPU time of every scheme, on the same equations, in one run."""
    from benchmarks import speed_accuracy as study

    with results_in(folder, "modal"):
        points = study.run(folder, quick)
    for title, rows in study.ratios(points).items():
        headings = ("scene", "error", "modal (s/ms)", "competitor (s/ms)", "times faster")
        out.print(numbers(title, headings, rows))
    out.print(f"written: {folder}/speed_accuracy.csv and .png", soft_wrap=True)


def model_order(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for chart and numbers.")],
    scenes: Annotated[int, typer.Option(min=1, help="Number of random scenes.")] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the scenes.")] = 1,
) -> None:
    """Whether the automatic choice of modes meets its accuracy on random scenes, and its cost; the
    same of whole scenes with losses in the contact, without and with a law."""
    from benchmarks import model_order as study
    from benchmarks import model_order_closed_loop as closed_loop

    with results_in(folder, "modal"):
        compile_first(load(DEFAULT, ["plate.tail=spring"]))
        found = study.run(folder, scenes, seed)
        whole = closed_loop.run(folder, scenes, seed)
    headings = ("asked", "scenes", "beyond the step", "met", "worst error/asked",
                "cost/cheapest, median", "largest")  # fmt: skip
    out.print(numbers("Automatic choice of modes", headings, study.summary(found)))
    for outcome in found:
        if outcome.error > outcome.request and not outcome.capped:
            out.print(f"missed: {outcome}", soft_wrap=True)
    title = "Damper 0.3 to 0.9, or yield: within what was asked, loop closed"
    out.print(numbers(title, closed_loop.HEADINGS, closed_loop.summary(whole)))
    for missed in closed_loop.missed(whole):
        out.print(missed, soft_wrap=True)
    out.print(
        f"written: {folder}/model_order.csv and .png, model_order_closed_loop.csv", soft_wrap=True
    )


def infinite_plate(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the numbers.")],
    scenes: Annotated[int, typer.Option(min=1, help="Number of random scenes.")] = 80,
    seed: Annotated[int, typer.Option(help="Seed of the scenes.")] = 1,
) -> None:
    """Whether an infinite plate meets its accuracy on random scenes as long as it is offered."""
    from benchmarks import infinite_plate as study

    with results_in(folder, "modal"):
        found = study.run(folder, scenes, seed)
    headings = ("asked", "scenes", "offered", "gap", "rebound", "energy", "energy, no control")
    title = "Infinite plate, errors over what was asked"
    out.print(numbers(title, headings, study.summary(found)))
    out.print(f"written: {folder}/infinite_plate.csv", soft_wrap=True)


def stability(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for charts and numbers.")],
) -> None:
    """Where each scheme and the closed loop blow up or lose their energy balance."""
    from benchmarks import stability as study

    with results_in(folder, "modal"):
        found = study.run(folder)
    for what, value in found.items():
        out.print(f"{what} {value}", soft_wrap=True)
    out.print(
        f"written: {folder}/stability.png, stability-energy.png and stability-*.csv", soft_wrap=True
    )


def register(app: typer.Typer) -> None:
    """Add the commands."""
    chart = typer.Typer(help="Charts that measure on this machine.", no_args_is_help=True)
    chart.command("speed-accuracy")(speed_accuracy)
    chart.command("model-order")(model_order)
    chart.command("infinite-plate")(infinite_plate)
    chart.command("plate-models")(plate_models)
    chart.command("stability")(stability)
    chart.command("latency")(latency)
    chart.command("real")(real)
    chart.command("response")(response)
    chart.command("published")(published)
    chart.command("validity")(validity_map)
    app.add_typer(chart, name="chart")
    for command in (tables, figures, weaknesses, calibrate):
        app.command()(command)


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
    from hertzloop.studies.words import write_records
    from paper import tables as study

    check_json(json_file)
    if folder:
        make_folder(folder)
    _ready("thesis2008", "modal")
    configs = study.grid()
    with progress("optima", len(configs) * len(study.PLANTS)) as advance:
        found = study.compute_optima(configs, study.PLANTS, advance)
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
    from paper import tables
    from paper import tables as appendix

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
    from paper import tables as study

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


def register_published(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="What the published study holds, again.", no_args_is_help=True)
    for command in (optima, a1, equations):
        group.command()(command)
    app.add_typer(group, name="published")
