"""Results of the command `tune`: on the screen, as files, and as plain data."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hertzloop.cli.terminal import out
from hertzloop.cli.tune_search import TuneArguments, TuneResult, TuneStudy
from hertzloop.common.atomic_files import atomic_write
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml, toml_text
from hertzloop.studies.margin.shown import unstable_line
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.sweep import code_version
from hertzloop.views.format import Table, unwrapped

if TYPE_CHECKING:
    from hertzloop.studies.tuning import Candidate

_MOST_ROWS = 15
_PARTS = ("mean", "least", "most")  # of a spread over touch phases


def print_result(arguments: TuneArguments, study: TuneStudy, result: TuneResult) -> None:
    """Print the settings found, the verdict, and the commands that run the best one."""
    objectives = study.search.objectives
    out.print(_table(result, objectives))
    for line in _verdict(result, objectives):
        out.say(line)
    best = _best(result, objectives)
    unstable = sum(growth is not None for growth in result.growths)
    if unstable:
        text = f" in {unstable} of {len(result.growths)} settings. --require-stable refuses these."
        out.say(unwrapped(("Linear loop unstable", "bold red"), text))
    growth = result.growths[result.best.index(best)]
    if growth is not None:
        out.say(f"The loop of the best setting {unstable_line(growth)}")
    out.print(f"Repetition of the best setting ({_setting_words(best.values)}):")
    for setup, name in zip(_scenes_with(best, study), arguments.scenes, strict=True):
        out.say(f"  {_run_command(best, setup, name, arguments)}")


def as_data(result: TuneResult) -> dict[str, Any]:
    """Return the settings found as plain data."""
    objectives = list(result.published.metrics)
    return {
        "front": [
            asdict(candidate) | {"unstable_loop": None if growth is None else asdict(growth)}
            for candidate, growth in zip(result.best, result.growths, strict=True)
        ],
        "published": asdict(result.published),
        "verdict": _verdict(result, objectives),
        "cases": result.cases,
        "ran": result.ran,
        "failed": len(result.failed),
    }


def write_result(
    folder: Path, arguments: TuneArguments, study: TuneStudy, result: TuneResult
) -> None:
    """Write settings as CSV, all results as JSON, the chart, and each scene with the best setting.

    Raises:
        NotWritten: A file cannot be written.
    """
    from hertzloop.studies.tuning import Tuned, draw_front, write_tuned
    from hertzloop.studies.words import write_rows

    name, search, objectives = study.name, study.search, tuple(study.search.objectives)
    keys = sorted({key for candidate in result.best for key in candidate.values})
    headings = [*objectives, *(f"{o}_{part}" for o in objectives for part in _PARTS), *keys]
    rows = (
        [
            *candidate.metrics.values(),
            *(getattr(candidate.spreads[o], part) for o in objectives for part in _PARTS),
            *(candidate.values.get(key, "") for key in keys),
        ]
        for candidate in result.best
    )
    tuned = Tuned(
        scenes=[to_toml(base.scene) for base in study.bases],
        objectives=search.objectives,
        span=search.span,
        at_most=search.at_most,
        front=result.best,
        published=result.published,
        verdict=_verdict(result, objectives),
        failed=len(result.failed),
        command=_tune_command(arguments, study),
        versions=code_version(),
    )
    write_rows(folder / f"{name}.csv", headings, rows)
    write_tuned(folder / f"{name}.json", tuned)
    title = ", ".join(base.name for base in study.bases)
    draw_front(folder / f"{name}.png", title, result.best, result.published, objectives)
    best_scenes = _scenes_with(_best(result, objectives), study)
    for setup in best_scenes:
        atomic_write(folder / f"tuned-{setup.name}.toml", to_toml(setup.scene))
    out.say(
        f"written: {folder}/{name}.csv, .json and .png; with the best setting: "
        + ", ".join(f"{folder}/tuned-{setup.name}.toml" for setup in best_scenes)
    )


def _scenes_with(candidate: "Candidate", study: TuneStudy) -> list[Setup]:
    """Return the scenes with a setting."""
    return [base.vary(candidate.values) for base in study.bases]


def _best(result: TuneResult, objectives: Sequence[str]) -> "Candidate":
    """Return the setting that beats the published one, or the first if none does."""
    return _winner(result, objectives) or result.best[0]


def _winner(result: TuneResult, objectives: Sequence[str]) -> "Candidate | None":
    """Return the setting that beats the published one; None if none does.

    It reduces the first objective without raising the second.
    """
    from hertzloop.studies.tuning import better_than

    keep = objectives[1] if len(objectives) > 1 else objectives[0]
    return better_than(result.published, result.best, objectives[0], keep)


def _verdict(result: TuneResult, objectives: Sequence[str]) -> list[str]:
    """Return a sentence on how the best setting compares with the published one."""
    first, rest, published = objectives[0], objectives[1:], result.published
    keep = rest[0] if rest else first
    winner = _winner(result, objectives)
    if winner is None:
        return [f"none beats the published setting in {first} without raising {keep}"]
    gained = published.metrics[first] - winner.metrics[first]
    sentence = f"{_setting_words(winner.values)} beats the published setting in {first} by "
    sentence += f"{gained:z.3f}"
    if rest:
        sentence += f" at {keep} {winner.metrics[keep]:z.3f} against {published.metrics[keep]:z.3f}"
    return [sentence]


def _setting_words(values: dict[str, Any]) -> str:
    """Return the law of a setting, and its numbers, in words."""
    numbers = [
        f"{key.split('.')[-1]} {value:.4g}"
        for key, value in values.items()
        if isinstance(value, int | float)
    ]
    return f"{values['controller.law']}: {', '.join(numbers)}"


def _table(result: TuneResult, objectives: Sequence[str]) -> Table:
    """Return the table of settings, at most some of them, with the published one last."""
    best = result.best
    settings = "setting" if len(best) == 1 else "settings"
    right = [*objectives, f"{objectives[0]} over touch phases"]
    table = Table(right=right, title=f"{len(best)} Pareto-optimal {settings}")
    table.add_column("law and parameters")
    every = max(1, -(-len(best) // _MOST_ROWS))
    for candidate in [*best[::every], result.published]:
        note = " (published)" if candidate is result.published else ""
        table.add_row(
            *(f"{value:z.3f}" for value in candidate.metrics.values()),
            str(candidate.spreads[objectives[0]]),
            _setting_words(candidate.values) + note,
        )
    return table


def _tune_command(arguments: TuneArguments, study: TuneStudy) -> str:
    """Return the command that repeats the search."""
    search = study.search
    is_default = search.objectives == TuneRequest.objectives
    repeatable: dict[str, Sequence[str]] = {
        "--minimise": () if is_default else search.objectives,
        "--law": arguments.laws or (),
        "--vary": arguments.ranges,
        "--over": arguments.over,
        "--at-most": arguments.at_most,
        "--set": arguments.settings,
    }
    words = ["hertzloop", "tune", *arguments.scenes]
    words += [word for option, many in repeatable.items() for one in many for word in (option, one)]
    words += ["--span", search.span, "--generations", str(search.generations)]
    words += ["--population", str(search.population), "--phases", str(search.phases)]
    words += ["--seed", str(search.seed)]
    return shlex.join([*words, *(["--require-stable"] if search.require_stable else [])])


def _run_command(candidate: "Candidate", setup: Setup, name: str, arguments: TuneArguments) -> str:
    """Return the command that runs a scene with a setting.

    Args:
        candidate: The setting.
        setup: The scene with the setting.
        name: Name of the scene, as the user wrote it.
        arguments: Changes of keys and the seed.
    """
    known = {f"controller.{key}" for key, _ in setup.scene.controller}
    given = [text.strip() for text in arguments.settings]
    # A key of the scene's own law may be unknown to the law that was found.
    kept = [
        text
        for text in given
        if text.partition("=")[0].strip() in known or not text.startswith("controller.")
    ]
    keys = [f"{key}={toml_text(value)}" for key, value in candidate.values.items()]
    words = ["hertzloop", "run", name]
    words += [word for text in [*kept, *keys] for word in ("--set", text)]
    seed = arguments.seed
    return shlex.join(words if seed is None else [*words, "--seed", str(seed)])
