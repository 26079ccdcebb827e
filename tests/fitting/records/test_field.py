"""Every file in the layouts of instruments gives the right answer, or the refusal it must give."""

import pytest

from hertzloop.fitting.records.reading import read_record
from tests.fitting.records.field import ANSWERS, FOLDER, asked, right

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="the files are not beside the clone")
TEXTS = [name for name in ANSWERS if name.endswith((".csv", ".txt"))]
RECORDS = [name for name in TEXTS if not ANSWERS[name].refused and not ANSWERS[name].words]


@pytest.mark.parametrize("name", RECORDS)
def test_times_and_values_of_a_record_are_in_si_units(name):
    """All hold a pulse of about 91 N and 50 us, sampled every 0.5 us."""
    one = read_record(FOLDER / name)
    assert one.interval_s == pytest.approx(5e-7, rel=1e-3)
    assert max(one.value[one.value == one.value]) == pytest.approx(90.8, rel=2e-3)


@pytest.mark.full
@pytest.mark.parametrize("name", ANSWERS)
def test_a_file_gives_the_right_answer(name, tmp_path):
    if name.endswith(".fmu"):
        pytest.importorskip("fmpy")
    code, text = asked(name, tmp_path)
    assert right(name, code, text, tmp_path), text


@pytest.mark.full
def test_every_file_has_an_answer():
    beside = {
        "README.md",
        "fmu.c",
        "fmu_make.py",
        "laws",
        "turn6",
        "requirements.toml.other-tool",
    }
    found = {path.name for path in FOLDER.iterdir() if path.suffix != ".toml"}
    assert found - beside == set(ANSWERS)
