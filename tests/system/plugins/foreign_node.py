"""An estimator written against the wire protocol alone: plain Zenoh and JSON, nothing of Gauntlet's.

It publishes a constant belief. With the argument ``rude`` it also misbehaves in every way that the wire
allows, and writes what it could hear of the truth into the file that is its second argument.
"""

import json
import os
import queue
import sys
import time

import zenoh

NODE = os.environ["GAUNTLET_NODE"]
PREFIX = f"gauntlet/{os.environ['GAUNTLET_RUN']}/"
STEPS = int(os.environ["GAUNTLET_STEPS"])
PERIOD_S = float(os.environ["GAUNTLET_PERIOD_S"])
RUDE = len(sys.argv) > 1 and sys.argv[1] == "rude"
PATIENCE_S = 60.0

CONFIG = {
    "mode": "client",
    "connect": {"endpoints": [os.environ["GAUNTLET_ENDPOINT"]], "timeout_ms": 0, "exit_on_failure": True},
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "transport": {
        "auth": {"usrpwd": {"user": NODE, "password": os.environ["GAUNTLET_PASSWORD"]}},
        "shared_memory": {"enabled": False},
        "unicast": {"qos": {"enabled": False}},
    },
}


def estimate(step: int) -> str:
    """Return the message of a constant belief: state 0, covariance I."""
    lists = ("detector_source", "detector_sequence", "detector_statistic", "detector_alarm")
    covariance = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message = {
        "step": step, "t": step * PERIOD_S, "refers_to": step, "diverged": False, "state": [0.0] * 3,
        "covariance": covariance, "covariance_shape": [3, 3], "sigma": [1.0] * 3, "nis": 0.0, "nis_dof": 0,
        **{name: [] for name in (*lists, "diagnostic_name", "diagnostic_value")},
    }  # fmt: skip
    return json.dumps(message, separators=(",", ":"))


def oracle(step: int) -> str:
    """Return an inbox that tells its receiver of an attack."""
    told = {"source": ["s1"], "sent_step": [step], "sequence": [step], "kind": ["oracle"]}
    values = {"offset": [0], "values": [9.9], "check": []}
    return json.dumps({"step": step, "t": step * PERIOD_S, "round": 0, **told, **values})


def misbehave(session: zenoh.Session, own, step: int) -> None:
    """Send junk, repeat an old slot and run ahead on the own key; write on the keys of others; delete."""
    own.put(b"\xff{")
    own.put("[]")
    own.put(estimate(0))
    own.put(estimate(step + 5))
    session.put(PREFIX + "truth/plant", json.dumps({"step": step, "t": 0.0, "state": [9.9, 9.9, 9.9]}))
    session.put(PREFIX + "estimate/e1", estimate(step))
    session.put(PREFIX + "rx/e1/correct", oracle(step))
    session.put(PREFIX + "rx/plant/credit", json.dumps({"steps_recorded": 10**6}))
    session.delete(PREFIX + "estimate/e1")


def main() -> None:
    inbox: queue.Queue = queue.Queue()
    overheard: list[str] = []
    with zenoh.open(zenoh.Config.from_json5(json.dumps(CONFIG))) as session:
        topics = (f"rx/{NODE}/correct", "control/start", "control/stop")
        subscribers = [session.declare_subscriber(PREFIX + topic, inbox.put) for topic in topics]
        if RUDE:
            for peeked in (PREFIX + "truth/plant", PREFIX + "**", "**", PREFIX + "rx/e1/correct"):
                listen = {"allowed_origin": zenoh.Locality.REMOTE}  # its own forgeries are no secret to it
                subscribers.append(
                    session.declare_subscriber(
                        peeked, lambda sample: overheard.append(str(sample.key_expr)), **listen
                    )
                )
        reliable = {"congestion_control": zenoh.CongestionControl.BLOCK}
        own = session.declare_publisher(PREFIX + f"estimate/{NODE}", **reliable)
        finished = session.declare_publisher(PREFIX + f"control/finished/{NODE}", **reliable)
        while not (own.matching_status.matching and finished.matching_status.matching):
            time.sleep(0.01)
        token = session.liveliness().declare_token(PREFIX + f"alive/{NODE}")
        for step in range(STEPS):
            while not str(inbox.get(timeout=PATIENCE_S).key_expr).endswith("/correct"):
                pass
            own.put(estimate(step))
            if RUDE:
                misbehave(session, own, step)
        finished.put(json.dumps({"cpu_s": time.process_time(), "peak_memory_bytes": 0, "rejected": {}}))
        while not str(inbox.get(timeout=PATIENCE_S).key_expr).endswith("control/stop"):
            pass
        token.undeclare()
    if RUDE:
        allowed = {PREFIX + topic for topic in topics}
        with open(sys.argv[2], "w") as file:
            json.dump(sorted(set(overheard) - allowed), file)


main()
