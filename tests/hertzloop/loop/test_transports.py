"""One closed loop, three ways to run it, the same bits; max_exchange_steps changes the speed."""

from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import Setup, load
from hertzloop.views.run_json import run_as_json
from tests.hertzloop.lanes import Pair
from tests.hertzloop.short_runs import SCENES
from tests.tiers import default

CONVERTERS = [
    *SCENES["converters"],
    "sensors.low_pass_hz=2e5",
    "sensors.low_pass_order=6",
    "sensors.noise_rms=2e-8",
]
VARIANTS: dict[str, tuple[str, list[str]]] = {
    "default": ("aluminium-3mm", ["run.duration_s=0.003"]),
    "several contacts": ("aluminium-20mm", ["run.duration_s=0.006", "controller.latency_us=20"]),
    "converters": ("aluminium-3mm", ["run.duration_s=0.003", *CONVERTERS]),
    "two points": ("offcentre-6mm", ["run.duration_s=0.004", "controller.latency_us=3"]),
    "profile": (
        "aluminium-3mm",
        ["run.duration_s=0.003", "controller.law=profile",
         "controller.profile_n=[5.0, -3.0, 8.0, 1.5]", "sensors.every_steps=2"],
    ),
    "no control": ("aluminium-3mm", ["run.duration_s=0.0025", "controller.law=off"]),
    "infinite plate": (
        "aluminium-3mm",
        ["run.duration_s=0.003", "run.plate_model=infinite", *CONVERTERS],
    ),
    "published scheme": ("thesis-aluminium", ["sphere.radius_m=0.003"]),
    "pre-computed force": (
        "thesis-aluminium",
        ["controller.law=precomputed", "controller.precomputed=F_a10", "controller.kappa=-0.4",
         "controller.delay_us=3"],
    ),
    "predicted": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=predicted", "controller.latency_us=15",
         "controller.jitter_us=2"],
    ),
    "own clock": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=force_feedback", "sensors.every_steps=5",
         "controller.clock_ppm=-3000", "controller.clock_phase=0.3", "controller.latency_us=2"],
    ),
    "velocity feedback": (
        "aluminium-3mm",
        ["run.duration_s=0.0015", "controller.law=velocity_feedback", "controller.latency_us=2"],
    ),
    "linear filter": (
        "aluminium-3mm",
        ["run.duration_s=0.0015", "controller.law=linear", "sensors.bits=12",
         "controller.sections=[[-9.0, -9.0, 0, 1, -0.9, 0], [1, -1.9, 0.95, 1, -1.8, 0.9]]",
         "sensors.every_steps=2"],
    ),
    "actuator": (
        "aluminium-3mm",
        ["run.duration_s=0.002", *CONVERTERS, "actuator.bandwidth_hz=1e5", "actuator.mass_kg=1e-3",
         "actuator.force_limit_n=20"],
    ),
    "blocks that do not fit": ("aluminium-3mm", ["run.duration_s=0.002717"]),
    "a single step": ("aluminium-3mm", ["run.duration_s=1e-6"]),
}  # fmt: skip
# The published scheme has kernels of its own, which take half a minute to compile.
QUICK = set(VARIANTS) - {"published scheme", "pre-computed force"}
SOME = ["default", "converters", "two points", "actuator"]
# Each sends something else: streams, blocks, silences. The others differ in their numbers alone.
OVER_ZENOH = [
    *SOME,
    "several contacts",
    "infinite plate",
    "published scheme",
    "pre-computed force",
    "predicted",
    "own clock",
    "blocks that do not fit",
    "a single step",
]


@cache
def scene_of(variant: str) -> Setup:
    name, settings = VARIANTS[variant]
    return load(name, settings)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):  # type: ignore[no-untyped-def]
    folder = tmp_path_factory.mktemp("compiled")

    @cache
    def recording(variant: str) -> Recording:
        found = record(scene_of(variant), folder / f"{variant}.mcap", Transport.COMPILED)
        # Forces act and events happen: identity of zeros would prove nothing.
        if variant not in ("no control", "a single step"):
            assert found.truth.arrays["f_a_n"].any()
            assert found.truth.arrays["f_c_n"].any()
            assert {"plant", "controller"} == {event.name for event in found.events}
        if variant == "converters":
            assert len(set(found.daq.arrays["code"])) > 10  # a contact of 10 samples
        assert variant != "no control" or not found.truth.arrays["f_a_n"].any()
        return found

    return recording


def record(
    scene: Setup,
    path: Path,
    transport: Transport = Transport.ZENOH,
    max_exchange_steps: int | None = None,
    lane: bool = True,
) -> Recording:
    """A run as `hertzloop run` does it."""
    report = run_as_json(
        run_and_assess(
            scene,
            path,
            RunOptions(
                transport=transport, max_exchange_steps=max_exchange_steps, shared_memory=lane
            ),
        )
    )
    assert report["steps"] == scene.run.steps
    assert report["shared_memory"] == "JOINED" * (lane and transport == Transport.ZENOH)
    return checked(read(path), scene)


def in_threads(scene: Setup, path: Path) -> Recording:
    """A run over the ring, with queues for a bus."""
    pair = Pair(scene).run()
    assert pair.fault == pair.controller_fault == ""
    assert pair.stats.shared_memory == "JOINED"
    return checked(pair.recorded(path), scene)


def checked(recording: Recording, scene: Setup) -> Recording:
    """A recording of a whole run of a scene."""
    assert not recording.problems
    assert recording.truth.samples == recording.force.samples == scene.run.steps
    assert recording.daq.samples == -(-scene.run.steps // scene.sensor.every_steps)
    return recording


# A way to run a scene, variants that it is tried with, and those of the default tier.
IN_THREADS = {
    "default",
    "own clock",
    "converters",
    "velocity feedback",
    "predicted",
    "a single step",
}
WAYS: dict[str, tuple[Callable[..., Recording], dict[str, Any], Collection[str], set[str]]] = {
    "in process": (record, {"transport": Transport.INPROCESS}, VARIANTS, QUICK),
    "max_exchange_steps 1": (
        record,
        {"transport": Transport.INPROCESS, "max_exchange_steps": 1},
        SOME,
        set(),
    ),
    "max_exchange_steps 7": (
        record,
        {"transport": Transport.INPROCESS, "max_exchange_steps": 7},
        SOME,
        set(),
    ),
    "zenoh": (record, {}, OVER_ZENOH, {"default", "infinite plate", "own clock"}),
    "zenoh, max_exchange_steps 1": (
        record,
        {"max_exchange_steps": 1},
        ["converters"],
        {"converters"},
    ),
    "zenoh, no lane": (record, {"lane": False}, ["converters"], {"converters"}),
    "threads": (in_threads, {}, sorted(IN_THREADS), IN_THREADS),
}
CASES = {
    (variant, way): variant in quick
    for way, (*_, tried, quick) in WAYS.items()
    for variant in tried
}


@pytest.mark.parametrize("case", default(CASES, [c for c in CASES if CASES[c]]), ids="-".join)
def test_the_same_bits(compiled, tmp_path, case):  # type: ignore[no-untyped-def]
    variant, way = case
    run, how, *_ = WAYS[way]
    found = run(scene_of(variant), tmp_path / "a.mcap", **how)
    assert first_difference(found, compiled(variant)) is None
