"""The tree of commands: every entry has help and an example, and the start imports little."""

import os
import shlex

import pytest

from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from tests.commands import succeed
from tests.hertzloop.commands import python

HEAVY = {"numpy", "numba", "scipy", "zenoh", "hertzloop.scene"}


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_help_has_a_purpose_and_an_example_that_is_accepted(entry):
    command = app.load_command(entry)
    assert command.help.split("\n\n")[0].replace("\n", " ").strip() == entry.summary
    assert command.epilog == f"Example: hertzloop {entry.example}"
    assert entry.example.startswith(entry.words)
    words = entry.example.removeprefix(entry.words)
    command.make_context(entry.words, shlex.split(words), resilient_parsing=False)


def test_out_is_a_file_and_out_dir_a_folder():
    for entry in all_commands():
        for parameter in app.load_command(entry).params:
            options = [o for o in parameter.opts if o in ("--out", "--out-dir")]
            for option in options:
                assert "-o" in parameter.opts or entry.words == "export-plant"
                words = (parameter.help or "").lower()
                assert ("folder" in words) is (option == "--out-dir"), f"{entry.words} {option}"


def test_quiet_prints_nothing():
    for words in (["scene", "list", "--quiet"], ["-q", "scene", "list"]):
        assert succeed(*words) == ""


def test_help_and_version_import_no_numerics():
    for words in (["--version"], ["scene", "--help"]):
        script = (
            f"import sys; sys.argv[1:] = {words!r}\nfrom hertzloop.__main__ import main\n"
            "try: main()\nexcept SystemExit: pass\n"
            f"print(sorted({HEAVY!r} & set(sys.modules)))"
        )
        assert python("-c", script).stdout.splitlines()[-1] == "[]"


def test_completion_knows_the_commands():
    environment = {"_HERTZLOOP_COMPLETE": "complete_bash", "COMP_WORDS": "hertzloop sce"}
    script = "from hertzloop.cli import app; app.root_command()(prog_name='hertzloop')"
    found = python("-c", script, env={**os.environ, **environment, "COMP_CWORD": "1"})
    assert found.stdout.split() == ["scene"]
