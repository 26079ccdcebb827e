"""The tree of commands: every entry has help and an example, and the start imports little."""

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hertzloop.cli import app
from hertzloop.cli.commands import CommandEntry, all_commands

HEAVY = {"numpy", "numba", "scipy", "zenoh", "hertzloop.scene"}


def called(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hertzloop", *words], capture_output=True, text=True, check=False
    )


def here(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and output of a command line in this process."""
    with pytest.raises(SystemExit) as end:
        app.root_command().main(words, prog_name="hertzloop")
    said = capsys.readouterr()
    return int(str(end.value.code or 0)), said.out + said.err


def commands() -> Iterator[tuple[CommandEntry, Any]]:
    for entry in all_commands():
        yield entry, app.load_command(entry)


def test_there_are_at_most_30_leaves_each_once() -> None:
    words = [entry.words for entry in all_commands()]
    assert len(words) == len(set(words)) <= 30


def test_the_help_fits_on_one_screen() -> None:
    done = called(["--help"])
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) <= 50
    for entry in all_commands():
        assert entry.words.split()[0] in done.stdout


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_each_help_starts_with_its_purpose_and_ends_with_an_example(
    entry: CommandEntry, capsys: pytest.CaptureFixture[str]
) -> None:
    command = app.load_command(entry)
    first = command.help.split("\n\n")[0].replace("\n", " ").strip()
    assert first == entry.summary
    assert command.epilog == f"Example: hertzloop {entry.example}"
    assert entry.example.startswith(entry.words)
    code, text = here([*entry.words.split(), "--help"], capsys)
    assert code == 0
    assert "Example: hertzloop" in text


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_each_example_is_a_command_line_that_the_command_accepts(entry: CommandEntry) -> None:
    command = app.load_command(entry)
    words = shlex.split(entry.example)[len(entry.words.split()) :]
    context = command.make_context(entry.words, words, resilient_parsing=False)
    assert context is not None


@pytest.mark.parametrize("entry", all_commands(), ids=lambda entry: entry.words)
def test_each_refuses_an_unknown_option(
    entry: CommandEntry, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = here([*entry.words.split(), "--nonsense"], capsys)
    assert code == 2
    assert "--nonsense" in text


def test_out_is_a_file_and_out_dir_a_folder() -> None:
    for entry, command in commands():
        for parameter in command.params:
            options = [o for o in parameter.opts if o in ("--out", "--out-dir")]
            for option in options:
                assert "-o" in parameter.opts or entry.words == "export-plant"
                words = (parameter.help or "").lower()
                assert ("folder" in words) is (option == "--out-dir"), f"{entry.words} {option}"


def test_quiet_prints_nothing_and_json_goes_to_standard_output(tmp_path: Path) -> None:
    short = ["--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1"]
    sweep = ["sweep", "aluminium-3mm", "--over", "controller.latency_us=0,1", *short]
    sweep += ["--workers", "1", "--out", str(tmp_path / "a.csv")]
    assert called(["scene", "list", "--quiet"]).stdout == ""
    assert called(["-q", "scene", "list"]).stdout == ""
    done = called([*sweep, "--json", "-", "--quiet"])
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["cases"] == 2


def test_help_and_version_import_no_numerics() -> None:
    for words in (["--version"], ["--help"], ["scene", "--help"]):
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
