"""A run ends in words: whether control helped, in what, why not, and what spoils the metrics."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import pytest

import hertzloop
from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.recordings.recording import Event, EventData
from hertzloop.results.effects import Neglected
from hertzloop.results.metrics import Metrics, RunResult, Saturation
from hertzloop.results.predictability import NOTHING_KNOWN, ImpactErrors, Predictability
from hertzloop.results.recorded_result import saturation_of
from hertzloop.results.repeatability import NotRepeatable, WhyNotRepeatable
from hertzloop.results.span_metrics import span_metrics
from hertzloop.results.stability import Stability
from hertzloop.results.statistics import ForceTiming
from hertzloop.results.touch_phases import SAME_PHASE, OtherPhases
from hertzloop.results.verdict import verdict
from hertzloop.scene.toml import to_toml
from hertzloop.views.verdict import verdict_sentences
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


def noise(radiated_j: float, height_m: float = 0.01) -> ImpactNoise:
    known = {"radiated_j": radiated_j, "plate_speed_max_m_s": 0.1, "rebound_height_m": height_m}
    return ImpactNoise(**{field.name: known.get(field.name, 1.0) for field in fields(ImpactNoise)})


STABLE = Stability(False, False, None, 0.0, 0.0, 0.0, 0.0)


def metrics(
    energies_j: Sequence[float], radiated_j: float = 1e-5, height_m: float = 0.01
) -> Metrics:
    """Metrics of a run of which no more is known than these: the plate's energy by impact."""
    impacts, sound = [impact(one) for one in energies_j], noise(radiated_j, height_m)
    first, whole = (
        replace(span_metrics(count, 100.0, sound), plate_energy_j=energy)
        for count, energy in ((1, energies_j[0]), (len(impacts), sum(energies_j)))
    )
    sounds = [sound] * len(impacts)
    push = ForceTiming(1e-6, 0.0)
    return Metrics(impacts, sounds, first, whole, True, STABLE, None, push, Neglected(None))


def said_of(
    own: Metrics,
    free: Metrics,
    known: Predictability = NOTHING_KNOWN,
    saturation: Saturation | None = None,
    phases: OtherPhases = SAME_PHASE,
) -> list[str]:
    result = RunResult(own, "mine", 1e-3, -1e-6, saturation=saturation)
    return verdict_sentences(verdict(result, free, known, None, phases))


def test_the_words_follow_the_metrics():
    free = metrics([1e-4])
    assert said_of(metrics([1e-4]), free) == [
        "Control leaves plate energy nearly unchanged in the first impact."
    ]
    assert said_of(metrics([2e-4], 1e-6), free) == [
        "Control increases plate energy by 3.0 dB in the first impact.",
        "Better (first impact): radiated energy to 20 kHz -10.0 dB.",
    ]
    said = said_of(metrics([1e-4, -0.9e-4], 1e-6), free, saturation=Saturation(2, 1e-3))
    assert said[:3] == [
        "Control leaves plate energy nearly unchanged in the first impact.",
        "Over all contacts the change is -10.0 dB, with 2 contacts instead of 1.",
        "Better (first impact): radiated energy to 20 kHz -10.0 dB.",
    ]
    assert any("saturated 2 times, first at 1 ms" in one for one in said)


def test_the_largest_change_comes_first_and_a_base_of_zero_is_the_largest():
    """Metrics that get worse are named, also where they were zero."""
    own, free = metrics([5e-5], 1e-6, 1.57e-3), metrics([1e-4], 1e-5, 0.0)
    assert said_of(own, free)[1:] == [
        "Worse (first impact): rebound height 1.57 mm instead of 0 mm.",
        "Better (first impact): radiated energy to 20 kHz -10.0 dB.",
    ]
    assert said_of(metrics([5e-5], 1e-6, 0.02), free=metrics([1e-4]))[1:] == [
        "Better (first impact): radiated energy to 20 kHz -10.0 dB.",
        "Worse (first impact): rebound height +100 %.",
    ]


