"""What a run's Zenoh sessions are told: one router, and clients that may do what they were granted, no more.

Pure: builds JSON text, opens nothing. A setting that departs from Zenoh's default says why; what was measured
was measured on eclipse-zenoh 1.10.2 with 43 processes on 2 cores.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from bus.access import Grant

RUNTIME_VARIABLE = "ZENOH_RUNTIME"
"""Zenoh reads its threads from this environment variable, once: when a process opens its first session."""

CLIENT_RUNTIME = "(rx: (handover: app), net: (handover: app), acc: (handover: app), tx: (handover: app))"
"""A client has one link: one thread receives, another sends, and Zenoh's other four are not started. That
saves two thirds of the time to announce and a tenth of a client's CPU. Sending keeps a thread of its own,
because the receiving one waits for the interpreter's lock while the node computes."""

ROUTER_RUNTIME = "(rx: (worker_threads: 16))"
"""A receiving thread that finds a stopped client's queue full waits there. Of Zenoh's own two threads, two
blocked senders would leave none for the others; sixteen cost address space only."""

LEASE_STALLS = 4
"""Stall deadlines that a silent link and a blocked send outlive: our supervision speaks before Zenoh."""


def router_config(endpoint: str, grants: Sequence[Grant], password_file: str, stall_s: float) -> str:
    """Return the configuration of the router: where it listens, whom it knows and what each may do."""
    config = _common(stall_s)
    config["mode"] = "router"
    config["listen"] = {"endpoints": [endpoint]}
    config["transport"]["auth"] = {"usrpwd": {"dictionary_file": password_file}}
    config["access_control"] = access_control(grants)
    return json.dumps(config)


def client_config(endpoint: str, user: str, password: str, stall_s: float) -> str:
    """Return the configuration of a client: one router, dialled once, with one user's credential."""
    config = _common(stall_s)
    config["mode"] = "client"
    config["connect"] = {"endpoints": [endpoint], "timeout_ms": 0, "exit_on_failure": True}
    config["transport"]["auth"] = {"usrpwd": {"user": user, "password": password}}
    return json.dumps(config)


def access_control(grants: Sequence[Grant]) -> dict[str, Any]:
    """Return rules that refuse what is not granted: foreign keys, ``**``, queries, deletions, others' tokens.

    Flows are the router's: *ingress* comes from the client, *egress* goes to it. A publication or
    subscription is allowed only if a granted expression includes the whole of its key.
    """
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for grant in grants:
        own = _rules(grant)
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [grant.user]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": grant.user, "usernames": [grant.user]} for grant in grants],
        "policies": policies,
    }


def _rules(grant: Grant) -> list[dict[str, Any]]:
    allowed = (
        ("publishes", "put", "ingress", grant.may_put),
        ("is-delivered", "put", "egress", grant.may_subscribe),
        ("subscribes", "declare_subscriber", "ingress", grant.may_subscribe),
        # A client keeps back what it believes that nobody hears. It is told the subscribers' own expressions,
        # and the recorder's is wide: a narrower rule would not include it. So everybody may learn who
        # listens.
        ("is-heard", "declare_subscriber", "egress", ("**",)),
        ("lives", "liveliness_token", "ingress", (grant.alive,)),
    )
    return [
        {
            "id": f"{grant.user}-{verb}",
            "permission": "allow",
            "messages": [message],
            "flows": [flow],
            "key_exprs": list(keys),
        }
        for verb, message, flow, keys in allowed
        if keys
    ]


def _common(stall_s: float) -> dict[str, Any]:
    patience_ms = round(1000 * LEASE_STALLS * stall_s)
    return {
        # No discovery: sessions that found each other would link around the router and its rules. Without a
        # zero delay, a router waits half a second for peers that cannot come.
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}, "delay": 0},
        # The router's wall-clock stamps would travel in every message and nobody reads them.
        "timestamping": {"enabled": False},
        "transport": {
            # Shared memory leaves files behind when a process is killed.
            "shared_memory": {"enabled": False},
            # The low-latency transport neither batches nor fragments: bursts cost the router a third more
            # CPU, and a message above 64 KiB ends the link. Priorities are of no use here, and take eight
            # queues a link.
            "unicast": {"lowlatency": False, "qos": {"enabled": False}},
            "link": {
                "tx": {
                    "lease": patience_ms,
                    "queue": {
                        "size": {"data": 16},
                        "congestion_control": {"block": {"wait_before_close": 1000 * patience_ms}},
                    },
                }
            },
        },
    }
