"""The study of the ideal and the real plant, on a coarse case."""

import csv
import math

import pytest

from benchmarks import real_plant as study
from benchmarks.latency import Named, critical
from benchmarks.results import Results
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.touch_phases import phases
from hertzloop.studies.cases.pool import local_pool

# These need a kind of plant of their own, whose kernels take half a minute to compile.
pytestmark = pytest.mark.full

COARSE = Named(
    "coarse",
    "aluminium-3mm",
    ("run.accuracy=0.1", "run.duration_s=0.0013", "controller.v_thr_m_s=-0.6"),
    "impact",
)
LAWS = ("slope_threshold",)


@pytest.fixture(scope="module")
def found():
    patch = pytest.MonkeyPatch()
    with local_pool(1) as pool:
        yield [study.effect(pool, COARSE, plant, law, 3) for law in LAWS for plant in study.PLANTS]
    patch.undo()


@pytest.mark.full
def test_a_dent_takes_the_help_of_the_law_that_does_not_know_it(found):
    by = {(e.law, e.plant): e for e in found}
    ideal, real = (by["slope_threshold", plant] for plant in study.PLANTS)
    assert ideal.takes_off(0, 0.1)
    assert ideal.critical_us >= 1.0
    assert real.energies[0].least > 0.0
    assert math.isnan(real.critical_us)


def test_a_real_case_is_the_one_that_its_settings_say(found):
    real = next(e for e in found if (e.law, e.plant) == ("slope_threshold", "real"))
    scene = study.plant_of(COARSE, "real")
    again = [
        metrics_of_case(
            scene.vary({"sensors.noise_rms": real.noise_rms, "run.touch_phase": phase})
        ).plate_energy_db
        for phase in phases()
    ]
    assert [min(again), max(again)] == [real.energies[0].least, real.energies[0].most]


def test_a_contact_with_a_damper_keeps_its_loss():
    """It would lose twice with yield."""
    oak = next(named for named in study.SCENES if named.name == "oak-20mm")
    scene = study.plant_of(oak, "real")
    assert scene.scene.contact.damping == "hunt_crossley"
    assert scene.scene.contact.plasticity == "none"
    assert scene.actuator.bandwidth_hz == 300e3


def test_bits_are_those_of_the_plant(found):
    by = {(e.law, e.plant): e for e in found}
    assert 3.0 <= by["slope_threshold", "ideal"].critical_bits <= 10.0
    assert math.isnan(by["slope_threshold", "real"].critical_bits)  # it helps with none
    with local_pool(1) as pool:  # an ideal plant has no noise, whatever its bits
        assert (
            by["slope_threshold", "ideal"].settled_bits
            == critical(pool, COARSE, "slope_threshold", 1).settled_bits
        )


def test_noise_goes_with_the_range_that_law_and_latency_ask_for():
    scene = study.plant_of(COARSE, "real")
    noises = [
        study.with_noise(scene, values)["sensors.noise_rms"]
        for values in ({"controller.latency_us": 0}, {"controller.latency_us": 40})
    ]
    assert noises[0] < noises[1] < 1e-7
    assert "sensors.noise_rms" not in study.with_noise(study.plant_of(COARSE, "ideal"), {})


def test_table_and_picture(found, tmp_path):
    study.write(Results(tmp_path, None), found)
    with (tmp_path / "real.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["law"], row["plant"]) for row in rows] == [(e.law, e.plant) for e in found]
    assert float(rows[0]["mean_db_2us"]) == found[0].energies[2].mean
    assert (tmp_path / "real.png").read_bytes().startswith(b"\x89PNG")
    assert float(rows[0]["critical_bits"]) == found[0].critical_bits
    assert study._critical(found[1]) == "never"
