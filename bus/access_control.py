"""Who may say and hear what on the bus: zenoh's access control, from the table of streams.

Everything is denied but what a rule allows. A role is known by the common name of its certificate,
which zenoh compares literally.
"""

from collections.abc import Mapping

from hertzloop.bus.sockets import mesh_endpoints
from hertzloop.bus.streams import ROLES, STREAMS, SUBSCRIPTIONS

_RUNS = "hertzloop/*"  # key of any run


def common_name(role: str) -> str:
    """Common name of the certificate of a role."""
    return f"hertzloop {role}"


def _rules(role: str, other: str) -> list[dict[str, object]]:
    """What `role` lets out to `other`, and in from there.

    The wish to hear a stream travels against it. Each role holds tokens of its own only, and may
    look for all.
    """
    said, heard = _streams(role, other), _streams(other, role)
    asks, all_tokens = "declare_liveliness_subscriber", _tokens("*")
    rules: list[tuple[str, str, str, list[str]]] = [
        (f"streams to {other}", "egress", "put", said),
        (f"streams asked for by {other}", "ingress", "declare_subscriber", said),
        (f"streams from {other}", "ingress", "put", heard),
        (f"streams asked of {other}", "egress", "declare_subscriber", heard),
        (f"tokens to {other}", "egress", "liveliness_token", _tokens(role)),
        (f"tokens asked for by {other}", "ingress", asks, all_tokens),
        (f"tokens of {other}", "ingress", "liveliness_token", _tokens(other)),
        (f"tokens asked of {other}", "egress", asks, all_tokens),
    ]
    return [
        {
            "id": name,
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": [f"{_RUNS}/{key}" for key in keys],
        }
        for name, flow, message, keys in rules
        if keys
    ]


def _streams(publisher: str, subscriber: str) -> list[str]:
    return [name for name in SUBSCRIPTIONS[subscriber] if STREAMS[name].publisher == publisher]


def _tokens(role: str) -> list[str]:
    return [f"alive/{role}/*", f"complete/{role}"]


def access_control(role: str) -> dict[str, object]:
    """Value of `access_control` in the zenoh configuration of a role."""
    rules = {other: _rules(role, other) for other in ROLES if other != role}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for one in rules.values() for rule in one],
        "subjects": [{"id": other, "cert_common_names": [common_name(other)]} for other in rules],
        "policies": [
            {"subjects": [other], "rules": [rule["id"] for rule in one]}
            for other, one in rules.items()
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
