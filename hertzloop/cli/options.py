"""Options that several commands have, declared once for their signatures."""

from collections.abc import Callable, Collection, Sequence
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic.fields import FieldInfo

from hertzloop.loop.run_options import USES, OptionError, Options, RunOptions, Use
from hertzloop.processes.program import BUS_NAME

# A scene, and what is simulated of it.
SceneArgument = Annotated[str, typer.Argument(help="Name of a shipped scene, or a .toml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", help="Change a scene key, for example sensors.bits=12.")
]
SeedOption = Annotated[
    int | None, typer.Option(help="Set the random seed; default: run.seed of the scene.")
]

# Input and output.
FileArgument = Annotated[Path, typer.Argument(help="Recording to read.", metavar="F.mcap")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write all metrics as JSON to this file and replace it; -: standard output.",
    ),
]
DetailsOption = Annotated[
    bool, typer.Option("--details", help="Print all tables, metrics and warnings.")
]

Command = Callable[..., None]


def run_options(*names: str, **defaults: Any) -> Callable[[Command], Command]:
    """Give a command options of a run; see `options_of`."""
    return options_of(RunOptions, *names, **defaults)


def options_of(
    kind: type[Options],
    *names: str,
    but: Sequence[str] = (),
    argument: str = "options",
    **defaults: Any,
) -> Callable[[Command], Command]:
    """Give a command options, which it gets as one argument of this kind.

    Args:
        kind: The class of this argument.
        names: Its fields that the command has as options; none: all with a description.
        but: Fields that the command does not have.
        argument: Name of this argument.
        defaults: Defaults that the command alone has.
    """
    uses = kind.uses()
    own = {
        name: _typer_option(name, kind.model_fields[name], uses[name])
        for name in names or uses
        if name not in but
    }
    return _given(argument, kind, own, defaults)


def run_options_of(role: str) -> Callable[[Command], Command]:
    """Give the command of a role its options of a run; see `run_options`."""
    names = [name for name, use in USES.items() if role in use.roles]
    return run_options(*names, realtime="auto", name=BUS_NAME)


def _typer_option(name: str, field: FieldInfo, use: Use) -> Any:
    """Return the annotation from which typer makes an option."""
    several = isinstance(field.default, tuple | dict)
    kind: Any = list[str] | None if several else field.annotation
    bounds: dict[str, Any] = {}
    for one in field.metadata:
        bounds |= {"min": one.ge} if hasattr(one, "ge") else {}
        bounds |= {"max": one.le} if hasattr(one, "le") else {}
    option = typer.Option(
        use.flag or f"--{name.replace('_', '-')}",
        help=(field.description or "").replace("[", "\\["),
        metavar=use.metavar,
        rich_help_panel=use.heading,
        **bounds,
    )
    return Annotated[kind, option]


def _given(
    argument: str, kind: Any, options: dict[str, Any], defaults: dict[str, Any]
) -> Callable[[Command], Command]:
    """Return a decorator that puts options in the place of one argument of a command.

    Args:
        argument: The argument, whose value is made of those options that have one.
        kind: Class of that value.
        options: Annotations of the options, by the names of fields of `kind`.
        defaults: Defaults that differ from those of the fields.
    """
    usual = vars(kind()) | defaults

    def decorated(command: Command) -> Command:
        @wraps(command)
        def called(**values: Any) -> None:
            found = {name: values.pop(name) for name in options}
            given = {name: value for name, value in found.items() if value is not None}
            command(**values, **{argument: kind(**given)})

        own: dict[str, Parameter] = {}
        for one in signature(command).parameters.values():
            if one.name != argument:
                own[one.name] = one.replace(kind=Parameter.KEYWORD_ONLY)
                continue
            for name, annotation in options.items():
                default = usual[name]
                if isinstance(default, tuple | dict):
                    default = list(default) or None  # typer makes lists of None
                own[name] = Parameter(
                    name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation
                )
        changed: Any = called
        changed.__signature__ = signature(command).replace(parameters=[*own.values()])
        changed.__annotations__ = {name: one.annotation for name, one in own.items()}
        return called

    return decorated


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
