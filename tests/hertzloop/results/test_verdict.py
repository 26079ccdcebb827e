"""A run ends in words: whether control helped, in what, why not, and what spoils the metrics."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import pytest

from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.recordings.recording import Event, EventData
from hertzloop.results.effects import Neglected
from hertzloop.results.metrics import Metrics, RunResult, Saturation
from hertzloop.results.predictability import NOTHING_KNOWN, ImpactErrors, Predictability
from hertzloop.results.recorded_result import saturation_of
from hertzloop.results.repeatability import NotRepeatable, WhyNotRepeatable
from hertzloop.results.stability import Stability
from hertzloop.results.statistics import ForceTiming
from hertzloop.results.verdict import verdict
from hertzloop.views.verdict import verdict_sentences
from tests.commands import as_options, invoke
from tests.hertzloop.scenes import json_in


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
            "Control reduces plate energy by 1.5 dB.",
            "Better: radiated energy -3.6 dB, largest plate speed -0.9 dB.",
            "Worse: rebound height 192 % of that without control."]),
        ("", [
            "Control increases plate energy by 0.4 dB.", "Better: radiated energy -1.2 dB.",
            "Worse: rebound height 156 % of that without control.",
            "Reason: the first force comes 13 us after contact begins (45 % of it).",
            "Reason: 19 % of the control impulse", "Reason: the actuator adds 103 uJ"]),
        ("contact.plasticity=thornton controller.v_thr_m_s=-0.6", [
            "Control increases plate energy by 0.8 dB.", "Better: ", "Worse: ",
            "Reason: the first force", "Reason: 21 % of", "Reason: the actuator adds",
            "Reason: the law takes the permanent dent of 2.5 um for penetration."]),
        ("controller.v_thr_m_s=5", ["Control has no effect: no force of the law acts."]),
        ("actuator.stuck_from_s=0", ["Control has no effect: no force of the law acts."]),
        ("controller.law=off", []),
        ("controller.kappa=2 controller.latency_us=2", [
            "Control increases plate energy", "Worse: ", "Reason: ", "Reason: ", "Reason: ",
            "The loop adds energy from"]),
        ("run.duration_s=0.0005", ["No impact occurs within the run."]),
        ("run.duration_s=0.00101 controller.law=off", ["The run ends during the"]),
        ("sensors.bits=12 sensors.full_scale=[-5e-6,1e-5]", [
            "Control reduces plate energy", "Better: ", "Worse: ",
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
        compared = sentence.startswith(("Control", "Better", "Worse", "Reason"))
        assert (sentence in " ".join(inspected.output.split())) != compared


def test_a_contact_that_is_cut_off_is_not_called_a_short_one(tmp_path):
    run(tmp_path, "run.duration_s=0.00101", "controller.law=off")
    data = json_in(tmp_path / "a.json")
    assert data["impacts"][0]["duration_s"] < 11e-6
    (energy,) = (f for f in data["validity"] if f["name"] == "plate theory (energy)")
    assert energy["state"] == "left out"  # of 9 us it would be out of range


def impact(plate_energy_j: float) -> Impact:
    return Impact(0.0, 30e-6, 1.0, 1.0, 100.0, plate_energy_j, 0.1)


def noise(radiated_j: float) -> ImpactNoise:
    known = {"radiated_j": radiated_j, "plate_speed_max_m_s": 0.1, "rebound_height_m": 0.01}
    return ImpactNoise(**{field.name: known.get(field.name, 1.0) for field in fields(ImpactNoise)})


STABLE = Stability(False, False, None, 0.0, 0.0, 0.0, 0.0)


def metrics(impacts: Sequence[Impact], sounds: Sequence[ImpactNoise], push: ForceTiming) -> Metrics:
    """Metrics of a run of which no more is known than these."""
    return Metrics(
        list(impacts), list(sounds), None, None, True, STABLE, None, push, Neglected(None)
    )


def said_of(
    impacts: Sequence[Impact],
    sounds: Sequence[ImpactNoise],
    free: Metrics,
    known: Predictability = NOTHING_KNOWN,
    saturation: Saturation | None = None,
) -> list[str]:
    push = ForceTiming(1e-6, 0.0)
    result = RunResult(metrics(impacts, sounds, push), "mine", 1e-3, -1e-6, saturation=saturation)
    return verdict_sentences(verdict(result, free, known))


def test_the_words_follow_the_metrics():
    free = metrics([impact(1e-4)], [noise(1e-5)], ForceTiming(1e-6, 0.0))
    assert said_of([impact(1e-4)], [noise(1e-5)], free) == [
        "Control leaves plate energy nearly unchanged."
    ]
    assert said_of([impact(2e-4)], [noise(1e-6)], free) == [
        "Control increases plate energy by 3.0 dB.",
        "Better: radiated energy -10.0 dB.",
    ]
    said = said_of(
        [impact(1e-4), impact(-0.9e-4)], [noise(1e-6)], free, saturation=Saturation(2, 1e-3)
    )
    assert said[:3] == [
        "Control leaves plate energy nearly unchanged in the first impact.",
        "Over all contacts the change is -10.0 dB, with 2 contacts instead of 1.",
        "Better (first impact): radiated energy -10.0 dB.",
    ]
    assert any("saturated 2 times, first at 1 ms" in one for one in said)


def test_what_is_not_predictable_is_not_added_up():
    free = metrics([impact(1e-4), impact(1e-5)], [], ForceTiming(0.0, 0.0))

    def known(*errors_j: float) -> list[ImpactErrors]:
        return [ImpactErrors(1.0 if e == 0.0 else 1e3, {"plate_energy_j": e}, {}) for e in errors_j]

    def said(controlled: list[ImpactErrors] | None, not_again: NotRepeatable | None = None) -> str:
        known_of = Predictability(1e-3, controlled, known(0.0, 0.0), not_again)
        return said_of([impact(5e-5), impact(9e-5)], [], free, known_of)[0]

    assert said(known(0.0, 0.0)) == "Control reduces plate energy by 3.0 dB in the first impact."
    later = "Control reduces plate energy by 3.0 dB (first impact; later ones are not predictable)."
    assert said(known(0.0, 4e-5)) == later
    foreign = NotRepeatable(WhyNotRepeatable.NOT_HERE, error="it is foreign")
    assert "it is unknown whether later ones are predictable" in said(None, foreign)
    assert "plate energy by 3 dB (first" in said(known(1e-5, 4e-5))
    assert said(known(9e-5, 4e-5)).startswith("The effect of control is unpredictable")


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
