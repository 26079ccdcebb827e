"""The command `sweep`: run many cases, or run cases of its results again as real processes."""

import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from hertzloop.cli import options
from hertzloop.cli.terminal import err, fail, if_interrupted, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.results.cases import OTHER, SHOWN
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.plant_checks import check_conserves
from hertzloop.studies.requests import SweepRequest
from hertzloop.studies.sweeps import sweep as sweep_study
from hertzloop.studies.sweeps.design import KEY as PHASE
from hertzloop.studies.sweeps.design import grouped, planned_by
from hertzloop.studies.sweeps.evaluate import not_run, run_case
from hertzloop.studies.sweeps.sweep import (
    check_laws,
    code_version,
    counted,
    extremes,
    known,
    read_results,
    short,
)
from hertzloop.studies.sweeps.uncertain import read_uncertain, with_draws
from hertzloop.views.format import Table, unwrapped
from hertzloop.views.verdict import spans_differ


@options.takes()
def sweep(
    request: SweepRequest,
    scene: options.SceneArgument = DEFAULT,
    out_file: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
    verify: Annotated[Path | None, typer.Option(metavar="RESULTS")] = None,
    transport: options.TransportName = "zenoh",
    json_file: options.JsonOption = None,
) -> None:
    """Simulate a scene over ranges of its keys.

    The results have a row for every case. A killed sweep goes on with the same command.

    Args:
        out_file: Write the results to this .parquet or .csv file.
        verify: Repeat --cases cases of these results over --transport and compare all bytes; exit
            code 1 if any differ.
        transport: Use this transport for --verify.
    """
    cases, span, design = request.cases, request.span, request.design
    if verify is not None:
        _verify(verify, 10 if cases is None else cases, transport, 1 if seed is None else seed,
                json_file)  # fmt: skip
        return

    resolved = options.scene_from(scene, settings, seed)
    target = out_file or Path(f"{resolved.name}-sweep.parquet")
    if target.suffix not in (".parquet", ".csv"):
        fail(f"--out = {target}: unknown format. Use a name that ends in .parquet or .csv.")
    check_conserves(resolved.scheme)
    if request.dask is not None:
        _check_scheduler(request.dask)
    planned, uncertain = planned_by(resolved, request), request.uncertain
    if uncertain is not None:
        drawn_from = read_uncertain(uncertain, resolved)
        planned = with_draws(resolved, planned, drawn_from, request.points)
    for axis in planned.axes:
        for law in axis.values if axis.key == "controller.law" else ():
            options.check_law(resolved.vary({"controller.law": law}))
    complete = None if overwrite else sweep_study.finished(resolved, planned, span, target)
    options.check_output(
        target, overwrite or complete is not None,
        read=options.files_of(resolved, scene, *(settings or [])),
    )  # fmt: skip
    # For what is unfinished, even where a file may be replaced.
    options.check_writable(target.parent)
    beside = (target.with_name(target.name + end) for end in (".json", ".partial"))
    options.check_json(json_file, target, *beside)
    total = len(planned.cases())
    on = "finished cases are kept. Run the same command again to continue"
    if complete is not None:
        found = complete
        err.say(f"{target} has the results of this sweep. --overwrite runs it again.")
    else:
        options.compile_first(resolved)
        try:
            with if_interrupted(lambda: on), progress(f"{total} cases", total) as advance:
                found = sweep_study.sweep(
                    resolved, planned, span, target, workers=request.workers, dask=request.dask,
                    on_progress=advance,
                    on_wait=lambda sentence: err.say(f"{sentence}."),
                )  # fmt: skip
        except sweep_study.SweepFailed as error:
            fail(f"{error}; {on}.", 1)
        except OSError as error:
            why = error.strerror or error  # an error of Arrow has no number
            fail(f"cannot write {error.filename or target}: {why}; {on}.", 1)
    keys = planned.keys
    for line in found.damaged:
        err.say(
            f"line {line} of {sweep_study.journal_of(target)} was damaged. Its case was run again."
        )
    figureless = len(found.not_run) + found.unstable
    if figureless < total:
        out.print(_extremes(found.rows, keys))
    having = sweep_study.known(found.rows, "plate_energy_db")
    if having and uncertain is None:
        best = min(having, key=lambda row: row["plate_energy_db"])
        other = run_case(resolved, OTHER[span], 0, {key: best[key] for key in keys})
        hint = f"--span {OTHER[span]} sweeps the other."
        for said in spans_differ(best["plate_energy_db"], other["plate_energy_db"], span, hint):
            out.say(f"At the least plate energy: {said}")
    if uncertain is not None and figureless < total:
        out.print(_uncertainties(found.rows, [axis.key for axis in planned.axes]))
    phased = PHASE in keys and design == "grid" and uncertain is None
    over_phases = grouped(found.rows, keys, SHOWN) if phased else []
    if over_phases:
        out.print(_spreads(over_phases, [key for key in keys if key != PHASE]))
    rate = found.ran / found.wall_s if found.wall_s else 0.0
    out.say(
        f"{found.ran} of {total} cases run in {found.wall_s:z.2f} s: {rate:z.0f} cases/s. "
        f"Results: {target}"
    )
    beyond = counted(found.rows, "out_of_range")
    if beyond:
        words = ", ".join(f"{name} in {times} of {total} cases" for name, times in beyond.items())
        out.say(unwrapped(("OUT OF RANGE:", "bold red"), f" {words}"))
    if found.unstable:
        out.print(f"{found.unstable} of {total} cases are unstable and have no figures.")
    growing = found.growing
    if growing:
        most = max((one for one in growing if not math.isnan(one)), default=math.nan)
        size = "" if math.isnan(most) else f"; the loop grows up to {most:.4g}/s"
        out.say(
            unwrapped(("Linear loop unstable", "bold red"),
                   f" in {len(growing)} of {total} cases that are too short to show it{size} "
                   "(column growth_per_s)."))  # fmt: skip
    options.write_json(
        json_file,
        {
            "cases": total,
            "ran": found.ran,
            "wall_s": found.wall_s,
            "cases_per_s": rate,
            "failed": len(found.not_run),
            "unstable": found.unstable,
            "unstable_loops": len(growing),
            "damaged_lines": found.damaged,
            "leaves_out": counted(found.rows, "leaves_out"),
            "out_of_range": beyond,
            "over_phases": [
                {key: asdict(v) if key in SHOWN else v for key, v in group.items()}
                for group in over_phases
            ],
            "results": str(target),
        },
    )
    if figureless == total:
        out.print(f"No case of {total} has figures.")
    options.end_if_not_run([row["status"] for row in found.not_run], total)
    if figureless == total:
        raise typer.Exit(1)


