"""Documentation, help and errors are in plain English: no coined words, no sentence over 35 words.

The table of words is short on purpose. It holds phrases that the project used in a sense of its
own, and for which the field has a standard term.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from hertzloop.cli import app
from hertzloop.cli.commands import all_commands

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
# The page of scene keys is printed by the code, which `tests/test_docs.py` compares.
PRINTED = DOCS / "reference" / "keys.md"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if page != PRINTED),
]
LONGEST = 35  # words in a sentence
FOLDERS = ("hertzloop", "common", "plant", "sensors", "controller", "bus", "recordings")

# A coined phrase, as a regular expression, and the standard term.
REFUSED = {
    r"what is struck|struck (?:point|face)": "structure; contact point",
    r"(?:energy )?books?|ledger": "energy and momentum balance; residual",
    r"the (?:same )?door": "law loader; plug-in interface",
    r"the plant elsewhere": "Export the plant (FMU, C library)",
    r"strangers?|guests?": "unauthorised peer; other subscriber",
    r"vouch(?:es)?|last words|g(?:ives?|ave) up": "confirm completion; final message; time out",
    r"what (?:a|the) run leaves out|(?<!if )left out": "neglected effects; omitted",
    r"what ran": "name the thing: law, scene, version",
    r"digits that can be known": "predictable digits; prediction horizon",
    r"rows of truth": "time series; samples",
    r"law-on": "replay a recording through a law",
    r"control does harm|does harm": "Control increases plate energy by ... dB",
}
# Words that are right where they stand: names of streams, columns and options in code are removed
# before the search, so this holds prose alone.


def prose(text: str) -> str:
    """Return a page without code, tables, comments, headings and addresses of links."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"```.*?```", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"^(?: {4}|\t).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(?:\||#).*$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`]*`", "CODE", text)
    return re.sub(r"\]\([^)]*\)", "]", text)


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of prose; an item of a list and a paragraph end a sentence."""
    for paragraph in re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s", text):
        flat = re.sub(r"\s+", " ", paragraph).strip()
        yield from filter(None, re.split(r"(?<=[.:;?!])(?:\*\*)?\s+", flat))


def coined(text: str) -> list[str]:
    """Return each coined phrase of a text, with the term to use."""
    return [
        f"'{found[0]}': write '{term}'"
        for phrase, term in REFUSED.items()
        for found in re.finditer(rf"\b(?:{phrase})\b", text, re.IGNORECASE)
    ]


def raised(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string in the raise statements and failures of a module."""
    for node in ast.walk(ast.parse(path.read_text())):
        fails = isinstance(node, ast.Call) and ast.unparse(node.func) == "fail"
        if not (fails or (isinstance(node, ast.Raise) and node.exc)):
            continue
        # An f-string is one text, with its values as a word.
        for part in ast.walk(node):
            if isinstance(part, ast.JoinedStr):
                values = [getattr(value, "value", "") for value in part.values]
                yield part.lineno, "".join(v if isinstance(v, str) else "CODE" for v in values)
            elif isinstance(part, ast.Constant) and isinstance(part.value, str):
                yield part.lineno, part.value


def helps() -> Iterator[tuple[str, str]]:
    """Yield every command with its summary, its example and all help texts of its page."""
    for entry in all_commands():
        command = app.load_command(entry)
        told = [entry.summary, entry.example, command.help or "", command.epilog or ""]
        told += [getattr(param, "help", None) or "" for param in command.params]
        yield entry.words, "\n".join(told)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_plain(page):
    text = re.sub(r"```.*?```|`[^`]*`", "CODE", page.read_text(), flags=re.DOTALL)
    assert coined(re.sub(r"\]\([^)]*\)", "]", text)) == []
    long = [one for one in sentences(prose(page.read_text())) if len(one.split()) > LONGEST]
    assert long == []


def test_help_has_no_coined_words():
    assert {words: found for words, text in helps() if (found := coined(text))} == {}


@pytest.mark.parametrize("folder", FOLDERS)
def test_errors_have_no_coined_words(folder):
    found = {
        f"{path.relative_to(ROOT)}:{line}": words
        for path in (ROOT / folder).rglob("*.py")
        if "_pb2" not in path.name
        for line, text in raised(path)
        if (words := coined(text))
    }
    assert found == {}
