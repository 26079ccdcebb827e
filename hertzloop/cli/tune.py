"""The command `tune`."""

import math
import re
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hertzloop.cli import options
from hertzloop.cli.study_frame import resumable
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.atomic_files import write_whole
from hertzloop.common.optional_dependencies import need
from hertzloop.loop.run_options import words_of
from hertzloop.results.cases import OBJECTIVES
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.plant_checks import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml, toml_text
from hertzloop.studies.margin.shown import unstable_line
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.design import Design, DesignError, check_keys, parse_axis
from hertzloop.studies.sweeps.evaluate import CaseTally
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.sweeps.sweep import code_version
from hertzloop.views.format import Table, unwrapped

if TYPE_CHECKING:
    from hertzloop.studies.margin.margin import Growth
    from hertzloop.studies.tuning import Found, Tuned

_MOST_ROWS = 15
_PARTS = ("mean", "least", "most")  # of a spread over touch phases


@options.takes()
def tune(
    search: TuneRequest,
    scenes: Annotated[list[str] | None, typer.Argument()] = None,
    laws: Annotated[list[str] | None, typer.Option("--law")] = None,
    ranges: Annotated[list[str] | None, typer.Option("--vary")] = None,
    over: list[str] | None = None,
    at_most: list[str] | None = None,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    folder: Annotated[Path | None, typer.Option("--out-dir", "-o", metavar="DIR")] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Search for the law and the parameters with the best figures in a scene.

    The search respects the scene's latency, bits and force limit. A killed search goes on with the
    same command.

    Args:
        scenes: Names of scenes or .toml files; the worst result counts.
        laws: Tune this law, or all; repeatable; default: the law of the scene.
        ranges: Search a scene key over key=low:high or key=a,b,c; default: the ranges of the law.
        over: Require robustness over these values, for example sphere.radius_m=0.002,0.004.
        at_most: Limit a figure, for example rebound_percent=120.
        folder: Write chart and settings into this folder.
    """
    need("matplotlib", "pymoo")
    from hertzloop.studies import tuning  # of an extra
    from hertzloop.studies.tuning import LAWS, Tuned

    options.check_json(json_file)
    bases = [options.scene_from(name, settings, seed) for name in scenes or [DEFAULT]]
    for base in bases:
        check_conserves(base.scheme)
    search = replace(
        search, objectives=tuple(search.objectives), at_most=_limits(at_most or []),
        seed=1 if seed is None else seed,
    )  # fmt: skip
    objectives = search.objectives
    for figure in (*objectives, *search.at_most):
        if figure not in OBJECTIVES:
            fail(f"--minimise = '{figure}': unknown figure. Use one of {', '.join(OBJECTIVES)}.")
    chosen = list(LAWS) if laws == ["all"] else laws or [bases[0].law_reference]
    given = tuple(parse_axis(text) for text in ranges or [])
    check_keys(given, "--vary")
    around = _cases_of(over or [])
    for axis in given:
        if axis.key in around[0]:
            fail(f"{axis.key}: is given to both --vary and --over. Remove one of them.")
    tried = [base.vary(case) for base in bases for case in around]
    speed = tuning.fastest_m_s(tried)
    for law in chosen:
        for base, case in product(bases, around):  # the law may not have a key of the case
            of_law = {**case, "controller.law": law}
            options.check_law(base.vary(of_law))
            for axis in given:
                for value in axis.values or (axis.low, axis.high):
                    base.vary({**of_law, axis.key: value})
        tuning.axes_of(law, given, speed)
    options.make_folder(folder or Path())  # for what is unfinished, too
    options.compile_first(*bases)
    tally = CaseTally()
    names = [base.name for base in bases]
    header = tuning.header_of(tried, tuple(chosen), given, search)
    with resumable(folder or Path(), _file_name(names), header) as finished:
        try:
            steps = search.generations * len(chosen)
            with local_pool() as some, progress("tuning", steps) as advance:
                cores = finished.of(some)
                pool = tally.of(cores)
                reference = tuning.published(pool, tried, search.span, objectives, search.phases)
                best = tuning.best_of(pool, tried, chosen, given, search, advance)
                reference, *best = tuning.with_spreads(
                    cores, tried, search.span, [reference, *best], objectives
                )
        except SceneError as error:
            fail(str(error), 1)
        verdict = _verdict(best, reference, objectives) if best else []
        if best:
            out.print(_table(best, reference, objectives))
            for line in verdict:
                out.say(line)
            chosen_one = _winner(best, reference, objectives) or best[0]
            best_scenes = [base.vary(chosen_one.values) for base in bases]
            repeats = [
                _repeating(chosen_one, setup, name, settings, seed)
                for setup, name in zip(best_scenes, scenes or [DEFAULT], strict=True)
            ]
            growths = [tuning.unstable_loop(tried, found.values) for found in best]
            _say_unstable(growths, growths[best.index(chosen_one)])
            out.print(f"Repetition of the best setting ({_words(chosen_one.values)}):")
            for line in repeats:
                out.say(f"  {line}")
            default = search.objectives == TuneRequest.objectives
            lists: list[tuple[str, Sequence[str] | None]] = [
                ("minimise", [] if default else objectives), ("law", laws), ("vary", ranges),
                ("over", over), ("at-most", at_most), ("set", settings),
            ]  # fmt: skip
            words = _command(scenes or [DEFAULT], lists, search)
            tuned = Tuned(
                [to_toml(base.scene) for base in bases], objectives, search.span, search.at_most,
                best, reference,
                verdict, len(tally.not_run), words, code_version(),
            )  # fmt: skip
            if folder is not None:
                _write(folder, names, tuned, best_scenes)
    not_run = [row["status"] for row in tally.not_run]
    if not best:
        options.end_if_not_run(not_run, tally.cases)
        fail(
            "no setting has all figures within --at-most, or meets --require-stable: the loop may "
            "be unstable, or nothing may rebound. Try --span run or other ranges.",
            1,
        )
    front = [
        asdict(f) | {"unstable_loop": None if g is None else asdict(g)}
        for f, g in zip(best, growths, strict=True)
    ]
    options.write_json(
        json_file,
        {"front": front, "published": asdict(reference), "verdict": verdict,
         "cases": tally.cases, "ran": finished.ran, "failed": len(not_run)},
    )  # fmt: skip
    options.end_if_not_run(not_run, tally.cases)


def _say_unstable(growths: "list[Growth | None]", of_best: "Growth | None") -> None:
    """Print which settings have an unstable linear loop, and how that of the best one grows."""
    unstable = sum(growth is not None for growth in growths)
    if unstable:
        said = f" in {unstable} of {len(growths)} settings. --require-stable refuses these."
        out.say(unwrapped(("Linear loop unstable", "bold red"), said))
    if of_best is not None:
        out.say(f"The loop of the best setting {unstable_line(of_best)}")


def _file_name(names: list[str]) -> str:
    return "tune-" + "-".join(names)


def _command(
    scenes: list[str], lists: list[tuple[str, Sequence[str] | None]], search: TuneRequest
) -> str:
    line = ["hertzloop", "tune", *scenes]
    for option, given in lists:
        line += [word for value in given or [] for word in (f"--{option}", value)]
    rest = words_of(replace(search, objectives=(), require_stable=False))
    last = ["--seed", str(search.seed), *["--require-stable"] * search.require_stable]
    return shlex.join([*line, *rest, *last])


def _repeating(
    found: "Found", setup: Setup, name: str, settings: list[str] | None, seed: int | None
) -> str:
    """The command that runs a scene, called `name`, with a setting, which makes it `scene`."""
    known = {f"controller.{key}" for key, _ in setup.scene.controller}
    given = [text.strip() for text in settings or []]
    # A key of the scene's own law may be unknown to the law that was found.
    kept = [
        text
        for text in given
        if text.partition("=")[0].strip() in known or not text.startswith("controller.")
    ]
    keys = [f"{key}={toml_text(value)}" for key, value in found.values.items()]
    line = ["hertzloop", "run", name]
    line += [word for text in [*kept, *keys] for word in ("--set", text)]
    return shlex.join(line if seed is None else [*line, "--seed", str(seed)])


def _write(folder: Path, names: list[str], tuned: "Tuned", best_scenes: list[Setup]) -> None:
    """Settings as CSV, all that was found as JSON, the chart, and every scene with the best
    setting. Raises NotWritten."""
    from hertzloop.studies.tuning import draw_front, write_tuned
    from hertzloop.studies.words import write_rows

    name = _file_name(names)
    best, objectives = tuned.front, tuple(tuned.objectives)
    keys = sorted({key for f in best for key in f.values})
    headings = [*objectives, *(f"{o}_{part}" for o in objectives for part in _PARTS), *keys]
    rows = (
        [*f.figures.values(), *(getattr(f.spreads[o], part) for o in objectives for part in _PARTS),
         *(f.values.get(key, "") for key in keys)]
        for f in best
    )  # fmt: skip
    write_rows(folder / f"{name}.csv", headings, rows)
    write_tuned(folder / f"{name}.json", tuned)
    draw_front(folder / f"{name}.png", ", ".join(names), best, tuned.published, objectives)
    for setup in best_scenes:
        write_whole(folder / f"tuned-{setup.name}.toml", to_toml(setup.scene))
    out.say(
        f"written: {folder}/{name}.csv, .json and .png; with the best setting: "
        + ", ".join(f"{folder}/tuned-{setup.name}.toml" for setup in best_scenes)
    )


def _cases_of(over: list[str]) -> list[dict[str, Any]]:
    """All combinations of the values to be robust over. Raises DesignError."""
    axes = tuple(parse_axis(text) for text in over)
    check_keys(axes)
    for axis in axes:
        if not axis.values:
            raise DesignError(
                f"--over {axis.key}={axis.low:g}:{axis.high:g} has no step; write "
                f"{axis.key}=low:high:step or {axis.key}=a,b,c"
            )
    return Design(axes).cases()


def _limits(texts: list[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*(\S+)\s*", text)
        with suppress(ValueError):
            if match and math.isfinite(float(match[2])):
                found[match[1]] = float(match[2])
                continue
        fail(
            f"--at-most = '{text}': invalid limit. Write figure=number, as in rebound_percent=120."
        )
    return found


def _words(values: dict[str, Any]) -> str:
    rest = [f"{key.split('.')[-1]} {value:.4g}" for key, value in values.items()
            if isinstance(value, int | float)]  # fmt: skip
    return f"{values['controller.law']}: {', '.join(rest)}"


def _table(best: "list[Found]", reference: "Found", objectives: Sequence[str]) -> Table:
    settings = "setting" if len(best) == 1 else "settings"
    right = [*objectives, f"{objectives[0]} over touch phases"]
    table = Table(right=right, title=f"{len(best)} Pareto-optimal {settings}")
    table.add_column("law and parameters")
    step = max(1, -(-len(best) // _MOST_ROWS))
    for f in [*best[::step], reference]:
        note = " (published)" if f is reference else ""
        spread = str(f.spreads[objectives[0]])
        table.add_row(*(f"{v:z.3f}" for v in f.figures.values()), spread, _words(f.values) + note)
    return table


def _winner(best: "list[Found]", reference: "Found", objectives: Sequence[str]) -> "Found | None":
    """The setting that beats the published one; None if there is none."""
    from hertzloop.studies.tuning import better_than

    return better_than(reference, best, objectives[0], objectives[1 if objectives[1:] else 0])


def _verdict(best: "list[Found]", reference: "Found", objectives: Sequence[str]) -> list[str]:
    first, rest = objectives[0], objectives[1:]
    keep = rest[0] if rest else first
    winner = _winner(best, reference, objectives)
    if winner is None:
        return [f"none beats the published setting in {first} without raising {keep}"]
    gained = reference.figures[first] - winner.figures[first]
    also = f" at {keep} {winner.figures[keep]:z.3f} against {reference.figures[keep]:z.3f}"
    return [f"{_words(winner.values)} beats the published setting in {first} by {gained:z.3f}"
            + (also if rest else "")]  # fmt: skip
