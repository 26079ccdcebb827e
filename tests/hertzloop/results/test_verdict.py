"""A run ends in words: whether control helped, in what, why not, and what spoils the metrics."""

from pathlib import Path

import pytest

from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.recordings.recording import Event, EventData
from hertzloop.results.inspection import saturation_of
from hertzloop.scene.toml import to_toml
from tests.commands import as_options, invoke
from tests.hertzloop.scenes import aluminium_3mm, json_in


def run(folder: Path, *settings: str, scene: str = "aluminium-3mm") -> tuple[list[str], str]:
    words = as_options(settings)
    done = invoke(
        ["run", scene, "--transport", "compiled", "--overwrite", "--out", str(folder / "a.mcap"),
         "--json", str(folder / "a.json"), *words],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = json_in(folder / "a.json")["verdict"]
    output = " ".join(done.output.split())
    assert all(sentence in output for sentence in said)
    return said, output


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "sentences"),
    [
        ("controller.v_thr_m_s=-0.6", [
            "OUT OF RANGE", "Control reduces plate energy by ",
            "Worse (first impact): rebound height +", "Better (first impact): radiated energy"]),
        ("", [
            "OUT OF RANGE: ", "Control increases plate energy by at most 0.4 dB in the first",
            "Worse (first impact): rebound height +56 to +65 %.",
            "Better (first impact): pressure bound at 1 m -1.5 to -1.4 dB, radiated energy",
            "Reason: the first force comes 13 us after contact begins (45 % of it).",
            "Reason: 19 % of the control impulse", "Reason: the actuator adds 103 uJ"]),
        ("contact.plasticity=thornton controller.v_thr_m_s=-0.6", [
            "Control increases plate energy by ", "Worse (first", "Better (first",
            "Reason: the first force", "Reason: 21 % of", "Reason: the actuator adds",
            "Reason: the law takes the permanent dent of 2.5 um for penetration."]),
        ("run.duration_s=0.15", [
            "OUT OF", "Control increases plate energy by at most 0.4 dB in the first impact.",
            "Later impacts are not predictable.", "Worse (", "Better (", "Reason: ", "Reason: ",
            "Reason: "]),
        ("controller.kappa=0.001", [
            "OUT OF", "Control leaves plate energy nearly unchanged in the first impact.",
            "Reason: ", "Reason: "]),
        ("controller.kappa=0.1 run.accuracy=0.1", [
            "OUT OF", "The effect of control is unpredictable: the error of the model exceeds"]),
        ("controller.v_thr_m_s=5", ["OUT OF", "Control has no effect: no force of the law acts."]),
        ("actuator.stuck_from_s=0", ["OUT OF", "Control has no effect: no force of the law acts."]),
        ("controller.law=off", ["OUT OF"]),
        ("controller.kappa=2 controller.latency_us=2", [
            "OUT OF RANGE", "Control increases plate energy", "Worse (first", "Better (",
            "Reason: ", "Reason: ", "Reason: ", "The loop adds energy from"]),
        ("run.duration_s=0.0005", ["No impact occurs within the run."]),
        ("run.duration_s=0.00101 controller.law=off", ["OUT OF", "The run ends during the"]),
        ("sensors.bits=12 sensors.full_scale=[-5e-6,1e-5]", [
            "OUT OF RANGE", "Control reduces plate energy", "Worse (", "Better (",
            "The sensor saturated once, first at 1.0"]),
    ],
)  # fmt: skip
def test_a_verdict(tmp_path, settings, sentences):
    length = [] if "run.duration_s" in settings else ["run.duration_s=0.0015"]
    said, output = run(tmp_path, *length, *settings.split())
    assert len(said) == len(sentences)
    for sentence, words in zip(said, sentences, strict=True):
        assert words in sentence
    if "controller.law=off" in settings:
        assert "ith control" not in output  # there is nothing to compare
        assert " dB" not in output
    inspected = invoke(["inspect", str(tmp_path / "a.mcap")])
    for sentence in said:
        # What takes the run without control is not known to a recording.
        compared = sentence.startswith(
            ("Control", "The effect", "Later", "Better", "Worse", "Reason")
        )
        assert (sentence in " ".join(inspected.output.split())) != compared


def test_a_metric_without_a_value_and_an_unknown_effect_have_a_reason(tmp_path):
    own = "material = { young_pa = 7e10, density_kg_m3 = 2700, poisson = 0.33, loss_factor = 1e-3 }"
    scene = to_toml(aluminium_3mm().scene).replace('material = "aluminium"', own)
    assert own in scene
    (tmp_path / "own.toml").write_text(scene)
    _, output = run(tmp_path, "run.duration_s=0.0013", scene=str(tmp_path / "own.toml"))
    sentence = "Unknown: whether the plate yields; its contact is elastic here. Give"
    assert sentence in output
    short = ["--set", "run.duration_s=0.0013"]
    checked = invoke(["scene", "check", str(tmp_path / "own.toml"), *short])
    unknown = [line for line in checked.output.splitlines() if line.startswith("Unknown: ")]
    assert len(unknown) > 1
    assert all(" ".join(line.split())[:70] in output for line in unknown)
    _, output = run(tmp_path, "run.duration_s=0.0013", "plate.edges=cccc")
    assert "│ - │ - │ │" in output
    assert "radiated energy: known for simply supported plates" in output


BEGAN, ENDED = EventData(EventKind.CONTACT_BEGAN), EventData(EventKind.CONTACT_ENDED)
OUT = EventData(EventKind.RANGE_LEFT, quantity="xi")
BACK = EventData(EventKind.RANGE_REGAINED, quantity="xi")


@pytest.mark.parametrize(
    ("announced", "expected"),
    [
        ([BEGAN, ENDED], None),
        ([OUT, BEGAN, ENDED, BEGAN], (1, 2)),
        ([BEGAN, OUT, BACK, OUT], (2, 2)),
        ([BEGAN, OUT, ENDED, BACK, OUT], (1, 2)),
    ],
)
def test_a_gap_out_of_range_counts_while_it_matters(announced, expected):
    """Once each time that it leaves, however many contacts pass until it is back."""
    events = [Event(int(1e6 * ms), "plant", 3, "...", data) for ms, data in enumerate(announced, 1)]
    events.append(Event(0, "controller", 3, "...", EventData(EventKind.RANGE_LEFT, quantity="v_p")))
    found = saturation_of(events)
    assert (found and (found.times, pytest.approx(found.since_s * 1e3))) == expected
