"""Compile all kernels once; later processes load them from the cache."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop import kernel_cache


def is_compiled() -> bool:
    """Whether an earlier call has filled the cache of these kernels."""
    return (kernel_cache() / ".compiled").exists()


def ensure_compiled(announce: Callable[[], None]) -> None:
    """Run every kernel for a moment if the cache is empty; calls `announce` before."""
    if is_compiled():
        return
    announce()
    from hertzloop.inprocess import record_in_process
    from hertzloop.scene import load

    # A run through each port compiles every kernel that any of them calls.
    with TemporaryDirectory() as folder:
        scene = load("aluminium-3mm", ["run.duration_s=0.0015", "plate.loss_factor=0.01"])
        record_in_process(scene, Path(folder) / "a.mcap", compiled=False)
        record_in_process(scene, Path(folder) / "b.mcap", compiled=True)
    (kernel_cache() / ".compiled").touch()
