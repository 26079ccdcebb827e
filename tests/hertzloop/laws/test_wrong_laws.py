"""Laws that are wrong: one sentence each, exit code 2 before the run and 1 in it."""

from pathlib import Path

import pytest

from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find
from hertzloop.loop.run_options import Transport
from hertzloop.processes.law_trial import check_repeatable, try_law
from hertzloop.recordings.reader import read
from hertzloop.results.recorded import reported_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import parse
from hertzloop.scene.toml import to_toml
from tests.commands import refused
from tests.hertzloop.commands import hertzloop, python
from tests.hertzloop.own_laws import EXAMPLES, SHORT, build, needs_cc, write_law
from tests.hertzloop.scenes import aluminium_3mm
from tests.tiers import default

LONGER = ["--set", "run.duration_s=0.004"]  # than the trial of a law, in samples


def law_refused(law: str, words: str) -> None:
    """A run is refused before it begins, with these words."""
    refused(words, "run", "aluminium-3mm", "--set", SHORT, "--set", f"controller.law={law}")
    assert not list(Path().glob("*.mcap"))


NOTHING = "def command(p, s, samples, i):\n    return 0.0\n"
AHEAD = "def known_ahead(p, s, samples, i):\n    return 5\n"
AHEAD += "def command_ahead(p, s, samples, i, j):\n    return 0.0\n"
QUIET = "def trigger_level(p, s):\n    return 0.0\n"
PUSHES = NOTHING.replace("0.0", "2.0 if i == 350 else 0.0")
BEFORE = [
    ("def command(p, s, samples, i:\n", "mine.py: is not valid Python"),
    ("x = 1\n", "is not a law; the function command(p, s, samples, i) is missing"),
    ("def command(p, s, x):\n    return 0.0\n", "Define it as command(p, s, samples, i)"),
    ("import nothing_such\n", "No module named 'nothing_such' (line 1)"),
    (f"senses = 'smell'\n{NOTHING}", "senses = 'smell' is unknown"),
    (f"{NOTHING}def known_ahead(p, s, samples, i):\n    return 0\n", "one of known_ahead and com"),
    (f"class Parameters:\n    a = 1\n{NOTHING}", "derived from hertzloop.law.Keys"),
    (f"class State:\n    name: str = 'x'\n{NOTHING}", "State.name needs a number"),
    (
        f"def prepare(keys, about):\n    return {{}}['x']\n{NOTHING}",
        "KeyError: 'x' (line 2)",
    ),
    (
        f"def prepare(keys, about):\n    return {{'x': 1.0}}\n{NOTHING}",
        "prepare returned dict. Return a NamedTuple of numbers and arrays",
    ),
    (f"class State:\n    n = 0\n{NOTHING}", "State.n needs a type: write n: int = 0"),
    (
        NOTHING.replace("return", "samples[i] = 3.0\n    return"),
        "mine.py: changes samples[0], which it may only read",
    ),
    ("raise SystemExit(0)\n", "cannot be loaded: SystemExit: 0 (line 1)"),
    (
        f"def force_bound(keys):\n    return 1 / 0\n{NOTHING}",
        "force_bound failed: ZeroDivisionError: division",
    ),
    (
        f"{NOTHING}def trigger_level(p, s):\n    return depth\n",
        "'depth' is not defined (in trigger_level",
    ),
    # The trial does not reach it.
    (NOTHING.replace("0.0", "tiny if i > 100_000 else 0.0"), "name 'tiny' is not defined (in com"),
    (NOTHING.replace("0.0", "'much'"), "at sample 0"),
    (
        PUSHES + AHEAD,
        "mine.py, at sample 350, commanded 2.0 N, but its command_ahead had said 0.0 N",
    ),
    (PUSHES + QUIET, "trigger_level had promised no force"),
    (NOTHING.replace("0.0", "float('nan') if i == 30 else 0.0"), "at sample 30, commanded nan N"),
    (
        "class State:\n    last: float = 0.0\n"
        + NOTHING.replace("return", "s.lst = samples[i]\n    return"),
        "(line 4: s.lst = samples[i])",
    ),
    (
        "def refuse():\n    raise ValueError('too much')\n"
        "def too_much():\n    refuse()\n    return 0.0\n" + NOTHING.replace("0.0", "too_much()"),
        "too much (line 2: raise ValueError('too much'))",
    ),
]


