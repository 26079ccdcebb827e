"""Who is let in, as a configuration says it; how it is told: tests/hertzloop/test_hosts.py."""

import json
from types import SimpleNamespace

import zenoh

from hertzloop.bus.access_monitor import AccessMonitor, names_allowed
from hertzloop.bus.streams import PLANT
from hertzloop.bus.zenoh_config import access_control


def test_names_count_where_access_control_is_on_and_goes_by_them() -> None:
    config = zenoh.Config()
    assert names_allowed(config) is None
    config.insert_json5("access_control", json.dumps(access_control(PLANT)))
    assert names_allowed(config) == {"hertzloop controller", "hertzloop recorder"}
    anybody = [{"id": "anybody", "interfaces": ["lo"]}]
    config.insert_json5("access_control/subjects", json.dumps(anybody))
    assert names_allowed(config) is None
    config.insert_json5("access_control", json.dumps(access_control(PLANT) | {"enabled": False}))
    assert names_allowed(config) is None


def test_a_role_that_is_starting_is_known_by_its_name() -> None:
    watcher = object.__new__(AccessMonitor)
    watcher._starting = set()
    key = "hertzloop/run-1/starting/controller"
    watcher._on_start(SimpleNamespace(kind=zenoh.SampleKind.PUT, key_expr=key))
    watcher._on_start(SimpleNamespace(kind=zenoh.SampleKind.DELETE, key_expr=f"{key}-2"))
    assert watcher._starting == {"controller"}
