"""Peers that are linked to a role's session in vain: one side does not authorise the other.

Access control is silent: a denied peer links, and hears nothing. Here both sides say so.
"""

import json
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

import zenoh

from hertzloop.bus.zenoh_config import role_of

_SHOWS_S = 1.5  # in which a role that is linked shows itself, if it is not still starting


@dataclass(frozen=True)
class _Link:
    name: str  # in its certificate
    where: str
    role: str  # "" if it is none of this run
    since: float

    def __str__(self) -> str:
        return f"'{self.name}' ({self.where})" if self.name else self.where


def names_allowed(config: zenoh.Config) -> frozenset[str] | None:
    """Return the common names that the access control of a configuration allows; None if it allows
    everybody, or does not go by names."""
    if config.get_json("access_control/enabled") != "true":
        return None
    subjects = json.loads(config.get_json("access_control/subjects")) or []
    if not subjects or any(subject["cert_common_names"] is None for subject in subjects):
        return None
    return frozenset(name for subject in subjects for name in subject["cert_common_names"])


class AccessMonitor:
    """Watch the links of a role's session that a configuration `file` opened; tell `say`, once a
    name, which peers are linked in vain.

    A role that is authorised is seen to be starting, long before it is ready to take part.
    """

    def __init__(
        self,
        session: zenoh.Session,
        allowed: frozenset[str] | None,
        file: Path,
        run: str,
        role: str,
        say: Callable[[str], None],
    ) -> None:
        self._allowed, self._file, self._run, self._say = allowed, file, run, say
        self._links: dict[str, _Link] = {}
        self._said: dict[str, str] = {}
        self._starting: set[str] = set()
        starting, living = f"hertzloop/{run}/starting", session.liveliness()
        on_start = zenoh.handlers.Callback(self._on_start, indirect=False)
        self._kept = (
            session.info.declare_link_events_listener(
                zenoh.handlers.Callback(self._on_link, indirect=False), history=True
            ),
            living.declare_subscriber(f"{starting}/*", on_start, history=True),
            living.declare_token(f"{starting}/{role}"),
        )

    def _on_start(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._starting.add(str(sample.key_expr).rsplit("/", 1)[1])

    def _on_link(self, event: zenoh.LinkEvent) -> None:
        number = str(event.link.zid)
        if event.kind != zenoh.SampleKind.PUT:
            self._links.pop(number, None)
            return
        name, where = event.link.auth_identifier or "", str(event.link.dst)
        link = _Link(name, where, role_of(self._run, number), time.monotonic())
        self._links[number] = link
        if self._allowed is not None and link.name not in self._allowed:
            named = ", ".join(f"'{name}'" for name in sorted(self._allowed))
            self._tell(
                link,
                f"is connected, but not authorised: the access control of {self._file} names "
                f"{named}",
            )

    def _tell(self, link: _Link, what: str) -> None:
        if link.name not in self._said:
            self._said[link.name] = f"{link} {what}"
            self._say(self._said[link.name])

    def report(self, roles: Collection[str]) -> None:
        """Tell which peers have been linked for a while, and are one of these roles, or none."""
        for link in list(self._links.values()):
            if time.monotonic() - link.since < _SHOWS_S or link.role in self._starting:
                continue
            if link.role in roles:
                self._tell(
                    link,
                    f"is connected as the {link.role}, but sends nothing: its access control "
                    "rejects this side",
                )
            elif not link.role:
                self._tell(link, f"is connected, but is not a process of run '{self._run}'")

    def words(self) -> str:
        """All that was told, to end a sentence with; "" if nothing was."""
        return "".join(f"; {sentence}" for sentence in self._said.values())
