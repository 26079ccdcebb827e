"""The file of the worst latencies that a search finds, and the command that replays them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hertzloop.cli.outputs import is_replaceable
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.studies.pages.commands import run_command

_HEADING = "# Worst latencies found by hertzloop"


def check_file(path: Path) -> None:
    """End the command unless a file takes worst latencies: it is new, or of an earlier search."""
    if not is_replaceable(path, _HEADING):
        fail(f"{path}: exists, and is not a file of worst latencies. Move it away")


def write_file(
    path: Path,
    latencies_us: Sequence[float],
    scene: str,
    settings: list[str],
    seed: int,
    case: Mapping[str, Any],
) -> None:
    """Write latencies by sample, us, as `controller.latency_trace` reads them, and name the command
    that replays them; the other arguments are those of `run_command`."""
    lines = [_HEADING, "latency_us", *(f"{value:.12g}" for value in latencies_us)]
    atomic_write(path, "\n".join(lines) + "\n")
    replayed = {**case, "controller.latency_us": 0, "controller.latency_trace": str(path)}
    out.say(f"written: {path}. See it: {run_command(scene, replayed, settings, seed)}")
