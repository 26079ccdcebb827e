"""The tree of commands: every entry has help and an example, and the start imports little."""

import os
import shlex
import subprocess
import sys

import pytest

from hertzloop.cli import app
from hertzloop.cli.commands import CommandEntry, all_commands
from tests.commands import succeed
from tests.hertzloop.commands import hertzloop

HEAVY = {"numpy", "numba", "scipy", "zenoh", "hertzloop.scene"}


def test_there_are_at_most_30_leaves_each_once() -> None:
    words = [entry.words for entry in all_commands()]
    assert len(words) == len(set(words)) <= 30


def test_the_help_fits_on_one_screen() -> None:
    done = hertzloop("--help")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) <= 50
    for entry in all_commands():
        assert entry.words.split()[0] in done.stdout


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_each_help_starts_with_its_purpose_and_ends_with_an_example(entry: CommandEntry) -> None:
    command = app.load_command(entry)
    first = command.help.split("\n\n")[0].replace("\n", " ").strip()
    assert first == entry.summary
    assert command.epilog == f"Example: hertzloop {entry.example}"
    assert entry.example.startswith(entry.words)
    assert "Example: hertzloop" in succeed(*entry.words.split(), "--help")


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_each_example_is_a_command_line_that_the_command_accepts(entry: CommandEntry) -> None:
    command = app.load_command(entry)
    words = shlex.split(entry.example)[len(entry.words.split()) :]
    context = command.make_context(entry.words, words, resilient_parsing=False)
    assert context is not None


def test_out_is_a_file_and_out_dir_a_folder() -> None:
    for entry in all_commands():
        for parameter in app.load_command(entry).params:
            options = [o for o in parameter.opts if o in ("--out", "--out-dir")]
            for option in options:
                assert "-o" in parameter.opts or entry.words == "export-plant"
                words = (parameter.help or "").lower()
                assert ("folder" in words) is (option == "--out-dir"), f"{entry.words} {option}"


def test_quiet_prints_nothing() -> None:
    for words in (["scene", "list", "--quiet"], ["-q", "scene", "list"]):
        assert succeed(*words) == ""


def test_help_and_version_import_no_numerics() -> None:
    for words in (["--version"], ["scene", "--help"]):
        script = (
            f"import sys; sys.argv[1:] = {words!r}\nfrom hertzloop.__main__ import main\n"
            "try: main()\nexcept SystemExit: pass\n"
            f"print(sorted({HEAVY!r} & set(sys.modules)))"
        )
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
        assert done.stdout.splitlines()[-1] == "[]", done.stdout[-300:] + done.stderr


def test_completion_knows_the_commands() -> None:
    environment = {"_HERTZLOOP_COMPLETE": "complete_bash", "COMP_WORDS": "hertzloop sce"}
    script = "from hertzloop.cli import app; app.root_command()(prog_name='hertzloop')"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False,
        env={**os.environ, **environment, "COMP_CWORD": "1"},
    )  # fmt: skip
    assert done.stdout.split() == ["scene"], done.stdout + done.stderr
