"""The bus with real sessions, and with real processes where one must die or stop."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import queue
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import pytest
import zenoh

from bus.access import Grant
from bus.refusals import Probe, prove_refusals
from bus.zenoh.client import Client
from bus.zenoh.config import client_config
from bus.zenoh.router import Router
from bus.zenoh.session import BusError, BusTimeout

GRANTS = [
    Grant("sensor", ("t/tx/sensor/*",), ("t/truth/*",), "t/alive/sensor"),
    Grant("estimator", ("t/tx/estimator/*", "t/estimate/*"), ("t/rx/estimator/*",), "t/alive/estimator"),
    Grant("channel", ("t/rx/*/*",), ("t/tx/*/*",), "t/alive/channel"),
    Grant("mute", (), (), "t/alive/mute"),
]
SECONDS = 10.0
ROOT = Path(__file__).parents[2]
PROCESSES = multiprocessing.get_context("spawn")


@pytest.fixture
def router() -> Iterator[Router]:
    with Router(GRANTS, stall_s=SECONDS) as router:
        yield router


def client_of(router: Router, user: str, **what: Any) -> Client:
    return Client(router.endpoint, user, router.password(user), stall_s=SECONDS, **what)


def join(router: Router, client: Client) -> None:
    """Announce a client and wait until the router knows what it subscribes to."""
    client.announce(f"t/alive/{client.user}")
    assert router.wait_alive([f"t/alive/{client.user}"], SECONDS) == set()


def recorded(router: Router, key_expr: str = "**") -> queue.SimpleQueue[tuple[str, bytes]]:
    arrived: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    router.subscribe(key_expr, lambda key, payload: arrived.put((key, payload)))
    return arrived


@contextlib.contextmanager
def running(target: Callable[..., None], *args: Any) -> Iterator[SpawnProcess]:
    process = PROCESSES.Process(target=target, args=args, daemon=True)
    process.start()
    try:
        yield process
    finally:
        process.kill()
        process.join(SECONDS)


def raw_session(router: Router, user: str) -> zenoh.Session:
    """What a dishonest process can do: open a session with its credential, and try anything."""
    config = client_config(router.endpoint, user, router.password(user), SECONDS)
    return zenoh.open(zenoh.Config.from_json5(config))


# --- delivery


def test_messages_arrive_in_order_at_their_receivers_and_at_the_recorder(router: Router) -> None:
    arrived = recorded(router)
    with (
        client_of(router, "channel", subscribe=["t/tx/*/*"], publish=["t/rx/estimator/correct"]) as channel,
        client_of(router, "sensor", publish=["t/tx/sensor/measurement"]) as sensor,
        client_of(router, "estimator", subscribe=["t/rx/estimator/*"]) as estimator,
    ):
        for client in (channel, sensor, estimator):
            join(router, client)
        for step in range(200):
            sensor.put("t/tx/sensor/measurement", b"%d" % step)
            key, payload = channel.receive(SECONDS)
            assert (key, payload) == ("t/tx/sensor/measurement", b"%d" % step)
            channel.put("t/rx/estimator/correct", payload)
        assert [estimator.receive(SECONDS)[1] for _ in range(200)] == [b"%d" % step for step in range(200)]
    seen = [arrived.get(timeout=SECONDS) for _ in range(400)]
    for topic in ("t/tx/sensor/measurement", "t/rx/estimator/correct"):
        assert [payload for key, payload in seen if key == topic] == [b"%d" % step for step in range(200)]


def test_a_message_larger_than_a_batch_arrives_whole(router: Router) -> None:
    payload = os.urandom(1_000_000)
    with client_of(router, "estimator", subscribe=["t/rx/estimator/*"]) as estimator:
        join(router, estimator)
        router.put("t/rx/estimator/correct", payload)
        assert estimator.receive(SECONDS) == ("t/rx/estimator/correct", payload)


def test_nobody_hears_itself(router: Router) -> None:
    arrived = recorded(router)
    router.put("t/rx/estimator/correct", b"from the router")
    keys = {"subscribe": ["t/truth/p", "t/tx/sensor/*"], "publish": ["t/tx/sensor/x"]}
    with client_of(router, "sensor", **keys) as sensor:
        join(router, sensor)
        sensor.put("t/tx/sensor/x", b"from the sensor")
        router.put("t/truth/p", b"truth")
        assert sensor.receive(SECONDS) == ("t/truth/p", b"truth")
    assert arrived.get(timeout=SECONDS) == ("t/tx/sensor/x", b"from the sensor")
    assert arrived.empty()


def test_an_ended_subscription_has_delivered_what_had_arrived(router: Router) -> None:
    early: list[bytes] = []
    end = router.subscribe("t/tx/sensor/a", lambda _, payload: (time.sleep(0.002), early.append(payload))[1])
    late = recorded(router, "t/tx/sensor/b")
    with client_of(router, "sensor", publish=["t/tx/sensor/a", "t/tx/sensor/b"]) as sensor:
        join(router, sensor)
        for step in range(50):
            sensor.put("t/tx/sensor/a", b"%d" % step)
        sensor.put("t/tx/sensor/b", b"last")
        late.get(timeout=SECONDS)
    end()
    assert early == [b"%d" % step for step in range(50)]


def test_the_bus_runs_on_the_loopback_interface_too() -> None:
    with (
        Router(GRANTS, listen="tcp/127.0.0.1:0", stall_s=SECONDS) as router,
        client_of(router, "estimator", subscribe=["t/rx/estimator/*"]) as estimator,
    ):
        join(router, estimator)
        router.put("t/rx/estimator/correct", b"1")
        assert estimator.receive(SECONDS)[1] == b"1"


# --- deadlines


def test_receiving_ends_at_its_deadline(router: Router) -> None:
    with client_of(router, "estimator", subscribe=["t/rx/estimator/*"]) as estimator:
        join(router, estimator)
        begun = time.monotonic()
        with pytest.raises(BusTimeout, match=r"estimator received nothing for 0\.05 s"):
            estimator.receive(0.05)
        assert time.monotonic() - begun < 2.0


def test_announcing_names_the_keys_that_nobody_hears(router: Router) -> None:
    sensor = Client(
        router.endpoint, "sensor", router.password("sensor"), publish=["t/tx/sensor/measurement"], stall_s=0.1
    )
    with sensor, pytest.raises(BusTimeout, match="nobody subscribes to t/tx/sensor/measurement"):
        sensor.announce("t/alive/sensor")


def test_waiting_for_clients_returns_the_missing_ones(router: Router) -> None:
    with client_of(router, "mute") as mute:
        join(router, mute)
        assert router.wait_alive(["t/alive/mute", "t/alive/sensor"], 0.2) == {"t/alive/sensor"}


def test_sending_on_a_key_that_was_not_named_tells_the_cure(router: Router) -> None:
    with client_of(router, "sensor") as sensor, pytest.raises(BusError, match="name it in 'publish'"):
        sensor.put("t/tx/sensor/measurement", b"")


# --- admission


@pytest.mark.parametrize(("user", "password"), [("sensor", "wrong"), ("stranger", "wrong"), ("", "")])
def test_a_stranger_is_refused_at_once(router: Router, user: str, password: str) -> None:
    begun = time.monotonic()
    with pytest.raises(BusError, match="does not admit"):
        Client(router.endpoint, user, password)
    assert time.monotonic() - begun < 2.0


def test_the_password_of_another_user_is_refused(router: Router) -> None:
    with pytest.raises(BusError, match="does not admit 'sensor'"):
        Client(router.endpoint, "sensor", router.password("channel"))


def test_a_session_without_a_credential_is_refused(router: Router) -> None:
    config = zenoh.Config.from_json5(client_config(router.endpoint, "", "", SECONDS))
    config.insert_json5("transport/auth/usrpwd", "{}")
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_a_router_that_is_not_there_is_told_at_once(tmp_path: Path) -> None:
    begun = time.monotonic()
    with pytest.raises(BusError, match="it is not running"):
        Client(f"unixsock-stream/{tmp_path}/nobody", "sensor", "x")
    assert time.monotonic() - begun < 2.0


def test_passwords_differ_by_user_and_leave_nothing_on_the_disk(router: Router) -> None:
    assert len({router.password(grant.user) for grant in GRANTS}) == len(GRANTS)
    directory = Path(router.endpoint.removeprefix("unixsock-stream/")).parent
    assert stat.S_IMODE(directory.stat().st_mode) == 0o700
    assert all(path.is_socket() or path.stat().st_size == 0 for path in directory.iterdir())
    router.close()
    assert not directory.exists()


@pytest.mark.parametrize(
    ("grants", "complaint"),
    [
        ([], "without users"),
        ([Grant("a", (), (), "k"), Grant("a", (), (), "k")], "same user"),
        ([Grant("a:b", (), (), "k")], "no colon"),
    ],
)
def test_a_router_refuses_users_that_it_could_not_keep_apart(grants: list[Grant], complaint: str) -> None:
    with pytest.raises(BusError, match=complaint):
        Router(grants)


def test_two_routers_cannot_share_an_endpoint(router: Router) -> None:
    with pytest.raises(BusError, match="cannot listen"):
        Router(GRANTS, listen=router.endpoint)


# --- access


def test_a_dishonest_process_can_neither_speak_for_others_nor_delete_nor_feign_life(router: Router) -> None:
    arrived = recorded(router)
    with raw_session(router, "sensor") as session:
        session.put("t/truth/p", b"forged")
        session.put("t/tx/estimator/exchange", b"forged")
        session.put("elsewhere", b"forged")
        session.delete("t/tx/sensor/measurement")
        with session.liveliness().declare_token("t/alive/estimator"):
            session.put("t/tx/sensor/measurement", b"genuine")
            assert arrived.get(timeout=SECONDS) == ("t/tx/sensor/measurement", b"genuine")
            assert arrived.empty()
            assert router.wait_alive(["t/alive/estimator"], 0.0) == {"t/alive/estimator"}


def test_a_dishonest_process_hears_only_what_it_was_granted(router: Router) -> None:
    recorded(router)
    heard: queue.SimpleQueue[str] = queue.SimpleQueue()
    with raw_session(router, "estimator") as session, client_of(router, "mute") as mute:
        join(router, mute)
        for key_expr in ("t/truth/p", "t/**", "**", "t/rx/*/*", "t/rx/estimator/correct"):
            session.declare_subscriber(
                key_expr,
                zenoh.handlers.Callback(lambda sample: heard.put(str(sample.key_expr)), indirect=False),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        with session.liveliness().declare_token("t/alive/estimator"):
            assert router.wait_alive(["t/alive/estimator"], SECONDS) == set()  # it has declared all of them
        router.put("t/truth/p", b"")
        router.put("t/rx/other/correct", b"")
        router.put("t/rx/estimator/predict", b"")  # granted, but asked for only by wider expressions
        router.put("t/rx/estimator/correct", b"")
        while (key := heard.get(timeout=SECONDS)) != "t/rx/estimator/correct":
            assert key == "t/rx/estimator/predict"
        assert list(session.liveliness().get("**", timeout=0.2)) == []


def test_queries_are_refused_in_both_directions(router: Router) -> None:
    asked: list[str] = []
    with raw_session(router, "channel") as one, raw_session(router, "sensor") as other:
        one.declare_queryable("t/tx/sensor/measurement", lambda query: asked.append("channel"))
        with one.liveliness().declare_token("t/alive/channel"):
            assert router.wait_alive(["t/alive/channel"], SECONDS) == set()  # its queryable came before
            assert list(other.get("t/tx/sensor/measurement", timeout=0.2)) == []
    assert asked == []


PROBE = Probe("estimator", "t/tx/sensor/x", "t/truth/p", "t/estimate/estimator", "t/rx/estimator/x")


def test_the_proof_of_refusals_is_quick_and_leaves_nothing(router: Router) -> None:
    begun = time.monotonic()
    prove_refusals(
        router,
        [PROBE, Probe("sensor", "t/truth/p", "t/rx/estimator/x", "t/tx/sensor/x", "t/truth/p")],
    )
    assert time.monotonic() - begun < 1.0  # some 15 ms on an idle machine
    arrived = recorded(router)
    with client_of(router, "sensor", publish=["t/tx/sensor/x"]) as sensor:
        join(router, sensor)
        sensor.put("t/tx/sensor/x", b"1")
        assert arrived.get(timeout=SECONDS) == ("t/tx/sensor/x", b"1")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"forbidden_put": "t/tx/estimator/x"}, "was not refused to send on 't/tx/estimator/x'"),
        ({"forbidden_subscribe": "t/rx/estimator/y"}, "was not refused to hear 't/rx/estimator/y'"),
        ({"allowed_put": "t/tx/sensor/y"}, "may send on 't/tx/sensor/y', but was refused"),
        ({"allowed_subscribe": "t/truth/q"}, "may hear 't/truth/q', but was refused"),
    ],
)
def test_the_proof_fails_when_the_rules_are_not_what_the_caller_believes(
    router: Router, change: dict[str, str], complaint: str
) -> None:
    believed = Probe(**{**PROBE.__dict__, **change})
    with pytest.raises(BusError, match=complaint):
        prove_refusals(router, [believed], timeout_s=0.3)


# --- processes that stop or die


def listen(endpoint: str, password: str, count: int, report: Any) -> None:
    client = Client(endpoint, "channel", password, subscribe=["t/tx/*/*"], stall_s=SECONDS)
    with client:
        client.announce("t/alive/channel")
        report.put([client.receive(SECONDS)[1] for _ in range(count)])


def speak(endpoint: str, password: str, count: int, size: int) -> None:
    keys = {"subscribe": ["t/truth/go"], "publish": ["t/tx/sensor/x"]}
    with Client(endpoint, "sensor", password, stall_s=SECONDS, **keys) as client:
        client.announce("t/alive/sensor")
        client.receive(SECONDS)
        for number in range(count):
            client.put("t/tx/sensor/x", b"%08d" % number + bytes(size - 8))
        time.sleep(SECONDS)


def test_a_stopped_receiver_holds_up_its_sender_alone_and_loses_nothing(router: Router) -> None:
    count, size = 1500, 4000  # 6 MB: several times what the way can hold
    report = PROCESSES.Queue()
    with (
        running(listen, router.endpoint, router.password("channel"), count, report) as listener,
        running(speak, router.endpoint, router.password("sensor"), count, size),
        client_of(router, "estimator", subscribe=["t/rx/estimator/*"]) as estimator,
    ):
        join(router, estimator)
        assert router.wait_alive(["t/alive/channel", "t/alive/sensor"], SECONDS) == set()
        assert listener.pid is not None
        os.kill(listener.pid, signal.SIGSTOP)
        router.put("t/truth/go", b"")
        until = time.monotonic() + 1.5
        while time.monotonic() < until:
            router.put("t/rx/estimator/correct", b"meanwhile")
            assert estimator.receive(SECONDS)[1] == b"meanwhile"
        assert report.empty()
        os.kill(listener.pid, signal.SIGCONT)
        payloads = report.get(timeout=SECONDS)
    assert [int(payload[:8]) for payload in payloads] == list(range(count))


def test_a_link_outlives_the_stall_deadline_fourfold() -> None:
    link = json.loads(client_config("tcp/127.0.0.1:1", "sensor", "x", 30.0))["transport"]["link"]["tx"]
    assert link["lease"] == 120_000
    assert link["queue"]["congestion_control"]["block"]["wait_before_close"] == 120_000_000


def live(endpoint: str, password: str) -> None:
    with Client(endpoint, "mute", password, stall_s=SECONDS) as client:
        client.announce("t/alive/mute")
        time.sleep(SECONDS)


def test_a_killed_process_is_noticed_within_a_second() -> None:
    gone: queue.SimpleQueue[str] = queue.SimpleQueue()
    with (
        Router(GRANTS, stall_s=SECONDS, on_gone=gone.put) as router,
        running(live, router.endpoint, router.password("mute")) as process,
    ):
        assert router.wait_alive(["t/alive/mute"], SECONDS) == set()
        assert gone.empty()
        process.kill()
        assert gone.get(timeout=1.0) == "t/alive/mute"
        assert router.wait_alive(["t/alive/mute"], 0.0) == {"t/alive/mute"}


def route(report: Any) -> None:
    with Router(GRANTS, listen="tcp/127.0.0.1:0", stall_s=SECONDS) as router:
        report.put((router.endpoint, router.password("estimator")))
        router.subscribe("t/estimate/*", lambda key, payload: None)
        router.wait_alive(["t/alive/estimator"], SECONDS)
        router.put("t/rx/estimator/correct", b"last words")
        time.sleep(SECONDS)


def test_a_client_notices_within_a_second_that_the_router_was_killed() -> None:
    report = PROCESSES.Queue()
    with running(route, report) as process:
        endpoint, password = report.get(timeout=SECONDS)
        keys = {"subscribe": ["t/rx/estimator/*"], "publish": ["t/estimate/estimator"]}
        with Client(endpoint, "estimator", password, stall_s=SECONDS, **keys) as client:
            client.announce("t/alive/estimator")
            assert client.receive(SECONDS)[1] == b"last words"
            process.kill()
            for _ in range(2):
                with pytest.raises(BusError, match="the router is gone") as caught:
                    client.receive(1.0)
                assert not isinstance(caught.value, BusTimeout)
            with pytest.raises(BusError, match="the router is gone"):
                client.put("t/estimate/estimator", b"")


LEFT_OPEN = """
import sys
from bus.access import Grant
from bus.zenoh.client import Client
from bus.zenoh.router import Router
router = Router([Grant("a", ("x",), ("y",), "alive")])
router.subscribe("**", lambda key, payload: None)
client = Client(router.endpoint, "a", router.password("a"), subscribe=["y"], publish=["x"])
client.announce("alive")
raise RuntimeError("not caught")
"""


def test_a_process_that_raises_with_open_sessions_ends() -> None:
    command = [sys.executable, "-c", LEFT_OPEN]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ended.returncode == 1
    assert ended.stderr.rstrip().endswith("RuntimeError: not caught")
