"""Compile all kernels once; later processes load them from the cache."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop import kernel_cache

_SCENES = {"modal": "aluminium-3mm", "thesis2008": "thesis-aluminium"}
_MODELS = {"modal": ("modal", "infinite"), "thesis2008": ("modal",)}  # run.plate_model


def _marker(scheme: str) -> Path:
    return kernel_cache() / f".compiled-{scheme}"


def is_compiled(scheme: str = "modal") -> bool:
    """Whether an earlier call has filled the cache with the kernels of a scheme."""
    return _marker(scheme).exists()


def ensure_compiled(announce: Callable[[], None], scheme: str = "modal") -> None:
    """Run every kernel for a moment if the cache is empty; calls `announce` before."""
    if is_compiled(scheme):
        return
    announce()
    from hertzloop.inprocess import record_in_process
    from hertzloop.model_cost import chosen_model
    from hertzloop.scene import load

    # A run through each port compiles every kernel that any of them calls.
    short = ["run.duration_s=0.0015", "plate.loss_factor=0.01"]
    for model in _MODELS[scheme]:
        scene = load(_SCENES[scheme], [*short, f"run.plate_model={model}"])
        with TemporaryDirectory() as folder:
            record_in_process(scene, Path(folder) / "a.mcap", compiled=False)
            record_in_process(scene, Path(folder) / "b.mcap", compiled=True)
        chosen_model(scene)
    _marker(scheme).touch()
