"""Which law a run used, in words."""

from hertzloop.controller.loading.registry import shipped
from hertzloop.results.recorded import RecordedLaw

_LONGEST = 200  # characters that are shown of a controller's own words


def law_line(data: RecordedLaw, digests: bool = True) -> str:
    """Name the law that the forces of a recording come from; without `digests`, one that the scene
    does not name still has its digest."""
    if data.as_announced and not digests:
        return law_words(data.law, None)
    used, announced = law_words(data.law, data.law_digest), data.scene_law
    if data.as_announced or (used and data.law == announced and data.law_digest is None):
        return used
    law = used or "not reported by the controller"
    scene = law_words(announced, data.scene_law_digest)
    return f"{law} (the scene says {scene})" if announced else law


def law_words(name: str | None, digest: str | None) -> str:
    """Return a law's name, shortened to fit, and the digest of its files if it is not shipped."""
    words = "".join(c for c in " ".join((name or "").split()) if c.isprintable())[:_LONGEST]
    own = name is not None and name not in shipped()
    return f"{words}, digest {digest[:_LONGEST]}" if digest and own else words
