"""Commands that run many cases: `sweep`, and `check` of its results against real processes."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.table import Table

from hertzloop.options import (
    JsonOption,
    OverwriteOption,
    SceneArgument,
    SeedOption,
    SetOption,
    TransportName,
    announce_compilation,
    check_folder,
    check_output,
    scene_from,
    write_json,
)
from hertzloop.scene import DEFAULT, NO_CASE_OF_THESIS, SceneError
from hertzloop.terminal import err, fail, out, progress


def sweep(
    scene: SceneArgument = DEFAULT,
    over: Annotated[
        list[str] | None,
        typer.Option(
            help="Scene key and its values: key=low:high:step, key=a,b,c; key=low:high to spread "
            "points. May be given several times."
        ),
    ] = None,
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Results, .parquet or .csv.")
    ] = None,
    design: Annotated[
        Literal["grid", "lhs", "sobol"],
        typer.Option(help="All combinations, or points spread over the ranges."),
    ] = "grid",
    cases: Annotated[int, typer.Option(help="Number of spread points.")] = 256,
    span: Annotated[
        Literal["impact", "run"],
        typer.Option(help="Figures of the first impact, or of all contacts of the run."),
    ] = "impact",
    seed: SeedOption = None,
    settings: SetOption = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as cores if left out.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(help="Scheduler of a Dask cluster, e.g. tcp://host:8786.")
    ] = None,
    overwrite: OverwriteOption = False,
    json_file: JsonOption = None,
) -> None:
    """Simulate a scene over ranges of its keys; a killed sweep goes on with the same command."""
    from hertzloop.warmup import ensure_compiled
    from studies import sweep as study
    from studies.design import DesignError, make_design
    from studies.journal import JournalError

    resolved = scene_from(scene, settings, seed)
    target = out_file or Path(f"{resolved.name}-sweep.parquet")
    if target.suffix not in (".parquet", ".csv"):
        fail(f"{target} is neither .parquet nor .csv, which say how to write the results", 2)
    if target.is_dir():
        fail(f"{target} is a folder; choose the name of a file with --out", 2)
    check_output(target, overwrite)
    check_folder(json_file)
    if json_file in (target, target.with_name(target.name + ".json")):
        fail(f"--json {json_file} is a file of the results; choose another name", 2)
    if resolved.run.scheme == "thesis2008":
        fail(NO_CASE_OF_THESIS, 2)
    try:
        planned = make_design(resolved, over or [], design, cases, resolved.run.seed)
    except (DesignError, SceneError) as error:
        fail(str(error), 2)
    ensure_compiled(announce_compilation)
    total = len(planned.cases())
    try:
        with progress(f"{total} cases", total) as advance:
            found = study.sweep(
                resolved, planned, span, target, workers=workers, dask=dask, on_progress=advance
            )
    except JournalError as error:
        fail(str(error), 2)
    except study.SweepFailed as error:
        fail(f"{error}; finished cases are kept, the same command goes on with them", 1)
    except OSError as error:
        fail(f"cannot write {target}: {error.strerror}", 1)
    except KeyboardInterrupt:
        err.print("interrupted; finished cases are kept, the same command goes on with them")
        raise typer.Exit(130) from None
    keys = [axis.key for axis in planned.axes]
    if len(found.failed) < total:
        out.print(_extremes(found.rows, keys))
    rate = found.ran / found.wall_s if found.wall_s else 0.0
    out.print(
        f"{found.ran} of {total} cases run in {found.wall_s:.2f} s: {rate:.0f} cases/s; "
        f"written: {target}",
        soft_wrap=True,
    )
    for row in found.failed[:3]:
        said = f"case {row['case']} could not be: {row['status']}"
        err.print(said, soft_wrap=True, markup=False)
    if len(found.failed) > 3:
        err.print(f"... and {len(found.failed) - 3} more; see the column status")
    write_json(
        json_file,
        {
            "cases": total,
            "ran": found.ran,
            "wall_s": found.wall_s,
            "cases_per_s": rate,
            "failed": len(found.failed),
            "results": str(target),
        },
    )
    if len(found.failed) == total:
        fail(f"none of the {total} cases has figures", 1)


_SHOWN = ("plate_energy_db", "rebound_percent", "radiated_db", "plate_speed_db", "pressure_db")


def _extremes(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Where each figure is least and largest."""
    table = Table(title="Against no control", title_justify="left")
    for heading in ("figure", "least", "at", "largest", "at"):
        table.add_column(heading, justify="left" if heading in ("figure", "at") else "right")
    for figure in _SHOWN:
        known = [row for row in rows if row[figure] is not None and row[figure] == row[figure]]
        if not known:
            continue
        ends = [pick(known, key=lambda row: row[figure]) for pick in (min, max)]
        where = [
            ", ".join(f"{key.split('.')[-1]} {_short(row[key])}" for key in keys) for row in ends
        ]
        least, most = (f"{row[figure]:.2f}" for row in ends)
        table.add_row(figure, least, where[0], most, where[1])
    return table


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def check(
    results: Annotated[Path, typer.Argument(metavar="RESULTS", help="Results of a sweep.")],
    cases: Annotated[int, typer.Option(min=1, help="Number of cases, drawn at random.")] = 10,
    transport: Annotated[TransportName, typer.Option(help="How the parts talk.")] = "zenoh",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draw.")] = 1,
    json_file: JsonOption = None,
) -> None:
    """Run cases of a sweep again as processes over zenoh; exit 0 if all bytes are the same."""
    from bus.port import BusError
    from bus.streams import StreamFault
    from hertzloop.launcher import RunFailed
    from hertzloop.warmup import ensure_compiled
    from recordings.writer import RecordingError
    from studies.replay_cases import replay_cases
    from studies.sweep import code_version, read_results

    check_folder(json_file)
    try:
        rows, header = read_results(results)
    except ValueError as error:
        fail(str(error), 2)
    most = sum(not row["status"] for row in rows)
    if not most:
        fail(f"{results} has no case with figures, which could be checked", 2)
    cases = min(cases, most)
    if header["versions"] != code_version():
        err.print(f"{results} was made with {header['versions']}; bits may differ", soft_wrap=True)
    ensure_compiled(announce_compilation)
    same, differing = 0, []
    try:
        with progress(f"{cases} cases", cases) as advance:
            for row, equal in replay_cases(rows, header, cases, transport, seed):
                same += int(equal)
                if not equal:
                    differing.append(row["case"])
                advance(same + len(differing))
    except (RunFailed, BusError, StreamFault, RecordingError, SceneError) as error:
        fail(str(error), 1)
    out.print(f"{same} of {same + len(differing)} cases: the same bytes over {transport}")
    write_json(json_file, {"same": same, "differing": differing})
    if differing:
        out.print(f"different: case {', '.join(map(str, differing))}", soft_wrap=True)
        raise typer.Exit(1)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (sweep, check):
        app.command()(command)
