"""Cases of a sweep, run again over a transport, for `sweep --verify`."""

from pathlib import Path

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.many_cases import end_if_failed
from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.loop.run_options import Transport
from hertzloop.studies.cases.identity import check_laws, code_version
from hertzloop.studies.cases.rows import without_result
from hertzloop.studies.sweep.result import counted
from hertzloop.studies.sweep.results_file import read_results


def verify(
    results: Path, cases: int, transport: Transport, seed: int, json_file: Path | None
) -> None:
    """Run cases of a sweep again, and compare all bytes; exit code 1 if any differ.

    Args:
        results: Results of the sweep.
        cases: Number of cases to draw, at most.
        transport: Transport of the runs.
        seed: Random seed of the draw.
        json_file: File of --json, if one is given.
    """
    outputs.check_json(json_file)
    try:
        rows, header = read_results(results)
        check_laws(header)
    except ValueError as error:
        fail(str(error))
    with_metrics = sum(not row["status"] for row in rows)
    if not with_metrics:
        fail(f"{results}: no case has metrics to verify. Run the sweep with other ranges.")
    cases = min(cases, with_metrics)
    if header["versions"] != code_version():
        err.say(f"{results}: written by {header['versions']}; bits may differ")
    prepare.compile_first()
    from hertzloop.studies.sweep.repeat_cases import RepeatedCase, repeat_cases

    repeated: list[RepeatedCase] = []
    with progress(f"{cases} cases", cases) as advance:
        for checked in repeat_cases(rows, header, cases, transport, seed):
            repeated.append(checked)
            advance(len(repeated))
    compared = [checked for checked in repeated if not checked.not_run]
    differing = [checked.case for checked in compared if not checked.same]
    same = len(compared) - len(differing)
    out.print(f"{same} of {len(compared)} cases: the same bytes over {transport}")
    if with_metrics < len(rows):
        out.print(f"{len(rows) - with_metrics} of {len(rows)} cases have no metrics to verify")
    if differing:
        out.say(f"different: case {', '.join(map(str, differing))}")
    not_simulated = [row["status"] for row in without_result(rows)]  # in the results already
    reasons = [f"case {checked.case}: {checked.not_run}" for checked in repeated if checked.not_run]
    outputs.write_json(
        json_file,
        {
            "same": same,
            "differing": differing,
            "failed": len(reasons),
            "without_metrics": len(rows) - with_metrics,
            "leaves_out": counted(rows, "leaves_out"),
            "out_of_range": counted(rows, "out_of_range"),
        },
    )
    end_if_failed([*reasons, *not_simulated], len(repeated) + len(not_simulated))
    if differing:
        raise typer.Exit(1)
