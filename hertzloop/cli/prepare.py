"""What a command does before it runs a scene: resolve it, try its law, compile its kernels."""

import os
from collections.abc import Iterable
from functools import cache
from typing import Any

from hertzloop.cli.terminal import err, progress
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.law_trial import try_law
from hertzloop.processes.signals import INTERRUPTED, ending_signals
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError, shown
from hertzloop.scene.loading import load as load_scene
from hertzloop.scene.loading import parse_setting
from hertzloop.scene.plate_model import WARN_ABOVE_S, build_time_s
from hertzloop.scene.setup import Setup, resolve
from hertzloop.warmup import anything_compiled, ensure_compiled, not_compiled

_MODEL = "the model: about 25 s"


def scene_from(
    source: str, settings: list[str] | None, seed: int | None, law_was_tried: bool = False
) -> Setup:
    """Resolve the scene that a command names, and try its law.

    Args:
        source: Name of a shipped scene, or a .toml file.
        settings: Changes of keys, as `key=value`.
        seed: Random seed; None: that of the scene.
        law_was_tried: Whether the process that started this one has tried the law.

    Raises:
        SceneError: The scene cannot be simulated, or two options give a key different values.
    """
    check_given_once(settings or (), seed)
    setup = resolve(load_scene(source, settings or (), seed))

    if not anything_compiled():
        announce_compilation(_MODEL)
    spec = setup.plant
    takes_s = build_time_s(spec)
    if takes_s >= WARN_ABOVE_S:
        count = spec.plate.modes_below(spec.frequency_limit_hz)
        err.say(f"Computing about {count:.2g} modes takes about {takes_s:.0f} s of processor time.")
    if not law_was_tried:
        check_law(setup)
    return setup


def check_given_once(settings: Iterable[str], seed: int | None) -> None:
    """Raise SceneError if settings and the seed give a scene key different values."""
    given: dict[str, Any] = {} if seed is None else {"run.seed": seed}
    for text in settings:
        key, value = parse_setting(text)
        first = given.setdefault(key, value)
        if first != value:
            raise SceneError(
                f"{key} = {shown(value)}: another option sets it to {shown(first)}. Remove one of "
                "the two."
            )


def check_law(setup: Setup) -> None:
    """Try a law that is not shipped for a moment, and print a note on a slow one.

    Of a shipped law it prints what the law has to say of its keys.

    Raises:
        SceneError: The law cannot be used.
    """
    if setup.scene.controller.law in shipped_laws():
        note = loaded_law(setup).note(setup.scene.controller.keys)
    else:
        note = try_law(setup)
    if note:
        err.say(note)


def check_pace(setup: Setup, options: RunOptions) -> None:
    """Raise SceneError for an impossible pace."""
    if options.pace is None:
        return
    from hertzloop.loop import paced  # 0.05 s, which other runs save

    paced.check_pace(setup, options.pace, options.timeout_s)


def compile_first(*scenes: Setup) -> None:
    """Compile the kernels that scenes run, unless they are in the cache; show how far that is.

    Raises:
        SceneError: A scene cannot be built.
    """

    def end(_: int) -> None:
        # At once, since nothing is to be kept: what LLVM calls loses a KeyboardInterrupt.
        err.show_cursor()
        err.say("interrupted")
        os._exit(INTERRUPTED)

    with ending_signals(end):
        if not not_compiled(*scenes):
            return
        kind = "for this kind of scene: about 25 s" if anything_compiled() else _MODEL
        announce_compilation(kind)
        with progress("Compiling", 100) as advance:
            ensure_compiled(
                *scenes,
                on_progress=lambda share, what: advance(round(100 * share), f"Compiling {what}"),
            )


@cache
def announce_compilation(what: str) -> None:
    """Say why the next seconds are silent, and what is compiled; once in a process."""
    err.print(f"Compiling {what}, once for this version of hertzloop.")
