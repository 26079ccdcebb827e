"""Commands that run a study; each loads what it needs when it is called."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.table import Table

from hertzloop.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    announce_compilation,
    check_folder,
    scene_from,
    write_json,
)
from hertzloop.terminal import err, fail, out, progress

SchemeName = Literal["thesis2008", "modal"]


def bench(json_file: JsonOption = None) -> None:
    """What a plant step, an exchange and the whole loop cost on this machine."""
    from bus.port import BusError
    from hertzloop import report
    from hertzloop.launcher import RunFailed
    from hertzloop.warmup import ensure_compiled
    from studies import baseline, roofline

    check_folder(json_file)
    ensure_compiled(announce_compilation)
    try:
        data = baseline.measure()
        shares = [asdict(share) for share in roofline.shares()]
    except (RunFailed, BusError) as error:
        fail(str(error), 1)
    for title, costs in data.items():
        out.print(report.cost_table(title, costs))
    out.print(report.roofline_table("roofline of the default scheme's step", shares))
    write_json(json_file, {**data, "roofline": shares})


def tables(
    rows_file: Annotated[Path, typer.Argument(metavar="ROWS.csv", help="Rows to compute.")],
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Table to write; to the screen if left out.")
    ] = None,
    scheme: Annotated[SchemeName, typer.Option(help="How the plant is computed.")] = "thesis2008",
    json_file: JsonOption = None,
) -> None:
    """Compute every row of a published table again, beside what was published."""
    from hertzloop.warmup import ensure_compiled
    from studies import tables as study

    for path in (out_file, json_file):
        check_folder(path)
    if out_file is not None and out_file.resolve() == rows_file.resolve():
        fail(f"{out_file} is the table to read; write to another file", 2)
    try:
        header, rows = study.read_rows(rows_file)
        ensure_compiled(announce_compilation, scheme)
        with progress(rows_file.name, len(rows)) as advance:
            new_header, new_rows, endless = study.compute_table(header, rows, scheme, advance)
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
    table = Table(title=f"{scheme} against the published rows", title_justify="left")
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
    from hertzloop import parts
    from plant import calibration
    from plant.materials import MATERIALS

    resolved = scene_from(scene, settings, None)
    check_folder(json_file)
    target = restitution or MATERIALS[resolved.plate.material].restitution
    spec = parts.plant_spec(resolved)
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
    from studies import weaknesses as study

    with _results_in(folder, "modal", "thesis2008"):
        found = study.run(folder)
    for table in found:
        out.print(table)
    out.print(f"written: {folder}", soft_wrap=True)


def figures(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the pictures.")],
) -> None:
    """The study's figures redrawn from our own runs, published and consistent scheme."""
    from studies import figures as study

    with _results_in(folder, "modal", "thesis2008"):
        found = study.draw(folder)
    for path in found:
        out.print(f"written: {path}", soft_wrap=True)


def speed_accuracy(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for chart and numbers.")],
    quick: Annotated[bool, typer.Option("--quick", help="Two scenes, fewer rounds.")] = False,
) -> None:
    """Error against CPU time of every scheme, on the same equations, in one run."""
    from studies import speed_accuracy as study

    with _results_in(folder, "modal"):
        points = study.run(folder, quick)
    for title, rows in study.ratios(points).items():
        table = Table(title=title, title_justify="left")
        for heading in ("scene", "error", "modal (s/ms)", "competitor (s/ms)", "times faster"):
            table.add_column(heading, justify="right")
        for row in rows:
            table.add_row(*row)
        out.print(table)
    out.print(f"written: {folder}/speed_accuracy.csv and .png", soft_wrap=True)


def model_order(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for chart and numbers.")],
    scenes: Annotated[int, typer.Option(min=1, help="Number of random scenes.")] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the scenes.")] = 1,
) -> None:
    """Whether the automatic choice of modes meets its accuracy on random scenes, and its cost."""
    from studies import model_order as study

    with _results_in(folder, "modal"):
        found = study.run(folder, scenes, seed)
    table = Table(title="Automatic choice of modes", title_justify="left")
    for heading in ("asked", "scenes", "beyond the step", "met", "worst error/asked",
                    "cost/cheapest, median", "largest"):  # fmt: skip
        table.add_column(heading, justify="right")
    for row in study.summary(found):
        table.add_row(*row)
    out.print(table)
    for outcome in found:
        if outcome.error > outcome.request and not outcome.capped:
            out.print(f"missed: {outcome}", soft_wrap=True)
    out.print(f"written: {folder}/model_order.csv and .png", soft_wrap=True)


