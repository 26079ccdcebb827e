"""Options that are declared once, as fields of a dataclass: the command line takes them, and a
command line can be made of them again."""

from collections.abc import Iterator, Sequence
from dataclasses import Field, field, fields
from typing import Any


class OptionError(ValueError):
    """An option has a value that cannot be. The message names the option."""

    exit_status = 2


def option(
    default: Any, words: str, *, name: str = "", roles: Sequence[str] = (),
    needs: Sequence[str] = (), **more: Any,
) -> Any:  # fmt: skip
    """A field of a dataclass that commands offer as an option.

    Args:
        default: The default.
        words: The help.
        name: In place of the field's.
        roles: Roles of a run that take it from the launcher, and whose commands offer it.
        needs: What it needs, in words that the checks of the dataclass know.
        more: What Typer's `Option` takes besides: bounds, a metavar.
    """
    about = {"help": words, "name": name, "roles": roles, "needs": needs, "typer": more}
    return field(default=default, metadata=about)


def options_of(kind: Any, role: str = "") -> Iterator[Field[Any]]:
    """Fields of a dataclass, or of an instance, that are options, or those of a role."""
    for one in fields(kind):
        if "help" in one.metadata and (not role or role in one.metadata["roles"]):
            yield one


def flag_of(one: Field[Any]) -> str:
    """What an option is called on the command line; of a switch that is on by default also the
    word that turns it off."""
    name = one.metadata["name"] or one.name.removesuffix("_s").replace("_", "-")
    return f"--{name}/--no-{name}" if one.default is True else f"--{name}"


def given_that_need(options: Any, what: str) -> Iterator[str]:
    """Names of the options that have a value and need something."""
    for one in options_of(options):
        if what in one.metadata["needs"] and getattr(options, one.name):
            yield one.name


def words_of(options: Any, role: str = "") -> list[str]:
    """The command line of these options, of those with a value; `role`: as in `options_of`."""
    words: list[str] = []
    for one in options_of(options, role):
        value, (on, _, off) = getattr(options, one.name), flag_of(one).partition("/")
        if isinstance(value, bool):
            words += [on] if value else [off] if off else []
        elif isinstance(value, tuple | list):
            words += [word for each in value for word in (on, str(each))]
        elif value is not None:
            words += [on, str(value)]
    return words
