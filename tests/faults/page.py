"""docs/evidence/faults.md: the tables that series of faults print are put into it (`--page`)."""

from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "faults.md"


def put(name: str, command: str, table: str, page: Path = PAGE) -> None:
    """Replace what the page says between the marks of `name` by a command and what it printed.

    Raises ValueError if the page has no such marks.
    """
    begin, end = f"<!-- {name}: written by --page -->\n", f"<!-- end of {name} -->"
    text = page.read_text(encoding="utf-8")
    if begin not in text or end not in text:
        raise ValueError(f"{page} has no place for '{name}'")
    before, rest = text.split(begin, 1)
    after = rest.split(end, 1)[1]
    page.write_text(f"{before}{begin}\n`{command}`:\n\n{table}\n\n{end}{after}", encoding="utf-8")
