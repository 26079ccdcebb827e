"""HTML pages that need no other file, of a run or of the results of a study."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import jinja2
from matplotlib.figure import Figure


def svg(sheet: Figure) -> str:
    """Return a figure as an SVG element, without the document around it."""
    text = io.StringIO()
    sheet.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


@dataclass(frozen=True)
class ResultChart:
    """A picture on a page of results, as an SVG element."""

    title: str
    svg: str
    words: str = ""


@dataclass(frozen=True)
class ResultTable:
    """A table on a page of results."""

    title: str
    headings: Sequence[str]
    rows: list[list[str]]
    words: str = ""


@dataclass(frozen=True)
class ResultPage:
    """A page of the results of a study.

    Attributes:
        title: Heading of the page.
        lines: Sentences below the heading.
        charts: Pictures.
        tables: Tables.
        commands: Commands that make the results again.
        versions: Versions of the code that made the results.
        scenes: Name and text of each scene, and of the law.
        warnings: Sentences that stand out.
    """

    title: str
    lines: Sequence[str]
    charts: Sequence[ResultChart]
    tables: Sequence[ResultTable]
    commands: Sequence[str]
    versions: str
    scenes: Sequence[tuple[str, str]]
    warnings: Sequence[str] = ()

    def html(self) -> str:
        """Return the page as text."""
        settings = jinja2.Environment(
            loader=jinja2.PackageLoader("hertzloop.studies.pages", ""),
            autoescape=True,
            undefined=jinja2.StrictUndefined,
        )
        return settings.get_template("results.html.j2").render(vars(self))
