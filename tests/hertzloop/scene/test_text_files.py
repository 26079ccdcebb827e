"""Scenes, laws, requirements, traces and mode files in the encodings that editors write."""

import codecs
import importlib
import unicodedata
from pathlib import Path

import pytest

from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find
from hertzloop.fitting.records.reading import read_records
from hertzloop.plant.structures.mode_file import read_modes
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import load, parse, shipped_text
from hertzloop.studies.budget.requirements.requirement import read_requirements

READ = {
    "mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "utf-16-le": lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
    "utf-16-be": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    "windows": lambda text: codecs.BOM_UTF8 + text.replace("\n", "\r\n").encode(),
}
SCENE = "# Stöße\n" + shipped_text("aluminium-3mm")
LAW = Path(importlib.import_module("hertzloop.controller.laws.force_feedback").__file__ or "")
UMLAUT = '"""Verstärker."""\n' + LAW.read_text("utf-8")
MODES = (
    "frequency_hz,loss_factor,modal_mass_kg,shape_contact\n120.5,0.01,0.4,1.0\n300,0.01,0.4,0.5\n"
)
REQUIREMENTS = """# Über die Kraft
[hertzloop]
law = "force_feedback"

[[requirement]]
name = "peak"
scene = "aluminium-3mm"
limit = { peak_force_n = 100.0 }
"""


@pytest.mark.parametrize("encoded", READ.values(), ids=READ)
def test_files_that_are_read(encoded, tmp_path):
    """Every kind of text file is read as the same text in UTF-8 without a mark."""
    scene = tmp_path / "a.toml"
    scene.write_bytes(encoded(SCENE))
    assert load(str(scene)) == load("aluminium-3mm")

    trace = tmp_path / "trace.csv"
    trace.write_bytes(encoded("latency_us\n1\n2\n"))
    traced = load(str(scene), [f"controller.latency_trace={trace}"])
    assert list(traced.controller.latency_trace) == [1.0, 2.0]

    assert read_modes("m.csv", encoded(MODES)) is not None

    materials = tmp_path / "materials.toml"
    materials.write_bytes(
        encoded("[mine]\nyoung_pa = 70e9\npoisson = 0.3\ndensity_kg_m3 = 2700.0\n")
    )
    own = load(str(scene), [f"materials={materials}", "plate.material=mine"])
    assert [one.name for one in own.materials] == ["mine"]

    record = tmp_path / "record.csv"
    record.write_bytes(
        encoded("time_s,force_n\n" + "".join(f"{i}e-6,{i % 5}\n" for i in range(20)))
    )
    requirements = tmp_path / "requirements.toml"
    requirements.write_bytes(encoded(REQUIREMENTS))
    assert [row.name for row in read_requirements(requirements)] == ["peak"]

    beside = tmp_path / "record.toml"
    beside.write_bytes(encoded('[record]\nquantity = "force"\n'))
    assert read_records(record)[0].quantity


# A file in an encoding that is refused, and words of the sentence.
REFUSED = [
    ("a.toml", SCENE.encode("latin-1"), "is not in UTF-8: byte 0xf6 in line 1"),
    ("a.toml", SCENE.encode("utf-16-le"), "null bytes, as UTF-32 has, and UTF-16 without a mark"),
    ("a.toml", SCENE.encode("utf-16")[:-1], "is not in UTF-16"),
    ("a.py", UMLAUT.encode("utf-16"), "its text is in UTF-16, which Python does not read"),
    ("a.py", UMLAUT.encode("latin-1"), "is not in UTF-8: byte 0xe4 in line 1"),
]


@pytest.mark.parametrize(("name", "content", "words"), REFUSED)
def test_files_that_are_refused(name, content, words, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises((SceneError, LawError)) as caught:
        find(str(path)) if path.suffix == ".py" else load(str(path))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        ("# -*- coding: latin-1 -*-\n" + UMLAUT).encode("latin-1"),
        codecs.BOM_UTF8 + UMLAUT.encode(),
        UMLAUT.replace("\n", "\r\n").encode(),
    ],
    ids=["latin-1", "mark", "windows"],
)
def test_laws_that_are_read(content, tmp_path):
    path = tmp_path / "mine.py"
    path.write_bytes(content)
    law = find(str(path))
    assert "Verstärker" in law.source
    assert "\r" not in law.source
    (tmp_path / "back.py").write_text(law.source, "utf-8")  # as from a recording
    assert find(str(tmp_path / "back.py")).source == law.source


@pytest.mark.parametrize("name", ["sto\u0308ße", "梁"])
def test_letters_of_any_language_in_a_name(name):
    """A letter and its accent as two characters, as macOS writes them, count as one."""
    named = parse(shipped_text("aluminium-3mm").replace('"aluminium-3mm"', f'"{name}"'))
    assert named.name == unicodedata.normalize("NFC", name)


@pytest.mark.parametrize(("name", "use"), [("a b", "a-b"), ("../a", "a"), ("$", "mine")])
def test_names_that_are_refused(name, use):
    text = shipped_text("aluminium-3mm").replace('"aluminium-3mm"', f'"{name}"')
    with pytest.raises(SceneError, match=rf"and '-' only\. Use '{use}'\."):
        parse(text)
