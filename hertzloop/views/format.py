"""Tables and lines of the terminal."""

from collections.abc import Iterable
from itertools import chain
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text


class Table(RichTable):
    """A table that cuts no cell: it breaks lines between words, and long words only if they do not
    fit side by side.

    Args:
        headings: Headings of columns with text.
        right: Headings of the columns after them, which hold numbers.
        title: Title above the table.
        show_header: Whether the headings are printed.
    """

    def __init__(
        self,
        *headings: str,
        right: Iterable[str] = (),
        title: str | None = None,
        show_header: bool = True,
    ) -> None:
        super().__init__(title=title, title_justify="left", show_header=show_header)
        for heading in headings:
            self.add_column(heading)
        for heading in right:
            self.add_column(heading, justify="right")

    def add_column(self, *args: Any, **options: Any) -> None:
        """Add a column; see rich."""
        super().add_column(*args, **options | {"overflow": options.get("overflow", "fold")})

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Choose the widths of the columns, and print.

        Each column gets the width of its longest word, and the narrowest columns grow first. If
        these words do not fit, those of the widest columns break first, so that numbers stay on
        one line.
        """
        sizes = [
            [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
            for column in self.columns
        ]
        longest_words = [max(size.minimum for size in column) for column in sizes]
        full = [max(size.maximum for size in column) for column in sizes]
        available = options.max_width - 3 * len(sizes) - 1  # without padding and rules
        levels = range(max(full, default=1), 0, -1)
        with_whole_words = (
            [min(whole, max(word, level)) for word, whole in zip(longest_words, full, strict=True)]
            for level in levels
        )
        with_broken_words = ([min(word, level) for word in longest_words] for level in levels)
        choices = chain(with_whole_words, with_broken_words)
        widths = next((w for w in choices if sum(w) <= available), [1] * len(sizes))
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)


def unwrapped(*pieces: str | tuple[str, str]) -> Text:
    """Return a line that only the terminal breaks, so that paths and commands can be copied.

    Args:
        pieces: Strings, or pairs of string and style.
    """
    return Text.assemble(*pieces, no_wrap=True, overflow="ignore")


def print_all(console: Console, pieces: Iterable[RenderableType]) -> None:
    """Print lines and tables, one below the other."""
    console.print(Group(*pieces), crop=False)