def test_a_number_is_as_wide_as_the_touch_phase_makes_it():
    own, free = metrics([5e-5, 5e-5]), metrics([1e-4, 1e-4])

    def said(first_j: float, whole_j: float, contacts: int) -> list[str]:
        other = OtherPhases(
            ({**vars(own.noise[0]), **vars(own.first_impact), "plate_energy_j": first_j},),
            ({**vars(own.whole_run), "plate_energy_j": whole_j, "contacts": contacts},),
        )
        known = Predictability(1e-3, None, None)
        return said_of(own, free, known, phases=other)[:2]

    assert said(6e-5, 1.9e-4, 3) == [
        "Control reduces plate energy by 2.2 to 3.0 dB in the first impact.",
        "Over all contacts the change is -3.0 to -0.2 dB, with 2 to 3 contacts instead of 2.",
    ]
    assert (
        said(1e-4, 1e-4, 2)[0]
        == "Control reduces plate energy by at most 3.0 dB in the first impact."
    )
    changes = "Control changes plate energy by -3.0 to +3.0 dB in the first impact."
    assert said(2e-4, 1e-4, 2)[0] == changes


def test_what_is_not_predictable_is_not_added_up():
    own, free = metrics([5e-5, 9e-5]), metrics([1e-4, 1e-5])

    def known(*errors_j: float) -> list[ImpactErrors]:
        return [
            ImpactErrors(
                1.0 if e == 0.0 else 1e3, {"plate_energy_j": e, "peak_force_n": 2e6 * e}, {}
            )
            for e in errors_j
        ]

    def said(controlled: list[ImpactErrors] | None, not_again: NotRepeatable | None = None) -> str:
        known_of = Predictability(1e-3, controlled, known(0.0, 0.0), not_again)
        return " ".join(said_of(own, free, known_of)[:2])

    first = "Control reduces plate energy by 3.0 dB in the first impact."
    assert said(known(0.0, 0.0)).startswith(f"{first} Over all contacts the change is +1.0 dB")
    assert said(known(0.0, 6e-5)).startswith(f"{first} Later impacts are not predictable.")
    foreign = NotRepeatable(WhyNotRepeatable.NOT_HERE, error="it is foreign")
    assert "It is unknown whether later impacts are predictable." in said(None, foreign)
    assert "plate energy by 3 dB in" in said(known(1e-5, 6e-5))
    assert said(known(9e-5, 6e-5)).startswith("The effect of control is unpredictable")


def test_a_result_out_of_range_says_so_before_its_number(tmp_path):
    """First in the output of run and inspect, in their JSON and in Python."""
    thin = ["plate.thickness_m=0.001", "run.duration_s=0.006", "run.accuracy=0.05"]
    said, output = run(tmp_path, *thin, scene="aluminium-20mm")
    words = "OUT OF RANGE: deflection is"
    assert said[0].startswith(words)
    assert output.startswith(words)
    assert output.count("OUT OF RANGE") == 1
    assert "Error of the truncated modes " in output
    inspected = invoke(["inspect", str(tmp_path / "a.mcap"), "--json", str(tmp_path / "i.json")])
    assert inspected.output.startswith(words)
    for name in ("a.json", "i.json"):
        _, (key, sentences), *_ = json_in(tmp_path / name).items()  # first is the version
        assert (key, sentences) == ("out_of_range", said[:1])
    assert hertzloop.read(tmp_path / "a.mcap").verdict == said


def test_a_metric_without_a_value_and_an_unknown_effect_have_a_reason(tmp_path):
    own = "material = { young_pa = 7e10, density_kg_m3 = 2700, poisson = 0.33, loss_factor = 1e-3 }"
    scene = to_toml(aluminium_3mm().scene).replace('material = "aluminium"', own)
    assert own in scene
    (tmp_path / "own.toml").write_text(scene)
    _, output = run(tmp_path, "run.duration_s=0.0013", scene=str(tmp_path / "own.toml"))
    sentence = "Unknown: when the plate yields is not known: give plate.material.yield_pa"
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
