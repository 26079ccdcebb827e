"""How to run a scene."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Literal

from hertzloop.common.sanitize import visible

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

    @classmethod
    def _missing_(cls, value: object) -> "Transport":
        raise OptionError(f"transport = {value!r}: is unknown. Use one of {', '.join(cls)}.")


def check_transport(option: str, transport: Transport) -> None:
    """Raise OptionError if an option that needs the processes of a run is given without them."""
    if transport is not Transport.ZENOH:
        raise OptionError(
            f"{option}: not available with transport = '{transport}'. Use transport zenoh."
        )


@dataclass(frozen=True)
class RunOptions:
    """How to run a scene. Except for `pace`, nothing here changes a sample.

    Attributes:
        transport: How the parts of the run communicate.
        overwrite: Whether the recording replaces an existing file.
        horizon: Largest number of steps between two exchanges; None: as many as the law allows.
        endpoints: Endpoints of plant, controller and recorder; None: private ones.
        name: Name of the run on the bus; None: a new one.
        timeout_s: Longest wait for a message of another process, s.
        verify: Whether the closed loop is repeated with half the step and twice the modes.
        fast_lane: Whether plant and controller on one host exchange data in shared memory.
        realtime: Use of real-time scheduling; auto: where it is permitted and a core is idle.
        pace: Ratio of simulated to wall time to follow without waiting for forces; None: lock-step.
        repeat: Recording whose forces and delays are repeated in lock-step.
        controller: Command line of a program that plays the controller; None: hertzloop's own.
        note: Text of the user for the recording, one line of at most LONGEST_NOTE characters.

    Raises:
        OptionError: The name cannot be part of a key on the bus, the note cannot be recorded, the
            horizon is less than a step, or two options exclude each other.
    """

    transport: Transport = Transport.ZENOH
    overwrite: bool = False
    horizon: int | None = None
    endpoints: Sequence[str] | None = None
    name: str | None = None
    timeout_s: float = 5.0
    verify: bool = False
    fast_lane: bool = True
    realtime: Literal["auto", "on", "off"] = "off"
    pace: float | None = None
    repeat: Path | None = None
    controller: str | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name)
        check_note(self.note)
        if self.horizon is not None and self.horizon < 1:
            raise OptionError(f"horizon = {self.horizon}: must be a step or more. Use at least 1.")
        for option in ("pace", "repeat", "controller"):
            if getattr(self, option):
                check_transport(f"{option} = {getattr(self, option)}", self.transport)
        for option in ("horizon", "verify", "repeat"):
            if getattr(self, option) and self.pace is not None:
                raise OptionError(
                    f"{option} = {getattr(self, option)}: cannot be combined with pace = "
                    f"{self.pace:g}, which does not wait for forces. Remove one of the two."
                )


USUAL_RUN = RunOptions()
