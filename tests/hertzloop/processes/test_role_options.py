"""What the launcher passes on to the roles: each option that the command of a role has."""

from dataclasses import fields
from pathlib import Path

import pytest

from hertzloop.bus.streams import ROLES
from hertzloop.cli import app
from hertzloop.cli.commands import all_commands
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.launcher import role_options

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


@pytest.mark.parametrize("role", ROLES)
def test_a_role_gets_each_option_that_its_command_has(role):
    [entry] = [entry for entry in all_commands() if entry.words == f"node {role}"]
    for options in (UNUSUAL, PACED):
        words = role_options(role, "mine", options)
        given = app.load_command(entry).make_context(role, words).params
        shared = [field.name for field in fields(RunOptions) if field.name in given]
        assert {name: given[name] for name in shared} == {
            name: getattr(options, name) for name in shared
        }
        assert {"name", "timeout_s", "realtime"} <= set(shared)
        assert options is PACED or all(
            getattr(UNUSUAL, name) != getattr(RunOptions(), name) for name in {*shared} - {"pace"}
        )
