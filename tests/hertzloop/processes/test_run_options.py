"""Options of a run: the commands, Python's keywords and the roles are made of one model."""

import inspect
from pathlib import Path

import pytest

import hertzloop
from hertzloop.bus.streams import ROLES
from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from hertzloop.loop.run_options import USES, RunOptions

UNUSUAL = RunOptions(
    overwrite=True,
    horizon=7,
    name="mine",
    timeout_s=9.0,
    fast_lane=False,
    realtime="on",
    repeat=Path("a.mcap"),
    note="-- new tip",
)
PACED = RunOptions(name="mine", pace=0.5)  # which excludes horizon and repeat


def parameters_of(words, given=()):
    [entry] = [entry for entry in all_commands() if entry.words == words]
    return app.load_command(entry).make_context(words, list(given)).params


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("options", [UNUSUAL, PACED])
def test_a_role_gets_each_option_that_is_marked_for_it(role, options):
    given = parameters_of(f"node {role}", options.words(role))
    shared = [name for name, use in USES.items() if role in use.roles]
    assert {name: given[name] for name in shared} == {
        name: getattr(options, name) for name in shared
    }


def test_each_option_is_one_of_the_command_run():
    given = parameters_of("run")
    assert USES.keys() <= given.keys()
    own = {name: given[name] for name in USES if name != "realtime"}
    assert own == {name: getattr(RunOptions(), name) for name in own}


def test_python_has_the_options_that_are_marked_for_it():
    keywords = inspect.signature(hertzloop.run).parameters
    marked = {name for name, use in USES.items() if use.python}
    assert marked == keywords.keys() - {"scene", "recording", "on_progress"}
    assert all(f"{name}: " in hertzloop.run.__doc__ for name in marked)
    with pytest.raises(TypeError, match="horizons"):
        hertzloop.run("aluminium-3mm", horizons=3)
