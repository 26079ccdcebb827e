"""Tables and lines of the terminal."""

from collections.abc import Iterable
from itertools import chain
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text


class Table(RichTable):
    """A table of which no cell is cut: it keeps all words whole where they fit side by side, and
    breaks long ones where they do not."""

    def __init__(
        self, *headings: str, right: Iterable[str] = (), title: str | None = None,
        show_header: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(title=title, title_justify="left", show_header=show_header)
        for heading in headings:
            self.add_column(heading)
        for heading in right:  # columns of numbers
            self.add_column(heading, justify="right")

    def add_column(self, *args: Any, **options: Any) -> None:
        """Add a column; see rich."""
        super().add_column(*args, **options | {"overflow": options.get("overflow", "fold")})

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Give every column its longest word and let the narrowest grow first; where even these
        words do not fit, break those of the widest columns first, so that numbers stay whole."""
        sizes = [
            [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
            for column in self.columns
        ]
        least = [max(size.minimum for size in column) for column in sizes]
        most = [max(size.maximum for size in column) for column in sizes]
        room = options.max_width - 3 * len(sizes) - 1  # padding and rules
        levels = range(max(most, default=1), 0, -1)
        grown = ([min(b, max(a, level)) for a, b in zip(least, most, strict=True)]
                 for level in levels)  # fmt: skip
        broken = ([min(a, level) for a in least] for level in levels)
        widths = next((w for w in chain(grown, broken) if sum(w) <= room), [1] * len(sizes))
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)


def unwrapped(*pieces: str | tuple[str, str]) -> Text:
    """A line of pieces, each a string or (string, style), that the terminal alone breaks: paths and
    commands in it can be copied whole."""
    return Text.assemble(*pieces, no_wrap=True, overflow="ignore")


def print_all(console: Console, pieces: Iterable[RenderableType]) -> None:
    """Print lines and tables, one below the other."""
    console.print(Group(*pieces), crop=False)