@pytest.mark.parametrize(("text", "words"), BEFORE)
def test_wrong_before_the_run(here, text, words):
    (here / "mine.py").write_text(text)
    law_refused("mine.py", words)


def test_a_law_that_is_not_there(here):
    write_law(here)
    law_refused("mine.py:Other", "does not define Other")
    law_refused("none.py", "cannot be read: there is no such file")
    law_refused("slope_treshold", "Did you mean slope_threshold?")
    law_refused("no_such.module:Law", "no_such")


def test_one_of_several_quantities_is_asked_for(here):
    (here / "mine.py").write_text(f"senses = 'contact_force, v_p'\n{NOTHING}")
    words = "Use 'contact_force' or 'v_p' or 'auto'."
    settings = ["--set", "controller.law=mine.py", "--set", "sensors.quantity=xi"]
    refused(words, "run", "aluminium-3mm", *settings)


def test_ranges_that_are_none(here):
    write_law(here).open("a").write("def tune(about):\n    return [('share', 0.0, 1.0)]\n")
    refused("Return {key: (low, high)}", "tune", "--law", "mine.py")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (
            "return samples[i + 1]",
            r"at sample 0, failed: UnknownSample: samples\[1\] is not known yet; at sample 0 a law "
            r"may read samples\[0\] to samples\[0\] \(line \d+: return samples\[i \+ 1\]\)",
        ),
        # What is read never gets into the force.
        ("if samples[i] < samples[i + 3]: s.largest_n += 1.0", r"samples\[3\] is not known yet"),
        ("if i == 40: return ahead(samples, i)", r"at sample 40, .*samples\[42\] is not known"),
        ("if i == 2: return ahead(samples, -5)", r"at sample 2, .*samples\[-3\] does not exist"),
    ],
)
def test_reads_a_sample_that_it_is_not_given(here, line, words):
    path = write_law(here, line)
    text = "\nfrom hertzloop.law import kernel\n\n@kernel\ndef ahead(samples, i):\n"
    path.write_text(path.read_text() + text + "    return samples[i + 2]\n")
    scene = aluminium_3mm(SHORT, "controller.law=mine.py")
    with pytest.raises(SceneError, match=words):
        try_law(scene)


@pytest.mark.parametrize("at", ["i - 1", "i + (i == 370)"])
def test_a_library_that_reads_a_sample_that_it_is_not_given(here, at):
    text = (EXAMPLES / "low_passed.c").read_text()
    assert "samples[i]" in text
    (here / "mine.c").write_text(text.replace("samples[i]", f"samples[{at}]"))
    library = build(here, here / "mine.c")
    scene = aluminium_3mm(SHORT, f"controller.law={library}")
    with pytest.raises(SceneError, match=r"reads values before samples\[0\] .*samples\[i\] only"):
        try_law(scene)


def test_a_loop_without_end_before_the_run(here, monkeypatch):
    """In the file itself, in what it prepares, and in the trial."""
    monkeypatch.setattr("hertzloop.controller.loading.callbacks.PATIENCE_S", 0.2)
    monkeypatch.setattr("hertzloop.processes.law_trial._PREPARED_S", 0.2)
    (here / "mine.py").write_text("while True:\n    try: x = 1\n    except Exception: pass\n")
    with pytest.raises(SceneError, match=r"not loaded within 0.2 s. Check it for an endless loop"):
        aluminium_3mm(SHORT, "controller.law=mine.py")
    (here / "mine.py").write_text(
        "def prepare(keys, about):\n    while True: pass\n"
        "def command(p, s, samples, i):\n    return 0.0\n"
    )
    scene = aluminium_3mm(SHORT, "controller.law=mine.py")
    with pytest.raises(SceneError, match=r"mine.py: was not prepared within 0.2 s"):
        try_law(scene)
    monkeypatch.undo()
    monkeypatch.setattr("hertzloop.processes.law_trial._PATIENCE_S", 0.5)
    write_law(here, "while i == 30: s.largest_n += 0.0")
    with pytest.raises(SceneError, match=r"within 0\.5 s\. Check it for an endless loop"):
        try_law(aluminium_3mm(SHORT, f"controller.law={here}/mine.py"))


