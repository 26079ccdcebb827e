"""The tree of commands: every entry has help and an example, and the start imports little."""

import os
import re
import shlex

import pytest

from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from tests.commands import invoke, succeed
from tests.hertzloop.commands import python

HEAVY = {"numpy", "numba", "scipy", "zenoh", "hertzloop.scene"}


def test_there_are_at_most_30_leaves_each_once():
    words = [entry.words for entry in all_commands()]
    assert len(words) == len(set(words)) <= 30


def test_the_help_fits_on_one_screen():
    lines = invoke(["--help"], env={"COLUMNS": "100"}).stdout
    assert len(lines.splitlines()) <= 40
    for entry in all_commands():
        assert entry.words.split()[0] in lines


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_the_help_of_a_command_fits_on_two_screens(entry):
    done = invoke([*entry.words.split(), "--help"], env={"COLUMNS": "100"})
    assert 5 < len(done.stdout.splitlines()) <= 80
    assert not re.findall(r"\d\.0<|x[<>]=?\d+\.0\b", done.stdout)  # a bound is a whole number


def test_run_has_its_expert_options_below_the_others():
    done = invoke(["run", "--help"], env={"COLUMNS": "100"})
    usual, expert = done.stdout.split("Expert options")
    for option in (
        "max-exchange-steps",
        "name",
        "timeout",
        "shared-memory",
        "realtime",
        "controller",
        "port",
    ):
        assert f"--{option} " in expert
        assert f"--{option} " not in usual


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
