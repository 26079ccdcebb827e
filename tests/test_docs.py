"""The documentation: code blocks run as they stand, commands exist, pages build."""

import importlib
import importlib.util
import re
import shlex
from dataclasses import fields
from pathlib import Path

import pytest
import typer

import hertzloop
from benchmarks.program import app_of
from hertzloop.bus.streams import STREAMS
from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from hertzloop.results.span_metrics import SpanMetrics
from hertzloop.scene.keys import keys, page
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.sweep.request import SweepRequest
from tests import metric_page, python_page
from tests.hertzloop.commands import python

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
EVERY = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
PAGES = sorted(
    page.relative_to(DOCS) for page in DOCS.rglob("*.md") if "```python\n" in page.read_text()
)


@pytest.mark.full
@pytest.mark.parametrize("page", PAGES, ids=str)
def test_the_python_of_a_page_runs(page, tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    script = tmp_path / "page.py"
    script.write_text("import matplotlib\nmatplotlib.use('Agg')\n" + "\n".join(blocks))
    python(script, cwd=tmp_path)


def commands(page: Path) -> list[list[str]]:
    """Command lines of hertzloop in a page's plain blocks."""
    blocks = re.findall(r"```\w*\n(.*?)```", page.read_text(), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("hertzloop ")]


@pytest.mark.parametrize("page", EVERY, ids=lambda page: page.name)
def test_documented_commands_exist(page):
    """Command and options; the files that they name need not be there."""
    for words in commands(page):
        [entry] = [
            entry
            for entry in all_commands()
            if words[1:][: len(entry.words.split())] == entry.words.split()
        ]
        command, rest = app.load_command(entry), words[1 + len(entry.words.split()) :]
        options = {
            name for option in command.params for name in (*option.opts, *option.secondary_opts)
        }
        for word in rest:
            assert not word.startswith("--") or word.partition("=")[0] in options, (words, word)


PROGRAM = re.compile(r"python -m ((?:benchmarks|paper)\.\w+)((?: [^`\n]*)?)")


@pytest.mark.parametrize("page", EVERY, ids=lambda page: page.name)
def test_documented_programs_exist(page):
    """Module and options of every program that is named, in a block or within a sentence."""
    for name, rest in PROGRAM.findall(page.read_text()):
        command = typer.main.get_command(app_of(importlib.import_module(name).main))
        options = {option for param in command.params for option in param.opts}
        for word in rest.split():
            assert not word.startswith("-") or word.partition("=")[0] in options, (name, word)
    for name in re.findall(r"python -m (tests\.[\w.]+)", page.read_text()):
        assert importlib.util.find_spec(name), name


def test_every_program_has_its_line():
    told = {name for page in EVERY for name, _ in PROGRAM.findall(page.read_text())}
    for package in ("benchmarks", "paper"):
        for path in (ROOT / package).glob("*.py"):
            if "\ndef main(" in path.read_text():
                assert f"{package}.{path.stem}" in told


def test_every_command_has_its_line():
    told = (DOCS / "reference" / "commands.md").read_text()
    for entry in all_commands():
        assert re.search(rf"`(hertzloop )?{entry.words}\b", told), entry.words


@pytest.mark.full
def test_the_site_builds_strictly(tmp_path):
    # Without --quiet, with which MkDocs does not count the warnings that --strict refuses.
    python("-m", "mkdocs", "build", "--strict", "-d", tmp_path, cwd=ROOT)
    assert (tmp_path / "how-to" / "laws" / "index.html").exists()


def test_every_key_is_explained():
    assert [key.name for key in keys() if not key.meaning or len(key.meaning) > 200] == []


def test_the_page_of_keys_is_what_the_code_says():
    """Mend: hertzloop scene keys --markdown > docs/reference/keys.md"""
    assert (DOCS / "reference" / "keys.md").read_text() == page()


def test_the_page_of_metrics_is_what_the_code_says():
    """Mend: python -c 'from tests import metric_page as p; print(p.page(), end="")'"""
    assert (DOCS / "reference" / "metrics.md").read_text() == metric_page.page()


def test_the_page_of_python_is_what_the_code_says():
    """Mend: python -m tests.python_page"""
    assert python_page.PAGE.read_text() == python_page.page()


def test_every_public_name_has_its_entry_and_its_line():
    text = python_page.PAGE.read_text()
    entries = dict(re.findall(r"^### `(\w+).*`\n\n(.*)$", text, re.M))
    entries |= dict(re.findall(r"^- `([A-Z]\w+)`: (.*)$", text, re.M))
    assert {*dir(hertzloop), "hertzloop_run"} - {"__version__"} <= entries.keys()
    assert [name for name, line in entries.items() if len(line) < 10] == []
    for name in (*SweepRequest.model_fields, *BudgetRequest.model_fields):
        assert f"`{name}`" in text
    metrics = (DOCS / "reference" / "metrics.md").read_text()
    for one in fields(SpanMetrics):
        assert f"- `{one.name}`: " in metrics


def test_the_topics_of_a_recording():
    text = (DOCS / "reference" / "recording-format.md").read_text()
    rows = re.findall(r"^- `(/\w+)`, `(\S+)`: ", text, re.M)
    kept = {s.topic: (s.recorded_as or s.message).DESCRIPTOR.full_name for s in STREAMS.values()}
    assert rows == list(kept.items())


def test_links_outside_the_site_lead_to_files():
    """The site checks the links within docs."""
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        for link in re.findall(r"\]\(([^)#:]+)[#)]", (ROOT / name).read_text()):
            assert (ROOT / link).exists(), (name, link)


FOLDERS = "benchmarks|bus|common|controller|docs|hertzloop|paper|plant|recordings|sensors|tests"


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", *EVERY], ids=lambda page: page.name)
def test_named_files_exist(page):
    for name in re.findall(rf"`((?:{FOLDERS})/[\w/]*(?:/|\.\w+))`", page.read_text()):
        assert (ROOT / name).exists(), name


def test_citation_and_changelog_have_the_version():
    version = hertzloop.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert (ROOT / "CHANGELOG.md").read_text().partition("\n## [")[2].startswith(f"{version}] - ")


def test_the_tour_leads_through_names_that_exist():
    tour = (DOCS / "explanation" / "tour.md").read_text()
    stops = re.findall(r"^\d+\. `(.+?)`, `(.+?)`: ", tour, re.M)
    assert len(stops) <= 16
    assert sum(len((ROOT / file).read_text().splitlines()) for file, _ in stops) <= 3000
    for file, name in stops:
        defined = rf"^(?:(?:def|class) {name}\b|{name}\b.* = )"
        assert re.search(defined, (ROOT / file).read_text(), re.M), (file, name)
