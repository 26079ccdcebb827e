"""A law and its files; its digest is of all that decides what it does, and of nothing else."""

import pytest

from hertzloop.controller.loading import identity
from hertzloop.controller.loading.identity import text_digest
from hertzloop.controller.loading.registry import find


@pytest.fixture
def law(tmp_path):
    """A law that uses a file beside it, which uses another; and a file that nothing uses."""
    (tmp_path / "mine.py").write_text("import math\nimport shaping\n")
    (tmp_path / "shaping.py").write_text("def late():\n    from tables import GAIN\n")
    (tmp_path / "tables.py").write_text("GAIN = 2.0\n")
    (tmp_path / "notes.py").write_text("GAIN = 3.0\n")
    return tmp_path / "mine.py"


@pytest.mark.parametrize("name", ["mine", "shaping", "tables"])
def test_every_file_that_is_used_counts(law, name):
    before = text_digest(law)
    file = law.with_name(f"{name}.py")
    file.write_text(file.read_text() + "# again\n")
    assert text_digest(law) != before


def test_a_file_that_is_not_used_does_not(law):
    before = text_digest(law)
    law.with_name("notes.py").unlink()
    assert text_digest(law) == before


def test_shipped_laws_are_among_those_used(law, tmp_path, monkeypatch):
    """A version of hertzloop that changes them changes the law that builds on them."""
    shipped = tmp_path / "laws" / "slope_threshold.py"
    assert (identity.SHIPPED / shipped.name).is_file()
    monkeypatch.setattr(identity, "SHIPPED", shipped.parent)
    shipped.parent.mkdir()
    shipped.write_text("GAIN = 1.0\n")
    law.write_text("from hertzloop.controller.laws import slope_threshold\n")
    before = text_digest(law)
    shipped.write_text("GAIN = 1.5\n")
    assert text_digest(law) != before


def test_a_file_is_looked_for_in_the_working_folder(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text((identity.SHIPPED / "off.py").read_text())
    monkeypatch.chdir(tmp_path)
    law = find("mine.py")
    monkeypatch.chdir("/")
    assert law.path == tmp_path / "mine.py"
    assert law.digest.startswith(text_digest(law.path)[:16])