def infinite_plate(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for the numbers.")],
    scenes: Annotated[int, typer.Option(min=1, help="Number of random scenes.")] = 80,
    seed: Annotated[int, typer.Option(help="Seed of the scenes.")] = 1,
) -> None:
    """Whether an infinite plate meets its accuracy on random scenes as long as it is offered."""
    from studies import infinite_plate as study

    with _results_in(folder, "modal"):
        found = study.run(folder, scenes, seed)
    table = Table(title="Infinite plate, errors over what was asked", title_justify="left")
    for heading in ("asked", "scenes", "offered", "gap", "rebound", "energy",
                    "energy, no control"):  # fmt: skip
        table.add_column(heading, justify="right")
    for row in study.summary(found):
        table.add_row(*row)
    out.print(table)
    out.print(f"written: {folder}/infinite_plate.csv", soft_wrap=True)


def stability(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for charts and numbers.")],
) -> None:
    """Where each scheme and the closed loop blow up or lose their energy balance."""
    from studies import stability as study

    with _results_in(folder, "modal"):
        found = study.run(folder)
    for what, value in found.items():
        out.print(f"{what} {value}", soft_wrap=True)
    out.print(
        f"written: {folder}/stability.png, stability-energy.png and stability-*.csv", soft_wrap=True
    )


def latency(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for charts and numbers.")],
    quick: Annotated[bool, typer.Option("--quick", help="One scene's maps, coarser.")] = False,
    json_file: JsonOption = None,
) -> None:
    """Maps of every figure over latency, bits, sampling, gain; what latency each law survives."""
    from studies import latency as study
    from studies.evaluate import SweepFailed

    check_folder(json_file)
    try:
        with _results_in(folder, "modal"), progress("latency", 100) as advance:
            found = study.run(folder, quick, lambda done, of: advance(round(100 * done / of)))
    except SweepFailed as error:
        fail(str(error), 1)
    for scene in dict.fromkeys(c.scene for c in found):
        out.print(_survival_table(scene, [c for c in found if c.scene == scene]))
    best = list(study.best_laws(found))
    for name, law, survives, buys in best:
        out.print(f"{name}: {law} survives {survives:.0f} us, {buys:.0f} us more than two points")
    out.print(f"written: {folder}/latency-*.png and .csv", soft_wrap=True)
    keys = ("scene", "law", "survives_us", "more_than_two_points_us")
    data = {"critical": [vars(c) for c in found],
            "best": [dict(zip(keys, row, strict=True)) for row in best]}  # fmt: skip
    write_json(json_file, data)


def _survival_table(scene: str, found: list[Any]) -> Table:
    """What each law survives in a scene; see `studies.latency.Critical`."""
    table = Table(title=f"{scene}: what each law survives", title_justify="left")
    for heading in ("law", "kappa", "dB", "rebound", "latency (us)", "bits", "to 0.5 dB"):
        law = heading == "law"
        table.add_column(heading, justify="left" if law else "right", no_wrap=law)

    def shown(x: float) -> str:
        return "none" if math.isnan(x) else f"{x:.0f}"

    for c in found:
        more = "> " if c.critical_latency_us == math.inf else ""
        latency_us = shown(min(c.critical_latency_us, c.most_latency_us))
        table.add_row(
            c.law, f"{c.kappa:g}", "unstable" if c.ideal_db == math.inf else f"{c.ideal_db:.2f}",
            "" if math.isnan(c.ideal_rebound_percent) else f"{c.ideal_rebound_percent:.0f} %",
            more + latency_us, shown(c.critical_bits), shown(c.settled_bits),
        )  # fmt: skip
    return table


@contextmanager
def _results_in(folder: Path, *schemes: str) -> Iterator[None]:
    """A study that writes into `folder`, which is made, with the kernels of `schemes` ready."""
    from hertzloop.warmup import ensure_compiled

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"{folder} is no folder that could be made: {error.strerror}", 2)
    for scheme in schemes:
        ensure_compiled(announce_compilation, scheme)
    try:
        yield
    except OSError as error:
        fail(f"cannot write into {folder}: {error.strerror}", 1)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    chart = typer.Typer(help="Charts that measure on this machine.", no_args_is_help=True)
    chart.command("speed-accuracy")(speed_accuracy)
    chart.command("model-order")(model_order)
    chart.command("infinite-plate")(infinite_plate)
    chart.command("stability")(stability)
    chart.command("latency")(latency)
    app.add_typer(chart, name="chart")
    for command in (tables, figures, weaknesses, calibrate, bench):
        app.command()(command)
