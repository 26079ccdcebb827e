"""Arrays of laws: the compiled law, and the law as Python, see them as they are."""

import numpy as np
import pytest

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import LawContext, LawError
from hertzloop.controller.loading import compiled
from hertzloop.controller.loading.registry import find
from hertzloop.loop.answering import answer_samples

START = """
from typing import NamedTuple

import numpy as np
from hertzloop.law import Keys, kernel
"""
ROWS = "np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])"
ROW = "np.sum(c[1]) + 10.0 * len(c) + 100.0 * c.shape[1] + c[0, 2]"
# A constant `c`, what a command makes of it, and the number that comes out.
CONSTANTS = {
    "number": ("2.5", "c", 2.5),
    "number named as a count": ("3", "c", 3.0),
    "rows": (ROWS, ROW, 338.0),
    "rows of Fortran's order": (f"np.asfortranarray({ROWS})", ROW, 338.0),
    "part of rows": (f"np.tile({ROWS}, 2)[:, :3]", ROW, 338.0),
    "rows of small floats": (f"{ROWS}.astype(np.float32)", ROW, 338.0),
    "rows in a list": ("[[1, 2, 3], [4, 5, 6]]", ROW, 338.0),
    "rows in tuples": ("((1, 2, 3), (4.0, 5, 6))", ROW, 338.0),
    "three axes": ("np.arange(8.0).reshape(2, 2, 2)", "c[1, 0, 1] + c[0][1, 0]", 7.0),
    "product": (ROWS, "(c @ c[0])[1] + (c @ c.T)[0, 1]", 64.0),
    "index": ("np.array([2, 0])", "samples[c[0]] + c[0]", 5.0),
    "small integers": ("np.array([2, 0], np.uint8)", "samples[c[0]] + c[0]", 5.0),
    "bools": ("np.array([False, True])", "7.0 if c[1] and not c[0] else 1.0", 7.0),
    "nothing": ("np.zeros((0, 2))", "7.0 + len(c)", 7.0),
    "no axis": ("np.array(7.0)", "c", 7.0),
    "small float": ("np.float32(7.0)", "c", 7.0),
}
STATES = {
    "tuple": ("(0, 1)", "c[1] / 8.0", 0.125),
    "tuples": ("((1, 2, 3), (4.0, 5, 6))", ROW, 338.0),
    "integers": ("np.array([[1, 2], [3, 4]])", "c[1, 0] / 8.0", 0.375),
    "rows of Fortran's order": (f"np.asfortranarray({ROWS})", ROW, 338.0),
    "three axes": ("np.arange(8.0).reshape(2, 2, 2)", "c[1, 0, 1] + c[0][1, 0]", 7.0),
    "no axis": ("np.array(7.0)", "c", 7.0),
    "product": (ROWS, "(c @ c[0])[1] + (c @ c.T)[0, 1]", 64.0),
}


def law_of(folder, seen, values, made):
    """A law that sees values as `p` or `s`; its command for a sample is what is made of one."""
    names = ["v0_count" if i == 1 else f"v{i}" for i in range(len(values))]
    home = "State" if seen == "s" else "P(NamedTuple)"
    start = values if seen == "s" else ["0"] * len(values)
    lines = [START, f"class {home}:"]
    lines += [f"    {name}: object = {value}" for name, value in zip(names, start, strict=True)]
    if seen == "p":
        lines += ["def prepare(keys, about):", f"    return P({', '.join(values)})"]
    for name, text in zip(names, made, strict=True):
        lines += ["@kernel", f"def of_{name}(c, samples):", f"    return {text}"]
    lines += ["def command(p, s, samples, i):"]
    lines += [f"    if i == {i}: return of_{n}({seen}.{n}, samples)" for i, n in enumerate(names)]
    path = folder / "mine.py"
    path.write_text("\n".join([*lines, "    return 0.0\n"]))
    return find(str(path))


@pytest.mark.parametrize("seen", ["p", "s"])
def test_arrays_are_seen_as_they_are(seen, tmp_path, monkeypatch):
    values, made, wanted = zip(*(CONSTANTS if seen == "p" else STATES).values(), strict=True)
    law = law_of(tmp_path, seen, values, made)
    samples = np.full(len(values), 3.0)
    for as_python in (False, True):
        monkeypatch.setattr(compiled, "UNCOMPILED", as_python)
        bound = law.bind(law.keys(), LawContext())
        assert bound.trouble == ""
        controller = Controller(bound, SignalPath(), 1e-6, len(samples) + 1, 1, 0)
        assert tuple(answer_samples(controller, samples).forces[1:]) == wanted
        assert bound.reads_unknown(samples) == ""  # as Python once more, which says what fails


REFUSED = {
    "np.array([1j, 2.0])": "v0 is complex. Give two real arrays or numbers: v0.real and v0.imag",
    "[[1.0, 2.0], [3.0]]": "v0 has rows of different lengths. Give an array for each",
    "np.array([1.0, None])": "v0 holds something else than numbers. Give an array of numbers",
    "np.ma.array([1.0, 2.0], mask=[0, 1])": "v0 is a MaskedArray. Give a plain array: np.array",
    "P(1.0)": "v0 is the NamedTuple P. Give its fields one by one",
    "{'a': 1.0}": "v0 is a dict, neither a number nor an array of numbers",
    "None": "v0 is a NoneType, neither a number",
    "2**70": "v0 = .* needs more than 64 bits. Give a float",
    "np.array([2**63], np.uint64)": "v0 needs more than 63 bits. Give an array of floats",
}


@pytest.mark.parametrize("constant", REFUSED)
def test_other_constants_are_refused_with_what_to_write(constant, tmp_path):
    law = law_of(tmp_path, "p", [constant], ["1.0"])
    with pytest.raises(LawError, match=f"mine.py: is invalid: {REFUSED[constant]}"):
        law.bind(law.keys(), LawContext())


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("np.array([1j, 2.0])", "State.v0 is complex. Give two real arrays"),
        ("((1.0, 2.0), (3.0,))", "State.v0 has rows of different lengths"),
        ("np.array([None])", "State.v0 holds something else than numbers"),
        ("1j", "State.v0 needs a number, or an array of numbers"),
    ],
)
def test_other_states_are_refused_with_what_to_write(state, words, tmp_path):
    law = law_of(tmp_path, "s", [state], ["1.0"])
    with pytest.raises(LawError, match=f"mine.py: is invalid: {words}"):
        law.bind(law.keys(), LawContext())
