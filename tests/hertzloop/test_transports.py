"""One closed loop, three ways to run it, the same bits; the horizon changes only the speed."""

from functools import cache
from pathlib import Path

import pytest

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import Recording, read
from hertzloop.setup import Setup, load
from hertzloop.views.run import run_scene
from tests.tiers import default

CONVERTERS = [
    "sensors.bits=10", "sensors.every_steps=3", "sensors.low_pass_hz=2e5",
    "sensors.low_pass_order=6", "sensors.noise_rms=2e-8", "controller.latency_us=4",
    "controller.jitter_us=5",
    "controller.drop_out_probability=0.1", "controller.bits=8", "controller.full_scale_n=60",
    "controller.slew_n_s=2e7",
]  # fmt: skip
VARIANTS: dict[str, tuple[str, list[str]]] = {
    "default": ("aluminium-3mm", ["run.duration_s=0.003"]),
    "several contacts": ("aluminium-20mm", ["run.duration_s=0.006", "controller.latency_us=20"]),
    "converters": ("aluminium-3mm", ["run.duration_s=0.003", *CONVERTERS]),
    "damped contact": ("oak-20mm", ["run.duration_s=0.004"]),
    "sinking in": ("sylomer-20mm", ["run.duration_s=0.002"]),
    "two points": ("offcentre-6mm", ["run.duration_s=0.004", "controller.latency_us=3"]),
    "constant force": (
        "aluminium-3mm",
        ["run.duration_s=0.003", "controller.law=constant", "controller.force_n=-20",
         "controller.delay_us=7", "controller.duration_us=40", "controller.latency_us=2"],
    ),
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
    "infinite plate, of itself": (
        "aluminium-3mm", ["run.duration_s=0.00114", "contact.damping=hunt_crossley",
                          "contact.restitution=0.8"],
    ),
    "published scheme": ("thesis-aluminium", ["sphere.radius_m=0.003"]),
    "pre-computed force": (
        "thesis-aluminium",
        ["controller.law=precomputed", "controller.precomputed=F_a10", "controller.kappa=-0.4",
         "controller.delay_us=3"],
    ),
    "pre-computed, consistent": (
        "aluminium-3mm",
        ["run.duration_s=0.003", "controller.law=precomputed", "controller.precomputed=F_a6",
         "controller.lead_us=1"],
    ),
    "window, few bits": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=least_squares", "sensors.bits=6",
         "sensors.noise_rms=1e-7"],
    ),
    "shifted threshold": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=shifted_threshold", "controller.latency_us=5"],
    ),
    "predicted": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=predicted", "controller.latency_us=15",
         "controller.jitter_us=2"],
    ),
    "fading": (
        "aluminium-3mm",
        ["run.duration_s=0.002", "controller.law=fade_out", "controller.latency_us=3"],
    ),
    "force feedback": (
        "offcentre-6mm", ["run.duration_s=0.002", "controller.law=force_feedback"],
    ),
    "velocity feedback": (
        "aluminium-3mm",
        ["run.duration_s=0.0015", "controller.law=velocity_feedback", "controller.latency_us=2"],
    ),
    "acceleration feedback": (
        "aluminium-3mm",
        ["run.duration_s=0.0015", "controller.law=acceleration_feedback", "sensors.bits=12"],
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
    "actuator beside": (
        "offcentre-6mm",
        ["run.duration_s=0.002", "actuator.bandwidth_hz=3e4", "actuator.damping=0.3",
         "actuator.mass_kg=5e-3", "plate.loss_factor=0.02"],
    ),
    "yielding": (
        "aluminium-3mm",
        ["run.duration_s=0.003", "contact.plasticity=thornton",
         "contact.limiting_pressure_pa=7.7e8", "contact.damping=hunt_crossley",
         "contact.restitution=0.8", "actuator.bandwidth_hz=3e5"],
    ),
    "yielding, two points": (
        "offcentre-6mm",
        ["run.duration_s=0.003", "contact.plasticity=thornton",
         "contact.limiting_pressure_pa=5e8", "controller.latency_us=3"],
    ),
    "blocks that do not fit": ("aluminium-3mm", ["run.duration_s=0.002717"]),
    "a single step": ("aluminium-3mm", ["run.duration_s=1e-6"]),
}  # fmt: skip
# Of the two kinds of plant that most scenes have: every other kind is compiled for half a minute.
QUICK = set(VARIANTS) - {
    "two points", "published scheme", "pre-computed force", "force feedback", "actuator",
    "actuator beside", "yielding", "yielding, two points",
}  # fmt: skip
SOME = ["default", "converters", "two points", "actuator"]


