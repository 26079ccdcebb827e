"""Scripts played against a controller process: started for each anew, or running already."""

import shlex
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bus.own_folder import own_folder
from bus.port import BusError, PeerLost
from bus.streams import CONTROLLER, PLANT, RECORDER
from bus.zenoh_port import ZenohPort
from hertzloop.loop.conformance import Broken, Checks, Listener, ScriptedPlant
from hertzloop.loop.conformance_scripts import Script
from hertzloop.loop.processes import default_endpoints

_LATE_S = 0.3  # that the recorder comes after the first samples, or the plant's end after it left
_LEAVES_S = 5.0  # at most, after a run; longer where an answer may take longer


@dataclass(frozen=True)
class Meeting:
    """Where the controller is met: the run's name, three ports on loopback (plant, controller,
    recorder), the longest waits (s) for an answer and for the controller to appear."""

    name: str
    ports: Sequence[int]
    timeout_s: float
    wait_s: float

    @property
    def leaves_s(self) -> float:
        """Longest time (s) for the controller to leave."""
        return max(_LEAVES_S, self.timeout_s)

    def open(self, role: str) -> ZenohPort:
        """Join the bus. Raises BusError."""
        listen, connect = default_endpoints(role, self.ports)
        return ZenohPort(role, self.name, listen, connect, patience_s=self.timeout_s)

    def command(self, words: str) -> list[str]:
        """The controller's command line, with {name}, {listen} and {connect} filled in."""
        [listen], [connect] = default_endpoints(CONTROLLER, self.ports)
        filled = {"{name}": self.name, "{listen}": listen, "{connect}": connect}
        found = shlex.split(words)
        for place, value in filled.items():
            found = [word.replace(place, value) for word in found]
        return found


class _Process:
    """The controller's process, if it is ours to start; ended whatever happens."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self._stderr = folder / "stderr"
        with self._stderr.open("w") as sink:
            self._process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=sink
            )

    def code(self, timeout_s: float) -> int | None:
        """Its exit code; None while it runs on."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def last_words(self) -> str:
        """How it ended, for a sentence; "" while it runs."""
        code = self.code(1.0)
        if code is None:
            return ""
        return f" (its process ended with exit code {code}{self.said() or ': nothing said'})"

    def said(self) -> str:
        """The last line of its stderr, for a sentence; "" if there is none."""
        lines = self._stderr.read_text(errors="replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    def end(self) -> None:
        """Terminate, then kill."""
        if self._process.poll() is None:
            self._process.terminate()
            if self.code(2.0) is None:
                self._process.kill()
                self._process.wait()


@contextmanager
def _started(words: list[str]) -> Iterator[_Process | None]:
    """The process of a command line, or none without one. Raises OSError."""
    if not words:
        yield None
        return
    with own_folder() as folder:
        process = _Process(words, Path(folder))
        try:
            yield process
        finally:
            process.end()


def play(
    script: Script, horizon: int | None, meeting: Meeting, start: str, checks: Checks
) -> ScriptedPlant:
    """One run. `start`: the controller's command line, "" if it runs already.

    Raises Broken with the first thing that is wrong, OSError if the command line cannot be
    started.
    """
    with _started(meeting.command(start)) as process:
        return _play(script, horizon, meeting, process, checks)


def _play(
    script: Script,
    horizon: int | None,
    meeting: Meeting,
    process: _Process | None,
    checks: Checks,
) -> ScriptedPlant:
    ports = {PLANT: meeting.open(PLANT)}
    try:
        plant = ScriptedPlant(script, ports[PLANT], horizon, meeting.timeout_s, checks)

        def recorder_comes() -> None:
            if RECORDER in ports:
                return
            time.sleep(_LATE_S)
            ports[RECORDER] = meeting.open(RECORDER)
            ports[RECORDER].announce()

        if not script.late_recorder:
            recorder_comes()
        ports[PLANT].announce()
        awaited = [CONTROLLER] if script.late_recorder else [CONTROLLER, RECORDER]
        _await(ports[PLANT], awaited, meeting.wait_s, process)
        strangers = ports[PLANT].strangers()
        checks.that(
            not strangers,
            f"the controller's zenoh id {' '.join(strangers)} is none that a controller of run "
            f"'{meeting.name}' takes: samples that it does not take in time would be dropped",
        )
        plant.play(recorder_comes)
        if script.ending == "fault":
            plant.give_up()
        if script.ending != "death":
            Listener(ports[RECORDER], meeting.timeout_s, checks).hear(plant)
        _leave(script, plant, ports, meeting.leaves_s, process, checks)
        return plant
    except BusError as error:  # it is gone, or silent: before we go, too, it may say why
        raise Broken(f"{error}{process.last_words() if process else ''}") from error
    finally:
        for port in ports.values():
            port.close()


def _await(port: ZenohPort, roles: list[str], wait_s: float, process: _Process | None) -> None:
    """Wait for the others, as long as the controller's process lives. Raises BusError."""
    deadline = time.monotonic() + wait_s
    while True:
        try:
            return port.wait_for(roles, 0.2)
        except PeerLost:
            if process and process.code(0.0) is not None:
                raise Broken(f"the controller never came{process.last_words()}") from None
            if time.monotonic() > deadline:
                raise Broken(
                    f"no controller came on bus '{port.name}' within {wait_s:g} s"
                ) from None


def _leave(
    script: Script,
    plant: ScriptedPlant,
    ports: dict[str, ZenohPort],
    within_s: float,
    process: _Process | None,
    checks: Checks,
) -> None:
    """The plant ends, or is suddenly gone; the controller has to go as well."""
    dies = script.ending == "death"
    if not (dies or script.late_end):
        plant.publisher.end()  # once: after a fault it was said already
    if script.ending == "whole":
        ports[RECORDER].vouch()
    # Whoever is left sees the controller go: the recorder after a death, else the plant.
    ports.pop(PLANT if dies else RECORDER).close()
    if script.late_end:
        time.sleep(_LATE_S)
        plant.publisher.end()
    observer = ports[RECORDER if dies else PLANT]
    why = "the plant has died" if dies else "the run has ended and the recorder left"
    checks.that(
        observer.wait_until_gone(CONTROLLER, within_s),
        f"the controller is still there {within_s:g} s after {why}",
    )
    if process:
        code = process.code(within_s)
        checks.that(code is not None, f"the controller's process runs on after {why}")
        checks.that(
            code == 0 or script.ending != "whole",
            lambda: (
                f"the controller's process ended with exit code {code} after a run without fault"
                f"{process.said()}"
            ),
        )
