"""How to get the samples of a recording again, in words and as commands."""

import shlex

from hertzloop.common.readable import argument
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.recordings.recording import Recording
from hertzloop.results.recorded import law_of
from hertzloop.scene.setup import Setup
from hertzloop.views import provenance


def repetition(recording: Recording, setup: Setup, has_text: bool) -> tuple[str, list[str]]:
    """Return a sentence and the commands that give the same samples again."""
    file, result = shlex.quote(argument(recording.path.name)), law_of(recording)
    (name, changed), saved = provenance.closest_shipped(setup), "# the scene below, saved"
    again = shlex.quote(argument(f"{recording.path.stem}-again.mcap"))
    if not result.as_announced:
        own = result.law or "not named by the controller"
        return (
            f"The forces came from a controller outside hertzloop with the law {own}. Start that "
            "controller and these two processes in three terminals, in any order.",
            [
                f"hertzloop node recorder --out {again}",
                f"hertzloop node plant {setup.name}.toml    {saved}",
                f"hertzloop compare {again} {file}    # afterwards",
            ],
        )
    if "held_steps" in recording.truth.arrays:
        return (
            "Some forces arrived late in this run. The repetition applies them with the same "
            "delay.",
            [f"hertzloop run --repeat {file} --out {again}", f"hertzloop compare {again} {file}"],
        )
    same = "The same scene, seed and processor give the same bytes."
    if name == setup.name and not changed:
        return same, [f"hertzloop run {name} --seed {setup.seed}"]
    run, first = f"hertzloop run {setup.name}.toml", []
    if result.law not in shipped_laws() and has_text:
        law = str(result.law).partition(":")
        first = [f"hertzloop inspect {file} --law {shlex.quote(law[0])}"]
        run += f" --set {shlex.quote('controller.law=' + ''.join(law))}"
    return same, [*first, f"{run} --out {again}    {saved}", f"hertzloop compare {again} {file}"]
