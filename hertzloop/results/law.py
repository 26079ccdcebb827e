"""Which law a recording's forces come from: as its controller said, and as its scene says."""

from typing import Any

from controller.loading.registry import shipped
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import parse
from recordings.reader import Recording
from recordings.writer import RecordingError

_LONGEST = 200  # characters that are shown of what a controller says


def law_of(recording: Recording) -> dict[str, Any]:
    """`law`, `law_digest`: what the controller said that it ran, None if it did not say;
    `scene_law`, `scene_law_digest`: what was announced, None where that is not known."""
    ran, digest = recording.law_ran
    announced = recording.metadata.get("law") or _law_of_scene(recording)
    return {
        "law": ran or None,
        "law_digest": digest or None,
        "scene_law": announced,
        "scene_law_digest": recording.metadata.get("law_digest") or None,
    }


def _law_of_scene(recording: Recording) -> str | None:
    """Of recordings that do not say more."""
    try:
        return parse(recording.scene_toml, recorded=True).law_reference
    except (SceneError, RecursionError):
        return None


def text_of_law(recording: Recording) -> str:
    """Text of the law that ran. Raises RecordingError where the recording does not hold it."""
    ran = law_of(recording)
    if not recording.law_source:
        raise RecordingError(
            f"the recording holds no text of its law, {law_line(ran)}: a compiled law has none"
        )
    if ran["law"] and not ran_as_announced(ran):
        raise RecordingError(
            f"the recording holds no text of the law that ran, {_shown(ran['law'], None)}: its "
            "controller is another program. The law of the scene did not run: "
            f"{_shown(ran['scene_law'], None)}"
        )
    return recording.law_source


def ran_as_announced(data: dict[str, Any]) -> bool:
    """Whether the controller said that it ran the scene's law, file for file."""
    return bool(data["law"]) and (data["law"], data["law_digest"]) == (
        data["scene_law"], data["scene_law_digest"]
    )  # fmt: skip


def law_line(data: dict[str, Any]) -> str:
    """The same in words."""
    ran, announced = _shown(data["law"], data["law_digest"]), data["scene_law"]
    if ran and data["law"] == announced and data["law_digest"] in (None, data["scene_law_digest"]):
        return ran
    said = ran or "not said by the controller"
    return (
        f"{said} (the scene says {_shown(announced, data['scene_law_digest'])})"
        if announced
        else said
    )


def _shown(name: str | None, digest: str | None) -> str:
    """A law's name, with no more of it than fits, and what its files are."""
    words = "".join(c for c in " ".join((name or "").split()) if c.isprintable())[:_LONGEST]
    own = name is not None and name not in shipped()
    return f"{words}, digest {digest[:_LONGEST]}" if digest and own else words
