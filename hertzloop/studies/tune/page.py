"""The page of a tuning: chart and table of the settings found."""

from hertzloop.scene.setup import parse
from hertzloop.studies.pages import words
from hertzloop.studies.pages.html import ResultChart, ResultPage, ResultTable, svg
from hertzloop.studies.tune.chart import front_sheet
from hertzloop.studies.tune.result import TuneResult


def tune_page(tuned: TuneResult) -> ResultPage:
    """Return the page of a tuning. Raises SceneError if one of its scenes cannot be read."""
    objectives = tuple(tuned.minimise)
    names = [words.against_none(name) for name in objectives]
    keys = sorted({key for found in tuned.front for key in found.values} - {"controller.law"})
    rows = []
    for found in [*tuned.front, tuned.published]:
        law = words.law(str(found.values["controller.law"]))
        cells = [law + (" (published)" if found is tuned.published else "")]
        cells += [f"{found.metrics[name]:z.3f}" for name in objectives]
        cells += [str(found.spreads[name]) if name in found.spreads else "" for name in objectives]
        rows.append([*cells, *(words.short(found.values.get(key, "")) for key in keys)])
    headings = (
        "law",
        *names,
        *(f"{name}, over touch phases: mean (least to most)" for name in names),
        *map(words.key_words, keys),
    )
    scenes = [(parse(text, recorded=True), text) for text in tuned.scenes]
    title = "Tuning of " + ", ".join(setup.name for setup, _ in scenes)
    limits = "".join(f", {words.against_none(k)} at most {v:g}" for k, v in tuned.at_most.items())
    worst = "; the worst of the scenes counts" if len(scenes) > 1 else ""
    lines = [
        *(words.scene_words(setup) for setup, _ in scenes),
        f"Minimised: {', '.join(names)}{limits}; metrics of {words.SPANS[tuned.span]}{worst}.",
        tuned.verdict,
    ]
    picture = front_sheet("", tuned)
    return ResultPage(
        title=title,
        lines=lines,
        charts=[ResultChart("Pareto-optimal settings", svg(picture))],
        tables=[ResultTable("Settings", headings, rows, "Click on a heading to sort.", sorts=True)],
        warnings=[f"{len(tuned.failed)} cases could not be run"] if tuned.failed else [],
        commands=[tuned.command],
        versions=tuned.versions,
        scenes=[(setup.name, text) for setup, text in scenes],
    )