def test_a_module_is_loaded_with_the_same_care(here, monkeypatch):
    monkeypatch.setattr("hertzloop.controller.loading.callbacks.PATIENCE_S", 0.2)
    monkeypatch.syspath_prepend(here)
    (here / "endless_law.py").write_text("while True:\n    pass\n")
    with pytest.raises(LawError, match=r"was not loaded within 0.2 s"):
        find("endless_law:Law")
    (here / "other_law.py").write_text(f"open('{here}/executed', 'w')\n")
    with pytest.raises(LawError, match="Copy the same file to both sides") as refused:
        find("other_law:Law", "0" * 32)
    assert "cannot be loaded" not in str(refused.value)
    assert not (here / "executed").exists()


LATE = {  # than the trial reaches
    "compiled": ("assert i != 3000, 'it is late'", "AssertionError: it is late"),
    "ahead": (
        "if i == 3000: return samples[i + 100_000_000]",  # far beyond the memory of the process
        "UnknownSample: samples[100003000] is not known yet; at sample 3000 a law may read "
        "samples[0] to samples[3000]",
    ),
    "exit": ("if i == 3000: import sys; sys.exit(0)", "SystemExit: 0"),  # as Python
}
CASES = [*(("exit", transport) for transport in Transport), ("compiled", Transport.COMPILED)]
CASES += [("ahead", Transport.COMPILED)]


@pytest.mark.parametrize("case", default(CASES, [CASES[0], CASES[-1]]), ids=" ".join)
def test_wrong_in_the_run(here, case):
    """The run ends; the recording up to there stays readable."""
    how, transport = case
    line, words = LATE[how]
    path = write_law(here, line)
    if how != "compiled":
        path.write_text(path.read_text().replace("p.share *", "float(str(p.share)) *"))
    settings = [*LONGER, "--set", "controller.law=mine.py", "--out", "a.mcap"]
    sentence = f"the law mine.py, at sample 3000, failed: {words} (line"
    refused(sentence, "run", "aluminium-3mm", "--transport", transport, *settings, code=1)
    recording = read(here / "a.mcap")
    assert recording.truth.samples > 2000
    told = next(problem for problem in recording.problems if words in problem)
    assert told.count(f"failed: {words}") == 1  # the role that heard of it adds nothing
    assert reported_law(recording)[0] == "mine.py"


LATER = PUSHES.replace("350", "3000")
BROKEN = {"command_ahead": LATER + AHEAD, "trigger_level": LATER + QUIET}


PROMISES = [
    ("command_ahead", Transport.COMPILED),
    ("trigger_level", Transport.COMPILED),
    ("command_ahead", Transport.ZENOH),
    ("trigger_level", Transport.INPROCESS),
]


@pytest.mark.parametrize("promise", default(PROMISES, PROMISES[:2]), ids=" ".join)
def test_a_broken_promise_ends_the_run(here, promise):
    """With the same sentence in all transports, where the trial did not come to it."""
    function, transport = promise
    (here / "mine.py").write_text(BROKEN[function])
    settings = [*LONGER, "--set", "controller.law=mine.py", "--out", "a.mcap"]
    words = f"the law mine.py, at sample 3000, commanded 2.0 N, but its {function} had "
    refused(words, "run", "aluminium-3mm", "--transport", transport, *settings, code=1)


@pytest.mark.parametrize("function", BROKEN)
def test_a_simulation_refuses_a_promise_that_the_trial_breaks(here, function):
    """Even one that ends before the sample at which the law breaks it."""
    (here / "mine.py").write_text(BROKEN[function].replace("3000", "370"))
    scene = aluminium_3mm(SHORT, "controller.law=mine.py")
    with pytest.raises(SceneError, match=f"at sample 370, commanded 2.0 N, but its {function}"):
        check_repeatable(scene)


