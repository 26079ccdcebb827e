"""Options that are declared once, as fields of a dataclass; among them how to run a scene.

The command line takes them, and a command line can be made of them again.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import Field, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES


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
    """Fields of a dataclass, or of an instance, that are options; of a role, if any are."""
    found = [one for one in fields(kind) if "help" in one.metadata]
    of_role = role and any(one.metadata["roles"] for one in found)
    yield from (one for one in found if not of_role or role in one.metadata["roles"])


def options_and_flags(kind: Any, role: str = "") -> list[tuple[Field[Any], str]]:
    """The same with what each is called on the command line."""
    return [(one, flag_of(one)) for one in options_of(kind, role)]


def flag_of(one: Field[Any]) -> str:
    """What an option is called on the command line; of a switch that is on by default also the
    word that turns it off."""
    name = one.metadata["name"] or one.name.removesuffix("_s").replace("_", "-")
    return f"--{name}/--no-{name}" if one.default is True else f"--{name}"


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


PROCESSES, LOCK_STEP = "processes", "lock-step"  # what options need: a transport, no pace


class Transport(StrEnum):
    """Three ways to run the same closed loop."""

    ZENOH = "zenoh"
    INPROCESS = "inprocess"
    COMPILED = "compiled"


@dataclass(frozen=True)
class RunOptions:
    """How to run a scene; but for `pace`, nothing here changes a sample. `endpoints`: of plant,
    controller and recorder, None for private ones; the others are options of the command line.

    Raises OptionError for a name that cannot be part of a key on the bus.
    """

    transport: Transport = option(Transport.ZENOH, "Choose how the parts of the run communicate.")
    overwrite: bool = option(False, "Replace an existing file.", roles=(RECORDER,))
    horizon: int | None = option(
        None, "Exchange data after at most this many steps; default: as the law allows.",
        roles=(PLANT,), needs=(LOCK_STEP,), min=1,
    )  # fmt: skip
    endpoints: Sequence[str] | None = None
    name: str | None = option(None, "Set the name of the run on the bus.", roles=ROLES)
    timeout_s: float = option(
        5.0, "Stop waiting for a message of another process after this time, s.",
        roles=ROLES, min=0.1, max=1e6,
    )  # fmt: skip
    verify: bool = option(
        False, "Repeat the closed loop with half the step and twice the modes.", needs=(LOCK_STEP,)
    )
    fast_lane: bool = option(
        True, "Exchange data between plant and controller on one host in shared memory.",
        roles=(PLANT, CONTROLLER),
    )  # fmt: skip
    realtime: Literal["auto", "on", "off"] = option(
        "off", "Use real-time scheduling; auto: where it is permitted and a core is idle.",
        roles=ROLES,
    )  # fmt: skip
    pace: float | None = option(
        None, "Follow the wall clock at this ratio of simulated to wall time, without waiting "
        "for forces; default: lock-step.",
        roles=(PLANT,), needs=(PROCESSES,), min=1e-9, max=1000.0,
    )  # fmt: skip
    repeat: Path | None = option(
        None, "Repeat a recorded run in lock-step with the recorded forces and delays.",
        roles=(PLANT,), needs=(PROCESSES, LOCK_STEP), metavar="F.mcap",
    )  # fmt: skip
    controller: str | None = option(
        None, "Start this command line as the controller; {name}, {listen} and {connect} in it are "
        "filled in.",
        needs=(PROCESSES,), metavar="'CMD ...'",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.name is not None and not re.fullmatch(r"[A-Za-z0-9._+-]{1,100}", self.name):
            raise OptionError(
                f"--name = '{self.name}': must be 1 to 100 letters, digits and characters of "
                "'._+-'. Change the name."
            )


USUAL_RUN = RunOptions()


@dataclass(frozen=True)
class BusOptions:
    """Where one process of a run meets the others, as the commands of single roles take it;
    `machine`: a launcher hears its reports."""

    listen: Sequence[str] = option((), "Listen on this endpoint.")
    connect: Sequence[str] = option((), "Connect to this endpoint.")
    zenoh_config: Path | None = option(
        None, "Read the zenoh configuration from this JSON5 file.", exists=True
    )
    wait_s: float = option(
        30.0, "Stop waiting for other processes to appear after this time, s.", min=0.1, max=1e6
    )
    machine: bool = option(False, "", hidden=True)
