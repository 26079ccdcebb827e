"""The command `bench`: what things cost on this machine."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.commands.options import (
    JsonOption,
    check_folder,
    check_json,
    check_picture,
    compile_first,
    write_json,
)
from hertzloop.commands.terminal import fail, out
from hertzloop.views.format import Table

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
    from bus.port import BusError
    from hertzloop.processes.launcher import RunFailed
    from studies.cost import links as groups
    from studies.cost import roofline

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
    from studies.cost import exchange

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
    from studies.cost import laws as study

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
    from hertzloop.interop.fmu import NoCompiler
    from hertzloop.interop.objects import CompileFault
    from studies.cost import exported

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
    from studies.cost import cases

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
    from studies.cost import replay

    compile_first()
    found = replay.measure(rounds)
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
    """What the parts of a step reach of the processor's peaks; rows of `studies.cost.roofline`."""
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