def test_a_sweep_notes_the_case_in_which_a_law_fails(here):
    write_law(here, "if p.share > 0.7: raise ValueError('too much')")
    words = ["--set", SHORT, "--set", "controller.law=mine.py", "--workers", "1", "-o", "r.csv"]
    words += ["--over", "controller.share=0.2,0.9"]
    sentence = "the law mine.py, at sample 0, failed: ValueError: too much"
    assert "1 of 2 cases" in refused(sentence, "sweep", "aluminium-3mm", *words, code=1)


# A hertzloop that gives a law less time.
IMPATIENT = (
    "import hertzloop.loop.stuck_law as w; w.PATIENCE_S = 2.0\n"
    "from hertzloop.__main__ import main; main()"
)


@pytest.mark.full
@pytest.mark.parametrize("command", ["inprocess", "compiled", "sweep"])
def test_a_loop_without_end_in_the_run(here, command):
    """Nothing can interrupt it: its process ends, with a sentence."""
    write_law(here, "while i == 3000: s.largest_n += 0.0")
    words = ["run", "aluminium-3mm", "--transport", command, "--out", "a.mcap"]
    if command == "sweep":
        words = ["sweep", "aluminium-3mm", "--workers", "1", "--span", "run"]
        words += ["--over", "controller.share=0.2"]
    settings = [*LONGER, "--set", "controller.law=mine.py"]
    done = python("-c", IMPATIENT, *words, *settings, cwd=here, code=1)
    assert "Check it for an endless loop." in " ".join(done.stderr.split())
    if command != "sweep":
        assert any("endless loop" in problem for problem in read(here / "a.mcap").problems)


@pytest.mark.full
def test_a_slow_law_is_not_ended(here):
    """Though a message takes longer than a law may be silent."""
    write_law(here, "import time; time.sleep(0.001)")
    words = ["run", "aluminium-3mm", "--transport", "compiled", "--set", "run.duration_s=0.0015"]
    python(
        "-c", IMPATIENT.replace("2.0", "1.0"), *words, "--set", "controller.law=mine.py", cwd=here
    )


@pytest.mark.full
def test_a_loop_without_end_in_a_process_of_its_own(here):
    """The others wait for as long as they were told to, and say for whom."""
    write_law(here, "while i == 3000: s.largest_n += 0.0")
    words = ["run", "aluminium-3mm", *LONGER, "--set", "controller.law=mine.py", "--out", "a.mcap"]
    done = hertzloop(*words, "--timeout", "5", cwd=here, code=1)
    said = " ".join(done.stderr.split())
    hangs = "perhaps in an endless loop of the law mine.py"
    assert f"controller does not respond, {hangs}; plant waited" in said
    assert read(here / "a.mcap").truth.samples > 2000


def test_a_scene_asks_for_the_law_that_it_was_made_with(here):
    path = write_law(here)
    text = to_toml(aluminium_3mm("controller.law=mine.py").scene)
    with path.open("a") as file:
        file.write(f"\nopen('{here}/executed', 'w')\n")
    with pytest.raises(SceneError, match="Copy the same file to both sides"):
        parse(text)
    assert not (here / "executed").exists()


@needs_cc
def test_wrong_libraries(here):
    (here / "text.so").write_text("no library")
    law_refused("text.so", "it is no shared library of this system")
    other = bytearray(build(here, EXAMPLES / "low_passed.c").read_bytes())
    other[18] = 183 if other[18] != 183 else 62  # AArch64, x86-64
    (here / "other.so").write_bytes(other)
    law_refused("other.so", "another processor architecture")
    text = (EXAMPLES / "low_passed.c").read_text()
    raises = "#include <signal.h>\n" + text.replace("return s->", "raise(SIGUSR1); return s->")
    no_number = text.replace("return s->filtered_n;", "return i == 9 ? NAN : 0;")
    cases = (
        ("int nothing;\n", "the symbol hertzloop_law is missing"),
        (text.replace("sizeof(struct parameters)", "16"), "16 bytes of parameters"),
        (no_number, "no finite number as the command of sample 9"),
        (raises, "ended its process by signal"),
    )
    for number, (source, words) in enumerate(cases):
        path = here / f"{number}.c"
        path.write_text(source)
        law_refused(build(here, path).name, words)
