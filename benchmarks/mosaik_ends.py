"""An end of an exchange as a mosaik simulator."""

from typing import Any

import mosaik_api_v3

META = {
    "api_version": "3.0",
    "type": "time-based",
    "models": {"End": {"public": True, "params": [], "attrs": ["value"]}},
}


class End(mosaik_api_v3.Simulator):
    """Gives the value that it was given, at every step."""

    def __init__(self) -> None:
        super().__init__(META)
        self.value = 0.0

    def init(self, sid: str, time_resolution: float = 1.0, **_: Any) -> dict[str, Any]:
        """What it is."""
        return self.meta

    def create(self, num: int, model: str, **_: Any) -> list[dict[str, Any]]:
        """Its one entity."""
        return [{"eid": "end", "type": model}]

    def step(self, time: int, inputs: dict[str, Any], max_advance: int) -> int:
        """Take the other's value."""
        for given in inputs.get("end", {}).values():
            self.value = float(next(iter(given.values())))
        return time + 1

    def get_data(self, outputs: dict[str, list[str]]) -> dict[str, Any]:
        """Give it."""
        return {"end": {"value": self.value}}
