"""Options that a command was given, but does not use."""

from collections.abc import Collection

import typer

from hertzloop.loop.run_options import OptionError


def check_unused(context: typer.Context, unused: Collection[str], why: str) -> None:
    """Refuse options that have no effect.

    Args:
        context: The command, as it was called.
        unused: Names of its parameters that have no effect.
        why: Ends the sentence, for example "with --check".

    Raises:
        OptionError: The user gave one of them.
    """
    for parameter in context.command.params:
        name = parameter.name
        source = context.get_parameter_source(name) if name in unused else None
        if name is None or source is None or source.name != "COMMANDLINE":
            continue
        value = context.params[name]
        if parameter.param_type_name == "argument":
            given = f"{name.upper()} = {value}"
        elif isinstance(value, bool):
            given = parameter.opts[0] if value else parameter.secondary_opts[0]
        else:
            first = value[0] if isinstance(value, list | tuple) else value
            given = f"{parameter.opts[0]} = {first}"
        raise OptionError(f"{given}: has no effect {why}. Remove it.")


def check_only_used(context: typer.Context, used: Collection[str], why: str) -> None:
    """Refuse all options but those `used`; otherwise as `check_unused`."""
    names = {parameter.name for parameter in context.command.params if parameter.name}
    check_unused(context, names.difference(used), why)
