"""Check a controller program: run short cases with it, and compare its forces with those of a law.

Plant and recorder are those of every run, so that their checks name what the program does wrong:
see docs/reference/wire.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hertzloop.bus.streams import CONTROLLER
from hertzloop.loop.answering import answer_samples
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.record import record
from hertzloop.recordings.reader import Recording, read
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup, load

SCENE = "aluminium-3mm"
_SHORT = ("run.duration_s=0.0025", "run.accuracy=0.1")  # four contacts
_PATHS = {
    "ideal sensor": (),
    "converter and latency": (
        "sensors.bits=8",
        "sensors.full_scale=contact",
        "controller.latency_us=5",
    ),
    "a sample every third step": ("sensors.every_steps=3", "controller.latency_us=4"),
}
_ROUNDING = 8.0  # units of the last bit
_HORIZON = 100  # steps between two exchanges at most, in the case that repeats the first


class WrongForce(RuntimeError):
    """A force is not the expected one. The message names the first such step and both forces."""

    exit_status = 1


@dataclass(frozen=True)
class Case:
    """A run with the program under test; `max_exchange_steps` as in RunOptions."""

    name: str
    setup: Setup
    max_exchange_steps: int | None = None


def cases_of(law: str | None, settings: Sequence[str]) -> list[Case]:
    """The cases, in the order in which they are run; the last repeats the first in small blocks.

    Args:
        law: Put this law into the scene.
        settings: Settings of the scene, as "section.key=value".

    Raises SceneError for a law or a setting that cannot be.
    """
    asked = (*settings, *([f"controller.law={law}"] if law else []))
    cases = [
        Case(name, load(SCENE, ["name=law-test", *_SHORT, *path, *asked]))
        for name, path in _PATHS.items()
    ]
    return [
        *cases,
        replace(
            cases[0],
            name=f"at most {_HORIZON} steps between exchanges",
            max_exchange_steps=_HORIZON,
        ),
    ]


def run_case(case: Case, options: RunOptions, folder: Path) -> Recording:
    """Run a case with the program of `options.controller`; the recording is written to `folder`.

    Raises as `record`, with one sentence on what the program does wrong.
    """
    path, steps = folder / "run.mcap", case.max_exchange_steps or options.max_exchange_steps
    asked = options.model_copy(update={"max_exchange_steps": steps})
    record(case.setup, path, asked)
    return read(path)


def law_of(recording: Recording) -> str:
    """Name and version of the law that the program says it has run; "" if it does not say."""
    return str(recording.ends[CONTROLLER].report.law)


def compare_with_law(recording: Recording, setup: Setup) -> None:
    """Raise WrongForce unless the law of the setup answers the recorded samples with the recorded
    forces, bit for bit."""
    expected = answer_samples(build_controller(setup), recording.daq.values).forces
    law = f"law '{setup.scene.controller.law}'"
    _compare(recording.force.arrays["force_n"], expected, law, setup)


def compare_blocks(recording: Recording, first: Recording, setup: Setup) -> None:
    """Raise WrongForce unless two runs that differ only in their blocks have the same forces."""
    forces, expected = (one.force.arrays["force_n"] for one in (recording, first))
    _compare(forces, expected, "the first run, whose blocks are longer,", setup)


def _compare(forces: np.ndarray, expected: np.ndarray, other: str, setup: Setup) -> None:
    ours, theirs = (np.ascontiguousarray(f).view(np.int64) for f in (forces, expected))
    differs = np.flatnonzero(ours != theirs)
    if not len(differs):
        return
    at = int(differs[0])
    raise WrongForce(
        f"the controller's force of step {at} ({1e3 * at * setup.run.step_s:.6g} ms) is "
        f"{float(forces[at])!r} N, that of {other} is {float(expected[at])!r} N"
        + _last_bits(forces[differs], expected[differs])
    )


def _last_bits(forces: np.ndarray, expected: np.ndarray) -> str:
    """Say of forces that differ if they differ by rounding alone; else nothing."""
    size = np.spacing(np.maximum(np.abs(forces), np.abs(expected)))
    largest = float(np.max(np.abs(forces - expected) / size))
    if not largest <= _ROUNDING:
        return ""
    how = f"by at most {largest:g} in the last bit" if largest else "in the sign of zero alone"
    return (
        f". The {len(forces):,} forces that differ do so {how}, so that the law is the same. "
        "Compute in the same order, and compile without fused multiply-add (-ffp-contract=off)."
    )
