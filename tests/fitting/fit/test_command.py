"""`hertzloop fit`: exit codes, files and the fields of its JSON."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.fitting.errors import FitError, RecordError
from hertzloop.fitting.fit.check import expected_record
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from tests.commands import invoke, refused
from tests.fitting.fitting import (
    HEIGHT,
    RADIUS,
    THICKNESS,
    YIELDS,
    fitted,
    record,
    scene,
    write_csv,
)


def test_a_key_at_its_bound_is_not_identified(tmp_path):
    drop, data = (tmp_path / name for name in ("drop.csv", "f.json"))
    ended = invoke([
        "fit", "aluminium-3mm", write_csv(drop, record(scene())),
        "--free", f"{RADIUS}=0.0032:0.005±50%",
        "--json", str(data), "--out", str(tmp_path / "o.toml"),
    ])  # fmt: skip
    assert ended.exit_code == 1, ended.output
    said = json.loads(data.read_text())
    estimate = said["parameters"][RADIUS]
    assert (estimate["verdict"], estimate["low"]) == ("at its bound", None)
    assert estimate["value"] == pytest.approx(0.0032, rel=1e-6)
    assert estimate["high"] is not None
    assert said["statistics"]["at_bound"] == [RADIUS]
    assert said["model"] == "does not fit"
    assert any(f"{RADIUS} is at a bound of its range, the low one" in r for r in said["reasons"])
    assert "identified" not in ended.output


def test_the_command_writes_json_scene_and_picture(tmp_path):
    path = write_csv(tmp_path / "drop.csv", record(scene()))
    data, toml, picture = (tmp_path / name for name in ("f.json", "f.toml", "f.svg"))
    words = ["fit", "aluminium-3mm", path, "--free", RADIUS, "--json", str(data),
             "--out", str(toml), "--picture", str(picture)]  # fmt: skip
    ended = invoke(words)
    assert ended.exit_code == 0, ended.output
    said = json.loads(data.read_text())
    estimate = said["parameters"][RADIUS]
    assert estimate["low"] < 0.003 < estimate["high"]
    assert estimate["verdict"] == "identified"
    again = load(str(toml))
    assert again.mechanics.sphere.radius_m == estimate["value"]
    assert again.scene.fit.sha256 == (said["records"][0]["sha256"],)
    text = picture.read_text()
    for part in ("drop.csv", "contact_force (N)", "residual over noise", "measured", "simulated"):
        assert f"<!-- {part} -->" in text, part


_PAGE = Path(__file__).parents[3] / "docs" / "reference" / "fit-json.md"
# A field without a type is a number; "or null" alone stands for "number or null".
FIELDS = {
    name: f"number {kind}".strip() if kind in ("", "or null") else kind
    for names, kind in re.findall(
        r"^- ((?:`[^`]+`,? ?)+)(?:\(([^)]+)\))?: ", _PAGE.read_text("utf-8"), re.M
    )
    for name in re.findall(r"`([^`]+)`", names)
}


def fields(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Fields of a JSON by the paths of the page, where `*` is any of a list and any name."""
    yield path, value
    inside = [known for known in FIELDS if known.startswith(f"{path}.".removeprefix("."))]
    if inside and value is not None:
        named = inside[0].startswith(f"{path}.*")
        parts = enumerate(value) if isinstance(value, list) else value.items()
        for key, part in parts:
            yield from fields(part, f"{path}.{'*' if named else key}".removeprefix("."))


