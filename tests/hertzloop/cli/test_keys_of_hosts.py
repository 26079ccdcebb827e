"""The files that `node keys DIR --hosts` writes."""

import pytest

from hertzloop.bus.access_control import access_control
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, SUBSCRIPTIONS
from tests.commands import refused, succeed
from tests.hertzloop.scenes import json_in

HOSTS = "plant=[fd00::1],controller=lab.example:7500,recorder=[fd00::3]:7600"


@pytest.mark.full
def test_what_is_written(tmp_path):
    folder = tmp_path / "keys"
    told = succeed("node", "keys", folder, "--hosts", HOSTS)
    assert "lab.example: hertzloop node controller --zenoh-config controller.json5" in told
    configurations = {role: folder / f"{role}.json5" for role in SUBSCRIPTIONS}
    assert {file: file.stat().st_mode & 0o777 for file in folder.iterdir()} == dict.fromkeys(
        [*configurations.values(), folder / "authority.pem", folder / "authority.key"], 0o600
    )
    made = {role: json_in(file) for role, file in configurations.items()}
    at = ["tls/[fd00::1]:7450", "tls/lab.example:7500", "tls/[fd00::3]:7600"]
    for place, role in enumerate((PLANT, CONTROLLER, RECORDER)):
        assert made[role]["listen"]["endpoints"] == [at[place]]
        assert made[role]["connect"]["endpoints"] == at[:place]
        tls = made[role]["transport"]["link"]["tls"]
        for check in ("enable_mtls", "verify_name_on_connect", "close_link_on_expiration"):
            assert tls[check] is True
        assert made[role]["access_control"] == access_control(role)
    keys = {one["transport"]["link"]["tls"]["listen_private_key_base64"] for one in made.values()}
    assert len(keys) == 3
    refused(
        "the folder is not empty, and keys are never replaced",
        "node",
        "keys",
        folder,
        "--hosts",
        HOSTS,
    )


@pytest.mark.parametrize(
    ("hosts", "sentence"),
    [
        ("plant=10.0.0.1", "lacks the controller and the recorder"),
        (f"{HOSTS},viewer=h", "--hosts = 'viewer=h': invalid entry. Write ROLE=HOST"),
        (HOSTS.replace("7500", "70000"), "port '70000' for the controller"),
        (HOSTS.replace("[fd00::1]", "10.0.0.256"), "'10.0.0.256': invalid host for the plant"),
        ("plant=h:1,controller=h:1,recorder=h:2", "the same host and port"),
    ],
)
def test_hosts_that_cannot_be(hosts, sentence, tmp_path):
    refused(sentence, "node", "keys", tmp_path / "d", "--hosts", hosts)
    assert list(tmp_path.iterdir()) == []
