"""The files that `node keys DIR --hosts` writes."""

import json
from pathlib import Path

import pytest

from hertzloop.bus import streams
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, STREAMS, SUBSCRIPTIONS, Stream
from hertzloop.bus.zenoh_config import access_control
from hertzloop.cli.host_keys import _address
from tests.commands import invoke
from tests.hertzloop.processes import hertzloop

HOSTS = "plant=10.0.0.1,controller=lab.example:7500,recorder=[fd00::3]:7600"


@pytest.mark.full
def test_what_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    done = hertzloop("node", "keys", str(folder), "--hosts", HOSTS)
    assert done.returncode == 0, done.stderr
    assert "lab.example: hertzloop node controller --zenoh-config controller.json5" in done.stdout
    assert {file.name: file.stat().st_mode & 0o777 for file in folder.iterdir()} == {
        name: 0o600
        for name in (
            "plant.json5", "controller.json5", "recorder.json5", "authority.pem", "authority.key",
        )
    }  # fmt: skip
    made = {role: json.loads((folder / f"{role}.json5").read_text()) for role in SUBSCRIPTIONS}
    at = ["tls/10.0.0.1:7450", "tls/lab.example:7500", "tls/[fd00::3]:7600"]
    for place, role in enumerate((PLANT, CONTROLLER, RECORDER)):
        assert made[role]["listen"]["endpoints"] == [at[place]]
        assert made[role]["connect"]["endpoints"] == at[:place]
        tls = made[role]["transport"]["link"]["tls"]
        for check in ("enable_mtls", "verify_name_on_connect", "close_link_on_expiration"):
            assert tls[check] is True
        assert made[role]["access_control"] == access_control(role)
    keys = {one["transport"]["link"]["tls"]["listen_private_key_base64"] for one in made.values()}
    assert len(keys) == 3


@pytest.mark.full
def test_keys_are_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("kept")
    done = hertzloop("node", "keys", str(tmp_path), "--hosts", HOSTS)
    assert (done.returncode, [file.name for file in tmp_path.iterdir()]) == (2, ["mine"])
    assert "the folder is not empty, and keys are never replaced" in done.stderr


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["d", "--hosts", "plant=10.0.0.1"], "lacks the controller and the recorder"),
        (["d", "--hosts", f"{HOSTS},plant=10.0.0.9"], "the plant is given twice"),
        (
            ["d", "--hosts", f"{HOSTS},viewer=10.0.0.9"],
            "--hosts = 'viewer=10.0.0.9': invalid entry. Write ROLE=HOST",
        ),
        (["d", "--hosts", HOSTS.replace("7500", "0")], "port '0' for the controller"),
        (["d", "--hosts", HOSTS.replace("7500", "70000")], "port '70000' for the controller"),
        (
            ["d", "--hosts", HOSTS.replace("10.0.0.1", "10.0.0.256")],
            "'10.0.0.256': invalid host for the plant",
        ),
        (["d", "--hosts", HOSTS.replace("10.0.0.1", "a b")], "'a b': invalid host for the plant"),
        (["d", "--hosts", "plant=h:1,controller=h:1,recorder=h:2"], "the same host and port"),
        (["--hosts", HOSTS], "Missing argument"),
        (["d", "--hosts", HOSTS, "--days", "0"], "days"),
    ],
)
def test_hosts_that_cannot_be(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke(["node", "keys", *words])
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, []), done.output
    assert sentence in " ".join(done.output.split())


def allowed(role: str) -> set[tuple[str, str, str, str]]:
    """(other role, flow, message, key) of every rule."""
    control = access_control(role)
    rules = {rule["id"]: rule for rule in control["rules"]}
    return {
        (other, flow, message, key.removeprefix("hertzloop/*/"))
        for policy in control["policies"]
        for other in policy["subjects"]
        for rule in (rules[name] for name in policy["rules"])
        for flow in rule["flows"]
        for message in rule["messages"]
        for key in rule["key_exprs"]
    }


@pytest.mark.parametrize("role", SUBSCRIPTIONS)
def test_a_rule_a_stream_and_direction(role: str) -> None:
    assert access_control(role)["default_permission"] == "deny"
    puts = {rule[:2] + rule[3:] for rule in allowed(role) if rule[2] == "put"}
    out = {
        (other, "egress", name)
        for name, stream in STREAMS.items()
        for other, heard in SUBSCRIPTIONS.items()
        if stream.publisher == role and name in heard
    }
    into = {
        (STREAMS[name].publisher, "ingress", name)
        for name in SUBSCRIPTIONS[role]
        if STREAMS[name].publisher != role
    }
    assert puts == out | into
    tokens = {
        (rule[1], rule[0] if rule[1] == "ingress" else role, rule[3])
        for rule in allowed(role)
        if rule[2] == "liveliness_token"
    }
    assert {whose for _, whose, key in tokens} == {*SUBSCRIPTIONS}
    assert all(key.split("/")[1] == whose for _, whose, key in tokens)


def test_a_new_stream_needs_no_second_place(monkeypatch: pytest.MonkeyPatch) -> None:
    new = Stream("new", PLANT, STREAMS["daq"].message, "/new")
    monkeypatch.setitem(streams.STREAMS, "new", new)
    monkeypatch.setitem(streams.SUBSCRIPTIONS, RECORDER, (*SUBSCRIPTIONS[RECORDER], "new"))
    assert (RECORDER, "egress", "put", "new") in allowed(PLANT)
    assert (PLANT, "ingress", "put", "new") in allowed(RECORDER)
    assert not [rule for rule in allowed(CONTROLLER) if rule[3] == "new"]


def test_an_address_in_brackets_needs_no_port() -> None:
    assert _address("plant", "[::1]", 7450) == _address("plant", "::1", 7450) == ("::1", 7450)
    assert _address("plant", "[::1]:7500", 7450) == ("::1", 7500)
