"""Who is let in, as a configuration says it."""

import json

import zenoh

from hertzloop.bus.access_control import access_control
from hertzloop.bus.access_monitor import names_allowed
from hertzloop.bus.streams import PLANT


def test_names_count_where_access_control_is_on_and_goes_by_them():
    config = zenoh.Config()
    assert names_allowed(config) is None
    config.insert_json5("access_control", json.dumps(access_control(PLANT)))
    assert names_allowed(config) == {"hertzloop controller", "hertzloop recorder"}
    anybody = [{"id": "anybody", "interfaces": ["lo"]}]
    config.insert_json5("access_control/subjects", json.dumps(anybody))
    assert names_allowed(config) is None
    config.insert_json5("access_control", json.dumps(access_control(PLANT) | {"enabled": False}))
    assert names_allowed(config) is None
