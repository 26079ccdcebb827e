"""The choice of a format by the ending and the first bytes of a file."""

import re

import pytest

from hertzloop.fitting.records import formats
from hertzloop.fitting.records.errors import RecordError


def test_a_file_that_begins_like_no_format_of_its_ending_is_refused(tmp_path, monkeypatch):
    row = formats.FORMATS[0]
    rows = [row._replace(endings=(".x",), beginning=re.compile(start)) for start in ("a", "b")]
    monkeypatch.setattr(formats, "FORMATS", rows)
    path = tmp_path / "r.x"
    path.write_text("b")
    assert formats.format_of(path) is rows[1]
    path.write_text("c")
    with pytest.raises(RecordError, match=r"does not begin like a format with the ending '\.x'"):
        formats.format_of(path)