@cache
def scene_of(variant: str) -> Setup:
    name, settings = VARIANTS[variant]
    return load(name, settings)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    folder = tmp_path_factory.mktemp("compiled")

    @cache
    def recording(variant: str) -> Recording:
        return record(scene_of(variant), folder / f"{variant}.mcap", Transport.COMPILED)

    return recording


def record(scene: Setup, path: Path, transport: Transport, horizon: int | None = None) -> Recording:
    report = run_scene(scene, path, RunOptions(transport=transport, horizon=horizon))
    assert report["steps"] == scene.steps
    recording = read(path)
    assert not recording.problems
    assert recording.truth.samples == scene.steps
    assert recording.force.samples == scene.steps
    assert recording.daq.samples == -(-scene.steps // scene.every_steps)
    return recording


@pytest.mark.parametrize("horizon", default([None, 1, 7], [None]))
@pytest.mark.parametrize("variant", default(VARIANTS, QUICK))
def test_in_process(compiled, tmp_path: Path, variant: str, horizon: int | None) -> None:  # type: ignore[no-untyped-def]
    found = record(scene_of(variant), tmp_path / "a.mcap", Transport.INPROCESS, horizon)
    assert first_difference(found, compiled(variant)) is None


@pytest.mark.parametrize("variant", default(VARIANTS, ["default", "infinite plate"]))
def test_processes_over_zenoh(compiled, tmp_path: Path, variant: str) -> None:  # type: ignore[no-untyped-def]
    found = record(scene_of(variant), tmp_path / "a.mcap", Transport.ZENOH)
    assert first_difference(found, compiled(variant)) is None


@pytest.mark.parametrize("variant", default(SOME, ["converters"]))
def test_processes_with_horizon_one(compiled, tmp_path: Path, variant: str) -> None:  # type: ignore[no-untyped-def]
    found = record(scene_of(variant), tmp_path / "a.mcap", Transport.ZENOH, 1)
    assert first_difference(found, compiled(variant)) is None


@pytest.mark.parametrize(
    "variant",
    default(
        [name for name in VARIANTS if name not in ("no control", "sinking in", "a single step")],
        QUICK,
    ),
)
def test_a_variant_is_worth_comparing(compiled, variant: str) -> None:  # type: ignore[no-untyped-def]
    """Forces act and events happen: identity of zeros would prove nothing."""
    recording = compiled(variant)
    assert recording.truth.arrays["f_a_n"].any()
    assert recording.truth.arrays["f_c_n"].any()
    assert {"plant", "controller"} == {event.name for event in recording.events}


def test_samples_take_many_values_and_no_control_has_no_force(compiled) -> None:  # type: ignore[no-untyped-def]
    assert len(set(compiled("converters").daq.arrays["code"])) > 10  # a contact of 10 samples
    assert not compiled("no control").truth.arrays["f_a_n"].any()


def test_same_run_twice_and_another_seed(compiled, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    again = record(scene_of("converters"), tmp_path / "again.mcap", Transport.COMPILED)
    assert first_difference(again, compiled("converters")) is None
    name, settings = VARIANTS["converters"]
    other = record(load(name, settings, seed=2), tmp_path / "other.mcap", Transport.COMPILED)
    assert "differs" in str(first_difference(other, compiled("converters")))
