"""A run ends in words: whether control helped, in what, why not, and what spoils the figures."""

import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import pytest

from hertzloop.analysis.figures import Figures, Ran, Saturation
from hertzloop.analysis.meters import Push, Stability
from hertzloop.analysis.trust import Known, NotAgain, Obstacle, Predictability
from hertzloop.analysis.validity import Neglected
from hertzloop.analysis.verdict import saturation_of, verdict
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.recordings.intake import older_fact
from hertzloop.recordings.reader import Event
from hertzloop.views.sentences import verdict_sentences
from tests.commands import invoke


def run(folder: Path, *settings: str, scene: str = "aluminium-3mm") -> tuple[list[str], str]:
    words = [word for setting in settings for word in ("--set", setting)]
    done = invoke(
        ["run", scene, "--transport", "compiled", "--overwrite", "--out", str(folder / "a.mcap"),
         "--json", str(folder / "a.json"), *words],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = json.loads((folder / "a.json").read_text())["verdict"]
    assert all(sentence in done.output for sentence in said)
    return said, done.output


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "sentences"),
    [
        (["controller.v_thr_m_s=-0.6"], [
            "Control helps: plate energy -1.5 dB, radiated energy -3.6 dB, largest plate speed "
            "-0.9 dB; but the sphere rebounds 192 % as high."]),
        ([], [
            "Control does harm: plate energy +0.4 dB, radiated energy -1.2 dB; but the sphere "
            "rebounds 156 % as high.",
            "Why not: its first force comes 13 us after the touch, 45 % of the contact without"]),
        (["controller.latency_us=10"], [
            "Control does harm: plate energy +2.1 dB", "81 % of its push falls where nothing"]),
        (["contact.plasticity=thornton", "controller.v_thr_m_s=-0.6"], [
            "Control does harm: plate energy +0.8 dB",
            "a dent of 2.5 um, which a law that answers the gap takes for penetration"]),
        (["controller.v_thr_m_s=5"], ["Control did nothing: the law never pushed."]),
        (["controller.law=off"], []),
        (["controller.kappa=2", "controller.latency_us=2"], [
            "The loop pumps: the actuator puts in 2.5 times the energy that the sphere brought",
            "Control does harm", "Why not: "]),
        (["run.duration_s=0.0005"], ["No impact within the run."]),
        (["run.duration_s=0.00101", "controller.law=off"], ["The last contact is not over at the"]),
        (["sensors.bits=12", "sensors.full_scale=[-5e-6, 1e-5]"], [
            "Control helps", "The samples left the sensor's range once, first at 1.0"]),
    ],
)  # fmt: skip
def test_a_verdict(tmp_path: Path, settings: list[str], sentences: list[str]) -> None:
    said, output = run(tmp_path, "run.duration_s=0.0015", *settings)
    assert len(said) == len(sentences)
    for sentence, words in zip(said, sentences, strict=True):
        assert words in sentence
    if "controller.law=off" in settings:
        assert "ith control" not in output  # nothing to compare, no table and no word
    inspected = invoke(["inspect", str(tmp_path / "a.mcap")])
    for sentence in said:
        # What takes the run without control is not known to a recording.
        compared = sentence.startswith(("Control", "Why not"))
        assert (sentence in inspected.output) != compared


def test_a_contact_that_is_cut_off_is_not_called_a_short_one(tmp_path: Path) -> None:
    run(tmp_path, "run.duration_s=0.00101", "controller.law=off")
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["impacts"][0]["duration_s"] < 11e-6
    (energy,) = (f for f in data["validity"] if f["name"] == "plate theory (energy)")
    assert energy["state"] == "left out"  # of 9 us it would be out of range


def test_an_unstable_loop_is_all_there_is_to_say(tmp_path: Path) -> None:
    feedback = ("controller.law=velocity_feedback", "controller.kappa=0.4")
    said, _ = run(tmp_path, *feedback, "run.duration_s=0.02", scene="aluminium-20mm")
    assert said[0].startswith("UNSTABLE: the actuator answers what it causes itself")
    assert "ms on it has put in more" in said[0]
    assert not any(sentence.startswith("Control") for sentence in said)


def impact(plate_energy_j: float) -> Impact:
    return Impact(0.0, 30e-6, 1.0, 1.0, 100.0, plate_energy_j, 0.1)


def noise(radiated_j: float) -> ImpactNoise:
    known = {"radiated_j": radiated_j, "plate_speed_max_m_s": 0.1, "rebound_height_m": 0.01}
    return ImpactNoise(**{field.name: known.get(field.name, 1.0) for field in fields(ImpactNoise)})


