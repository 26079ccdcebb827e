"""Options of a run: the commands, Python's keywords and the roles are made of one model."""

import inspect

import pytest

import hertzloop
from hertzloop.bus.streams import ROLES
from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from hertzloop.loop.run_options import USES, RunOptions


def parameters_of(words, given=()):
    [entry] = [entry for entry in all_commands() if entry.words == words]
    return app.load_command(entry).make_context(words, list(given)).params


@pytest.mark.parametrize("role", ROLES)
def test_a_role_has_each_option_that_is_marked_for_it(role):
    shared = {name for name, use in USES.items() if role in use.roles}
    assert USES.keys() & parameters_of(f"node {role}").keys() == shared


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
