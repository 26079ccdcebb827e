"""What the figures of a run come to: predictable digits, the law's accuracy, the verdict."""

from typing import Any

from hertzloop.results import law_accuracy
from hertzloop.results.law import law_line, law_of, ran_as_announced
from hertzloop.results.predictability import DISTURBANCE, as_dicts, known_impacts
from hertzloop.results.verdict import verdict
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup, parse
from recordings.reader import Recording

_MOST_WORK = 2e9  # steps times frequencies of a run that is repeated only to judge a recording


def conclusions(
    setup: Setup,
    report: dict[str, Any],
    saturation: dict[str, Any] | None,
    why_not: str = "",
) -> dict[str, Any]:
    """`predictability`, `law_accuracy` and `verdict` of a run.

    Args:
        scene: The scene of the run, whose closed loop is simulated again.
        report: Its figures, as in `figures.of_recording`.
        saturation: As in `verdict.saturation_of`.
        why_not: Why the closed loop cannot be simulated again, where that is so.
    """
    late = report["pacing"] is not None  # then not the law alone decides
    known = predictability(setup, report, late, why_not)
    judged = None if late or why_not else _judge_law(setup, report)
    said = verdict(report | {"predictability": known}, saturation)
    if judged and not judged.kept:
        said.append(judged.sentence)
    return {
        "predictability": known, "law_accuracy": law_accuracy.as_json(judged), "verdict": said
    }  # fmt: skip


def predictability(
    setup: Setup, report: dict[str, Any], late: bool = False, why_not: str = ""
) -> dict[str, Any]:
    """How well the impacts of a run, and of that without control, can be known; `late`: its forces
    were, so that it is judged by the same in lock-step. Nothing is said of an unstable loop."""
    error, without = report["expected_error"], setup.uncontrolled()

    def known(of: Setup, figures: dict[str, Any], in_lock_step: bool = True) -> Any:
        found = known_impacts(of, figures["impacts"], error, in_lock_step, figures["noise"])
        return as_dicts(found)

    own = other = None
    if not why_not and not report["stability"]["unstable"]:
        try:
            own = known(setup, report, not late)
        except SceneError as stopped:  # the law, in the disturbed run
            why_not = str(stopped)
    if without == setup:
        other = own
    elif error is not None and "uncontrolled" in report:
        other = known(without, report["uncontrolled"])
    found: dict[str, Any] = {"disturbance": DISTURBANCE, "model_error": error}
    return found | {"controlled": own, "uncontrolled": other, "why_not": why_not}


def why_not_again(recording: Recording) -> str:
    """Why the closed loop of a recording cannot be simulated again here, in words that follow
    "since"; empty where it can."""
    if recording.books is None:
        return "the run did not end"
    ran = law_of(recording)
    if not ran_as_announced(ran):
        return f"the forces are not known to be those of the scene's law: {law_line(ran)}"
    if recording.books.frequencies * recording.truth.samples > _MOST_WORK:
        return "it takes too long to simulate this run again"
    try:
        parse(recording.scene_toml)
    except (SceneError, RecursionError) as error:
        return f"the run cannot be simulated here: {error}"
    return ""


def _judge_law(setup: Setup, report: dict[str, Any]) -> law_accuracy.LawAccuracy | None:
    """Whether the accuracy asked for is kept under the law."""
    if not report["impacts"] or report["stability"]["unstable"]:
        return None
    first = report["impacts"][0]
    return law_accuracy.judged(setup, first["start_s"] + 2.0 * first["duration_s"])
