"""How to run a scene: every option of a run, declared once."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Literal

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.options import OptionError, option

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