_MOST_ROWS = 20
_SCHEDULER = re.compile(
    r"(?:(?:tcp|tls|ucx|wss?)://)?(?:\[[^\s\]]+\]|[^\s/:\[\]]+):(?P<port>[0-9]{1,9})"
)


def _check_scheduler(address: str) -> None:
    """End the command unless a Dask scheduler can be at an address."""
    need("distributed")
    found = _SCHEDULER.fullmatch(address)
    if not found:
        fail(f"--dask = '{address}': invalid scheduler address. Give it as tcp://host:8786.")
    if not 0 < int(found["port"]) <= options.LARGEST_PORT:
        fail(f"--dask = '{address}': invalid port. Give a port from 1 to {options.LARGEST_PORT}.")


def _extremes(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    table = Table(title="Against no control")
    for heading in ("figure", "least", "at", "largest", "at"):
        table.add_column(heading, justify="left" if heading in ("figure", "at") else "right")
    for figure, *words in extremes(rows, keys):
        table.add_row(figure, *words)
    return table


def _uncertainties(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Median and 95 % range of figures over the draws, a setting of the other keys a row."""
    # So many that their names fit side by side in 80 columns.
    names = [name for name in SHOWN if known(rows, name)][: max(2, 4 - len(keys))]
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title="Over draws of the uncertain keys: median (2.5 to 97.5 %)")
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    for values, group in list(groups.items())[:_MOST_ROWS]:
        cells = []
        for name in names:
            having = [row[name] for row in known(group, name)] or [math.nan]
            low, middle, high = np.percentile(having, [2.5, 50.0, 97.5])
            cells.append(f"{middle:.4g} ({low:.4g} to {high:.4g})")
        table.add_row(*(short(value) for value in values), *cells)
    return table


def _spreads(groups: list[dict[str, Any]], keys: list[str]) -> Table:
    """Mean and range over the touch phase, a setting of the other keys a row."""
    right = [*(key.split(".")[-1] for key in keys), *SHOWN[:2]]
    table = Table(right=right, title="Over touch phases: mean (least to most)")
    for group in groups[:_MOST_ROWS]:
        table.add_row(*(short(group[key]) for key in keys), *(str(group[f]) for f in SHOWN[:2]))
    if len(groups) > _MOST_ROWS:
        table.caption = f"and {len(groups) - _MOST_ROWS} more; --json has them all"
    return table


def _verify(
    results: Path, cases: int, transport: options.TransportName, seed: int, json_file: Path | None
) -> None:
    """Run cases of a sweep again as real processes, and compare all bytes."""
    options.check_json(json_file)
    try:
        rows, header = read_results(results)
        check_laws(header)
    except ValueError as error:
        fail(str(error))
    most = sum(not row["status"] for row in rows)
    if not most:
        fail(f"{results}: no case has figures to verify. Run the sweep with other ranges.")
    cases = min(cases, most)
    if header["versions"] != code_version():
        err.say(f"{results}: written by {header['versions']}; bits may differ")
    options.compile_first()
    from hertzloop.studies.sweeps.replay_cases import RepeatedCase, replay_cases

    found: list[RepeatedCase] = []
    with progress(f"{cases} cases", cases) as advance:
        for checked in replay_cases(rows, header, cases, transport, seed):
            found.append(checked)
            advance(len(found))
    ran = [checked for checked in found if not checked.not_run]
    differing = [checked.case for checked in ran if not checked.same]
    out.print(f"{len(ran) - len(differing)} of {len(ran)} cases: the same bytes over {transport}")
    if most < len(rows):
        without = f"{len(rows) - most} of {len(rows)} cases have no figures to verify"
        out.print(without)
    if differing:
        out.say(f"different: case {', '.join(map(str, differing))}")
    lacking = [row["status"] for row in not_run(rows)]  # in the results already
    reasons = [f"case {checked.case}: {checked.not_run}" for checked in found if checked.not_run]
    options.write_json(
        json_file,
        {
            "same": len(ran) - len(differing),
            "differing": differing,
            "failed": len(reasons),
            "without_figures": len(rows) - most,
            "leaves_out": counted(rows, "leaves_out"),
            "out_of_range": counted(rows, "out_of_range"),
        },
    )
    options.end_if_not_run([*reasons, *lacking], len(found) + len(lacking))
    if differing:
        raise typer.Exit(1)
