"""Whether the closed loop of a recording can be simulated again here."""

from hertzloop.recordings.recording import Recording
from hertzloop.results.recorded import law_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import parse

MOST_WORK = 2e9  # steps times frequencies of a run that is repeated only to judge a recording


def why_not_repeatable(recording: Recording, most_work: float = MOST_WORK) -> str:
    """Return why the closed loop of a recording cannot be simulated again here, in a clause; empty
    if it can."""
    if recording.balance is None:
        return "the run did not end"
    if not law_of(recording).as_announced:
        return "the forces may not come from the law of the scene"
    if recording.balance.frequencies * recording.truth.samples > most_work:
        return "it takes too long to simulate this run again"
    try:
        parse(recording.scene_toml)
    except (SceneError, RecursionError) as error:
        return f"the run cannot be simulated here: {error}"
    return ""
