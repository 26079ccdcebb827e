"""Who may say and hear what on the bus: zenoh's access control, from the table of streams.

Everything is denied but what a rule allows: one a stream and direction, and the tokens by which
roles see each other. A role is known by the common name of its certificate, which zenoh compares
literally.
"""

from collections.abc import Mapping

from hertzloop.bus.sockets import mesh_endpoints
from hertzloop.bus.streams import ROLES, STREAMS, SUBSCRIPTIONS

_RUNS = "hertzloop/*"  # key of any run


def common_name(role: str) -> str:
    """Common name of the certificate of a role."""
    return f"hertzloop {role}"


def _rule(name: str, flow: str, messages: list[str], *keys: str) -> dict[str, object]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": [f"{_RUNS}/{key}" for key in keys],
    }


def _streams(role: str, other: str) -> list[dict[str, object]]:
    """What `role` lets out to `other`, and in from there: a rule a stream and direction.

    The wish to hear a stream travels the other way.
    """
    rules = []
    for name, stream in STREAMS.items():
        if stream.publisher == role and name in SUBSCRIPTIONS[other]:
            rules += [
                _rule(f"{name} to {other}", "egress", ["put"], name),
                _rule(f"{name} asked for by {other}", "ingress", ["declare_subscriber"], name),
            ]
        if stream.publisher == other and name in SUBSCRIPTIONS[role]:
            rules += [
                _rule(f"{name} from {other}", "ingress", ["put"], name),
                _rule(f"{name} asked of {other}", "egress", ["declare_subscriber"], name),
            ]
    return rules


def _presence(role: str, other: str) -> list[dict[str, object]]:
    """Each role holds tokens of its own only, and may look for all."""
    asks = ["declare_liveliness_subscriber"]
    return [
        _rule(f"tokens to {other}", "egress", ["liveliness_token"], *_tokens(role)),
        _rule(f"tokens of {other}", "ingress", ["liveliness_token"], *_tokens(other)),
        _rule(f"tokens asked of {other}", "egress", asks, *_tokens("*")),
        _rule(f"tokens asked for by {other}", "ingress", asks, *_tokens("*")),
    ]


def _tokens(role: str) -> tuple[str, ...]:
    return f"alive/{role}/*", f"complete/{role}"


def access_control(role: str) -> dict[str, object]:
    """Value of `access_control` in the zenoh configuration of a role."""
    others = [other for other in ROLES if other != role]
    rules = {other: _streams(role, other) + _presence(role, other) for other in others}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for one in rules.values() for rule in one],
        "subjects": [{"id": other, "cert_common_names": [common_name(other)]} for other in others],
        "policies": [
            {"subjects": [other], "rules": [rule["id"] for rule in rules[other]]}
            for other in others
        ],
    }


def secured(
    role: str, endpoints: Mapping[str, str], certificate: str, key: str, authority: str
) -> dict[str, object]:
    """A zenoh configuration of `role`: where it listens and connects of all `endpoints` (zenoh's
    `tls/host:port`, by role), mutual TLS, access control.

    `certificate`, its private `key` and that of the `authority` are PEM texts in base64, so that
    the one file is all that a host needs.
    """
    listen, connect = mesh_endpoints(role, [endpoints[one] for one in ROLES])
    return {
        "mode": "peer",
        "listen": {"endpoints": listen},
        "connect": {"endpoints": connect},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": True,
                    "root_ca_certificate_base64": authority,
                    "listen_certificate_base64": certificate,
                    "listen_private_key_base64": key,
                    "connect_certificate_base64": certificate,
                    "connect_private_key_base64": key,
                },
            }
        },
        "access_control": access_control(role),
    }
