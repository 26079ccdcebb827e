"""Requirements on a law, checked for `budget --check`."""

from pathlib import Path

import typer

from hertzloop.cli import outputs, prepare
from hertzloop.cli.terminal import if_interrupted, out, progress
from hertzloop.studies.budget.requirements.check import check
from hertzloop.studies.budget.requirements.requirement import read_requirements
from hertzloop.studies.cases.pool import local_pool
from hertzloop.views.format import unwrapped
from hertzloop.warmup import CASES


def check_requirements(path: Path, workers: int | None, json_file: Path | None) -> None:
    """Check a file of requirements; end with exit code 1 if one fails.

    Args:
        path: The requirements, a TOML file.
        workers: Number of processes; None: one for each core.
        json_file: File of --json, if one is given.
    """
    requirements = read_requirements(path)
    setups = [requirement.setup() for requirement in requirements]
    for setup in {setup.scene.controller.law: setup for setup in setups}.values():
        prepare.check_law(setup)
    differing = {(s.scene.name, s.scene.controller.law): s for s in setups}
    prepare.compile_first(*differing.values(), works=CASES)
    results = []
    with (
        if_interrupted(),
        progress("requirements", len(requirements)) as advance,
        local_pool(workers) as pool,
    ):
        for requirement in requirements:
            results.append(check(pool, requirement))
            advance(len(results))
    for result in results:
        head = ("holds", "green") if result.passed else ("FAILS", "bold red")
        out.say(unwrapped(head, f"  {result.row.name}"))
        for sentence in (*result.fails, *result.holds):
            out.say(f"    {sentence}")
        for sentence in result.warnings:
            out.say(f"    Warning: {sentence}")
        if not result.passed:
            out.say(f"    Reproduce: {result.command}")
    failed = sum(not result.passed for result in results)
    out.print(f"{len(results) - failed} of {len(results)} requirements hold")
    as_data = [
        {
            "name": result.row.name,
            "scene": result.row.scene,
            "passed": result.passed,
            "holds": result.holds,
            "fails": result.fails,
            "warnings": result.warnings,
            "unstable": result.unstable,
            "measured": result.measured,
            "command": result.command,
        }
        for result in results
    ]
    outputs.write_json(
        json_file,
        {
            "requirements": as_data,
            "passed": not failed,
            "failed": failed,
            "unstable": any(result.unstable for result in results),
        },
    )
    if failed:
        raise typer.Exit(1)
