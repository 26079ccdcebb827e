"""Options, each stated once for the command line and for Python; and those of a run."""

import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.common.sanitize import visible
from hertzloop.scene.errors import sentence

LONGEST_NOTE = 500  # characters


class OptionError(ValueError):
    """An option has an impossible value. The message names the option."""

    exit_status = 2


def check_name(name: str) -> None:
    """Raise OptionError for a name that cannot be part of a key on the bus."""
    if not re.fullmatch(r"[A-Za-z0-9._+-]{1,100}", name):
        raise OptionError(
            f"--name = '{name}': must be 1 to 100 letters, digits and characters of "
            "'._+-'. Change the name."
        )


def check_note(note: str) -> None:
    """Raise OptionError for a note that is too long, or is not one line of visible characters."""
    if len(note) > LONGEST_NOTE:
        raise OptionError(
            f"note: has {len(note):,} characters. Shorten it to at most {LONGEST_NOTE}."
        )
    if "\n" in note or visible(note) != note:
        raise OptionError(
            f"note = {note!a}: must be one line without control characters. Remove line "
            "breaks and invisible characters."
        )


def check_list(option: str, value: object) -> None:
    """Raise OptionError for text in place of a list, whose letters would be read one by one."""
    if isinstance(value, str):
        raise OptionError(f"{option} = {value!a}: must be a list. Write [{value!a}].")


class Transport(StrEnum):
    """Three ways to run the same closed loop."""

    ZENOH = "zenoh"
    INPROCESS = "inprocess"
    COMPILED = "compiled"


OF_PROCESSES = (Transport.ZENOH,)  # that have an option of separate processes


def check_transport(
    option: str, transport: Transport, having_it: tuple[Transport, ...] = OF_PROCESSES
) -> None:
    """Raise OptionError if an option is given with another transport than those that have it."""
    if transport not in having_it:
        raise OptionError(
            f"{option}: not available with transport = '{transport}'. "
            f"Use transport {' or '.join(having_it)}."
        )


class Use(NamedTuple):
    """Where an option is used, beside its value and its meaning.

    Attributes:
        roles: Roles whose command `hertzloop node ROLE` has it.
        python: Whether it is a keyword of `hertzloop.run`.
        flag: Its spelling on the command line, if that is not its name.
        metavar: What stands for its value in the help.
        heading: Heading of the options below which the help has it.
        transports: The transports that have it.
    """

    roles: tuple[str, ...] = ()
    python: bool = False
    flag: str = ""
    metavar: str | None = None
    heading: str | None = None
    transports: tuple[Transport, ...] = tuple(Transport)