STABLE = Stability(False, False, None, 0.0, 0.0, 0.0, 0.0)


def figures(impacts: Sequence[Impact], sounds: Sequence[ImpactNoise], push: Push) -> Figures:
    """Figures of a run of which no more is known than these."""
    return Figures(
        list(impacts), list(sounds), None, None, True, STABLE, None, push, Neglected(None)
    )


def said_of(
    impacts: Sequence[Impact], sounds: Sequence[ImpactNoise], free: Figures,
    known: Predictability | None = None, saturation: Saturation | None = None,
) -> list[str]:  # fmt: skip
    push = Push(1e-6, 0.0)
    ran = Ran(figures(impacts, sounds, push), "mine", 1e-3, -1e-6, saturation=saturation)
    return verdict_sentences(verdict(ran, free, known))


def test_the_words_follow_the_figures() -> None:
    free = figures([impact(1e-4)], [noise(1e-5)], Push(1e-6, 0.0))
    assert said_of([impact(1e-4)], [noise(1e-5)], free) == [
        "Control hardly changes the plate energy."
    ]
    assert said_of([impact(2e-4)], [noise(1e-6)], free) == [
        "Control does harm: plate energy +3.0 dB, radiated energy -10.0 dB."
    ]
    said = said_of(
        [impact(1e-4), impact(-0.9e-4)], [noise(1e-6)], free, saturation=Saturation(2, 1e-3)
    )
    assert said[0] == (
        "Control helps: plate energy -10.0 dB over all contacts, radiated energy -10.0 dB "
        "(first impact)."
    )
    assert "left the sensor's range 2 times, first at 1 ms" in said[1]


def test_what_is_not_predictable_is_not_added_up() -> None:
    free = figures([impact(1e-4), impact(1e-5)], [], Push(0.0, 0.0))

    def known(*errors_j: float) -> list[Known]:
        return [Known(1.0 if e == 0.0 else 1e3, {"plate_energy_j": e}, {}) for e in errors_j]

    def said(controlled: list[Known] | None, not_again: NotAgain | None = None) -> str:
        known_of = Predictability(1e-3, controlled, known(0.0, 0.0), not_again)
        return said_of([impact(5e-5), impact(9e-5)], [], free, known_of)[0]

    assert said(known(0.0, 0.0)) == "Control does harm: plate energy +1.0 dB over all contacts."
    later = "Control helps: plate energy -3.0 dB (first impact; later ones are not predictable)."
    assert said(known(0.0, 4e-5)) == later
    foreign = NotAgain(Obstacle.NOT_HERE, error="it is foreign")
    assert "whether later ones are predictable is not known" in said(None, foreign)
    assert "plate energy -3 dB (first" in said(known(1e-5, 4e-5))
    assert said(known(9e-5, 4e-5)).startswith("Whether control helps is not predictable")


LEFT, BACK = "left the converter's range", "is back in the converter's range"


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (["contact 1 began", "contact 1 ended"], None),
        ([f"xi {LEFT}", f"xi {BACK}", "contact 1 began", "contact 1 ended"], None),
        ([f"xi {LEFT}", "contact 1 began", "contact 1 ended", "contact 2 began"], (1, 2)),
        (["contact 1 began", f"xi {LEFT}", f"xi {BACK}", f"xi {LEFT}"], (2, 2)),
        (["contact 1 began", f"xi {LEFT}", "contact 1 ended", f"xi {BACK}", f"xi {LEFT}"], (1, 2)),
        ([f"v_p {LEFT}", "contact 1 began", "contact 1 ended", f"v_p {BACK}"], (1, 1)),
        (["contact 1 began", f"v_p {LEFT}", f"v_p {BACK}", f"v_p {LEFT}"], (2, 2)),
    ],
)
def test_a_gap_out_of_range_counts_while_it_matters(
    said: list[str], expected: tuple[int, int] | None
) -> None:
    """Once each time that it leaves, however many contacts pass until it is back."""
    facts = [older_fact("plant", sentence) for sentence in said]
    events = [Event(int(1e6 * ms), "plant", 3, "...", fact) for ms, fact in enumerate(facts, 1)]
    events.append(Event(0, "controller", 3, "...", older_fact("plant", f"v_p {LEFT}")))
    found = saturation_of(events)
    assert (found and (found.times, pytest.approx(found.since_s * 1e3))) == expected