@pytest.mark.full
def test_json_has_the_fields_of_its_page(tmp_path):
    seen: set[str] = set()
    elastic, yields = record(scene()), record(scene(*YIELDS), seed=4)
    one = write_csv(tmp_path / "a" / "drop.csv", elastic)
    same_name = write_csv(tmp_path / "b" / "drop.csv", record(scene(), seed=8))
    bad = write_csv(tmp_path / "yields.csv", yields)
    late = write_csv(
        tmp_path / "late.csv",
        replace(elastic, time_s=elastic.time_s[450:], value=elastic.value[450:]),
    )
    free = ["--free", RADIUS]
    for words, code, model in (
        ([one, *free], 0, "fits"),
        ([bad, *free], 1, "does not fit"),
        ([late, *free, "--free", f"{HEIGHT}±5%"], 0, "cannot tell"),
        ([one, "--free", "plate.loss_factor", "--free", THICKNESS], 2, "fits"),
        ([one, same_name, *free, "--hold-out", same_name], 0, "fits"),
        ([one, *free, "--check"], 0, "cannot tell"),
        (["--check", "--expect", "v_p:150us:0.3%", "--free", "contact.stiffness_factor",
          "--free", "sphere.material.young_pa"], 2, "cannot tell"),
    ):  # fmt: skip
        path = tmp_path / "f.json"
        if "--check" not in words:
            words += ["--out", str(tmp_path / "o.toml")]
        ended = invoke(["fit", "aluminium-3mm", *words, "--json", str(path), "--overwrite"])
        assert ended.exit_code == code, ended.output
        text = path.read_text("utf-8")
        data = json.loads(text)
        assert "NaN" not in text
        assert "Infinity" not in text
        assert set(data) == {path for path in FIELDS if "." not in path}
        for path, value in fields(data):
            if path and not path.endswith("*"):
                assert value is not None or FIELDS[path].endswith(" or null"), path
                seen.add(path)
        assert data["model"] == model
        assert data["checked_only"] == ("--check" in words)
        assert (data["scene"] is None) == (code == 2 or "--check" in words)
        if same_name in words:
            assert list(data["nuisances"]["by_record"]) == ["drop.csv"]
            assert data["hold_out"]["records"] == ["drop.csv"]
    assert seen == set(FIELDS)


def test_an_option_without_use_is_refused(tmp_path):
    path = write_csv(tmp_path / "drop.csv", record(scene()))
    with_scene, supposed = ["aluminium-3mm", path, "--free", RADIUS], "contact_force:80us:0.3%"
    for words, option, value, why in (
        ([*with_scene, "--check"], "--hold-out", [path], "is part of a fit"),
        ([path, "--check"], "--exact", [], "is part of a fit"),
        ([path, "--check"], "--expect", [supposed], "needs a scene"),
        (with_scene, "--expect", [supposed], "supposes a record"),
    ):
        refused(f"{option}: {why}", "fit", *words, option, *value)


def test_records_that_count_twice_or_not_at_all_are_refused(tmp_path):
    path = write_csv(tmp_path / "drop.csv", record(scene()))
    words = ["fit", "aluminium-3mm", path, "--free", RADIUS]
    refused("drop.csv: is given twice", *words, path)
    refused("--hold-out drop.csv: leaves no record to fit", *words, "--hold-out", path)


def test_inputs_of_a_fit_are_not_replaced(tmp_path):
    path, rig = write_csv(tmp_path / "drop.csv", record(scene())), tmp_path / "rig.toml"
    rig.write_text(to_toml(scene().scene))
    table = tmp_path / "drop.toml"
    table.write_text("[record]\nclock_tolerance_ppm = 10\n")
    words = ["fit", str(rig), path, "--free", RADIUS, "--overwrite"]
    for file in (str(rig), path, str(table)):
        refused(f"--out = {file}: is an input", *words, "--out", file)


@pytest.mark.parametrize(
    "text",
    [
        "contact_force:80us:0.3%:0MHz",
        "contact_force:1e12us:0.3%",
        "contact_force:80us:0.3%:1e9MHz",
        "contact_force:1e1e1us:0.3%",
    ],
)
def test_an_expected_record_that_no_instrument_makes_is_refused(text):
    with pytest.raises((FitError, RecordError), match=f"--expect {text}:"):
        expected_record(scene(), text)


def test_draws_of_a_fitted_scene_follow_its_covariance(tmp_path):
    from hertzloop.fitting.fit.report import fitted_scene
    from hertzloop.studies.cases.uncertain_file import read_uncertain

    found = fitted(scene(), record(scene()), RADIUS, HEIGHT)
    path = tmp_path / "rig.toml"
    path.write_text(fitted_scene(found, "rig"))
    uncertain = read_uncertain(path, load(str(path)))
    assert uncertain.keys == [RADIUS, HEIGHT]
    drawn = [uncertain.draw(1, number) for number in range(4000)]
    rows = [[one[RADIUS], one[HEIGHT]] for one in drawn]
    np.testing.assert_allclose(np.cov(np.log(rows).T), found.covariance, rtol=0.1, atol=1e-12)
    with pytest.raises(SceneError, match="does not hold"):
        read_uncertain(path, load(str(path), ["sphere.radius_m=0.004"]))