class Options(BaseModel):
    """Options of a command and keywords of Python, a field each with its description.

    Raises:
        OptionError: A value is not possible, or options exclude each other.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    def __init__(self, *values: Any, **given: Any) -> None:
        given |= dict(zip(type(self).model_fields, values, strict=False))
        if unknown := given.keys() - type(self).model_fields.keys():
            raise TypeError(f"{type(self).__name__} has no {', '.join(sorted(unknown))}")
        for name, field in type(self).model_fields.items():
            if isinstance(field.default, tuple):
                check_list(name, given.get(name))
        try:
            super().__init__(**given)
        except ValidationError as error:
            raise OptionError(sentence(error, type(self))) from None

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        told = (f"        {name}: {cls.model_fields[name].description}" for name in cls.uses())
        cls.__doc__ = f"{cls.__doc__}\n    Attributes:\n" + "\n".join(told) + "\n    "

    @classmethod
    def uses(cls) -> dict[str, Use]:
        """Where each option is used that is described."""
        return {
            name: next((one for one in field.metadata if isinstance(one, Use)), Use())
            for name, field in cls.model_fields.items()
            if field.description
        }

    def replaced(self, **values: Any) -> Self:
        """Return the options with other values, which are checked."""
        return type(self)(**dict(self) | values)


EXPERT = "Expert options"  # that few runs need
WorkersOption = Annotated[
    int | None, Field(ge=1, description="Use this many processes; default: one for each core.")
]


class RunOptions(Options):
    """How to run a scene. Except for `pace`, nothing here changes a sample."""

    transport: Annotated[
        Transport,
        Field(
            description="Choose how the parts of the run communicate: over zenoh as processes, or "
            "within one process. All give the same bytes."
        ),
        Use(python=True),
    ] = Transport.ZENOH
    overwrite: Annotated[
        bool,
        Field(description="Replace an existing file."),
        Use((RECORDER,), python=True, flag="--overwrite"),
    ] = False
    max_exchange_steps: Annotated[
        int | None,
        Field(
            ge=1,
            description="Exchange data after at most this many steps; default: as the law allows.",
        ),
        Use(
            (PLANT,),
            python=True,
            heading=EXPERT,
            transports=(Transport.ZENOH, Transport.INPROCESS),
        ),
    ] = None
    endpoints: list[str] | None = None  # of plant, controller and recorder; None: private ones
    name: Annotated[
        str | None,
        Field(description="Set the name of the run on the bus."),
        Use(ROLES, heading=EXPERT, transports=OF_PROCESSES),
    ] = None
    timeout_s: Annotated[
        float,
        Field(
            ge=0.1,
            le=1_000_000,
            description="Stop waiting for a message of another process after this time, s.",
        ),
        Use(ROLES, flag="--timeout", heading=EXPERT, transports=OF_PROCESSES),
    ] = 5.0
    verify: Annotated[
        bool,
        Field(description="Repeat the closed loop with half the step and twice the modes."),
        Use(flag="--verify"),
    ] = False
    shared_memory: Annotated[
        bool,
        Field(
            description="Exchange data between plant and controller on one host in shared memory."
        ),
        Use(
            (PLANT, CONTROLLER),
            flag="--shared-memory/--no-shared-memory",
            heading=EXPERT,
            transports=OF_PROCESSES,
        ),
    ] = True
    realtime: Annotated[
        Literal["auto", "on", "off"],
        Field(
            description="Use real-time scheduling; auto: where it is permitted and a core is idle."
        ),
        Use(ROLES, heading=EXPERT, transports=OF_PROCESSES),
    ] = "off"
    pace: Annotated[
        float | None,
        Field(
            ge=1e-9,
            le=1000,
            description="Follow the wall clock at this ratio of simulated to wall time, without "
            "waiting for forces; default: lock-step.",
        ),
        Use((PLANT,), python=True, transports=OF_PROCESSES),
    ] = None
    repeat: Annotated[
        Path | None,
        Field(
            description="Repeat a recorded run in lock-step with the recorded forces and delays."
        ),
        Use((PLANT,), metavar="F.mcap", transports=OF_PROCESSES),
    ] = None
    controller: Annotated[
        str | None,
        Field(
            description="Start this command line as the controller; {name}, {listen} and {connect} "
            "in it are filled in."
        ),
        Use(metavar="'CMD ...'", heading=EXPERT, transports=OF_PROCESSES),
    ] = None
    note: Annotated[
        str,
        Field(description="Write this note, one line, into the recording."),
        Use((RECORDER,), python=True, metavar="TEXT"),
    ] = ""

    @model_validator(mode="after")
    def _can_be_combined(self) -> "RunOptions":
        if self.name is not None:
            check_name(self.name)
        check_note(self.note)
        for name, use in self.uses().items():
            value = getattr(self, name)
            # The command refuses the others: its defaults differ.
            if use.python and value != type(self).model_fields[name].default:
                check_transport(f"{name} = {value}", self.transport, use.transports)
        for option in ("max_exchange_steps", "verify", "repeat"):
            if getattr(self, option) and self.pace is not None:
                raise OptionError(
                    f"{option} = {getattr(self, option)}: cannot be combined with pace = "
                    f"{self.pace:g}, which does not wait for forces. Remove one of the two."
                )
        return self


USES = RunOptions.uses()
USUAL_RUN = RunOptions()
