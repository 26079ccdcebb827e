"""Commands with each feature of sphere, structure and sensor give the same numbers."""

import csv

import pyarrow.parquet as parquet
import pytest

import hertzloop
from tests.commands import as_options, succeed
from tests.hertzloop.own_laws import write_law
from tests.hertzloop.scenes import json_in

FEATURES = {
    "mass and speed, own law": "sphere.mass_kg=0.002 sphere.speed_m_s=0.7 controller.law=mine.py",
    "sensor elsewhere": "sensors.point_m=[0.31,0.22] sensors.quantity=v_p "
    "controller.law=velocity_feedback",
    "modes from a file": "plate.modes=modes.csv sensors.quantity=v_p "
    "controller.law=velocity_feedback",
}
# Of a short span a sweep takes the infinite plate, which is right within the accuracy only.
SHORT = "run.duration_s=0.003 run.accuracy=0.01 run.plate_model=modal"


@pytest.mark.full
@pytest.mark.parametrize("name", FEATURES)
def test_commands_have_the_same_numbers(name, here):
    write_law(here)
    scene = ["aluminium-3mm", *as_options(f"{SHORT} {FEATURES[name]}".split())]
    if "modes.csv" in FEATURES[name]:
        elsewhere = as_options(FEATURES["sensor elsewhere"].split())
        succeed("scene", "modes", scene[0], *elsewhere, "-o", "modes.csv")
    succeed("run", *scene, "-o", "a.mcap", "--json", "a.json")
    succeed("run", *scene, "-o", "b.mcap", "--transport", "compiled")
    assert succeed("compare", "a.mcap", "b.mcap").startswith("the same: ")
    over = ["--over", "controller.latency_us=0,4", "--workers", "1"]
    succeed("sweep", *scene, *over, "-o", "s.csv")
    with (here / "s.csv").open() as lines:
        first = next(csv.DictReader(lines))
    peak_n = json_in("a.json")["first_impact"]["peak_force_n"]
    assert float(first["peak_force_n"]) == pytest.approx(peak_n, rel=1e-9)
    succeed("export", "a.mcap", "-o", "a.parquet")
    exported = parquet.read_table("a.parquet")["f_c_n"].to_numpy()
    assert exported.tobytes() == hertzloop.read("a.mcap").truth["f_c_n"].values.tobytes()
    succeed("inspect", "a.mcap")
    succeed("report", "a.mcap", "-o", "r")
    succeed("replay", "a.mcap", "--save", "a.rrd")
