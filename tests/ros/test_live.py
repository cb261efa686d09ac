"""The Foxglove server on loopback: channels with their schemas, and the bytes of the topics."""

import base64
import json
import os
import re
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.schemas import schema_text
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, parameter_file
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.run.supervisor import Supervisor

from .flight import fork_server, slew


class Client:
    """A WebSocket client that speaks as little as it can."""

    def __init__(self, address: str, host: str = "", origin: str = "") -> None:
        where = urlsplit(address)
        self.services: dict[str, int] = {}  # ids of what is offered, by name
        self.channels: dict[str, Any] = {}  # by topic
        self.complaints: list[str] = []
        self._socket = socket.create_connection((where.hostname, where.port), timeout=20.0)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET /?{where.query} HTTP/1.1\r\nHost: {host or where.netloc}\r\n{origin}"
            "Upgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        reply = b""
        while b"\r\n\r\n" not in reply:
            reply += self._read(1)
        assert b" 101 " in reply, reply.decode("latin-1")

    def receive(self) -> Any:
        """Return the next message: JSON or binary."""
        first, size = self._read(2)
        if size == 126:
            (size,) = struct.unpack(">H", self._read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._read(8))
        data = self._read(size)
        if first & 15 != 1:
            return data
        message = json.loads(data)
        if message["op"] == "advertiseServices":
            self.services |= {s["name"]: s["id"] for s in message["services"]}
        elif message["op"] == "advertise":
            self.channels |= {c["topic"]: c for c in message["channels"]}
        elif message["op"] == "status":
            self.complaints.append(message["message"])
        return message

    def send(self, message: dict[str, Any]) -> None:
        self._send(0x81, json.dumps(message).encode())

    def send_binary(self, data: bytes) -> None:
        self._send(0x82, data)

    def _send(self, kind: int, data: bytes) -> None:
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        assert len(data) < 126  # else the length takes more bytes
        self._socket.sendall(struct.pack(">BB", kind, 0x80 | len(data)) + mask + masked)

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self._socket.recv(size - len(data))
            assert part, "the server has closed"
            data += part
        return data


def opened(log: Path, supervisor: Supervisor, what: str) -> str:
    """Return the address of the server that says that its clients do `what`."""
    end = monotonic() + 60.0
    while monotonic() < end:
        supervisor._poll(0.05)
        for address, does in re.findall(
            r"open (ws://\S+) in Foxglove, which (.+?) the", log.read_text()
        ):
            if does == what:
                return str(address)
    raise AssertionError("the server never opened")


class Servers(NamedTuple):
    operated: str  # address
    monitored: str
    bag: Path


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    """Two servers beside a controller, a planner and a log that plays: one may command."""
    folder = tmp_path_factory.mktemp("live")
    run_trial(slew(duration=6.0), "test", folder / "run", in_process=True, report=False)
    bag = folder / "run" / "bag"
    played = {"bag": str(bag), "topics": ["/truth", "/testbed"], "rate": 0.05}
    processes = [
        NodeProcess("live", "flexslew_lab", "live", {"port": 0, "operate": True}),
        NodeProcess("watch", "flexslew_lab", "live", {"port": 0}),
        NodeProcess("pd_feedforward", "flexslew_control", "controller", {}),
        NodeProcess("planner", "flexslew_control", "planner", {}),
        NodeProcess("plant", "flexslew_lab", "play", played),
    ]
    parameters = folder / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    with locked_domain() as domain:
        log = folder / "nodes.log"
        supervisor = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, fork_server()
        )
        try:
            operated = opened(log, supervisor, "watches and commands")
            yield Servers(operated, opened(log, supervisor, "watches"), bag)
        finally:
            supervisor._end()


@pytest.fixture(scope="module")
def bench(servers: Servers) -> tuple[Client, Path]:
    """Return a client that may command, and the bag that plays."""
    client = Client(servers.operated)
    offered = ["time", "parameters", "parametersSubscribe", "services"]
    assert client.receive()["capabilities"] == offered
    return client, servers.bag


def test_without_operate_a_client_only_watches(servers: Servers) -> None:
    client = Client(servers.monitored)
    assert client.receive()["capabilities"] == ["time", "parameters", "parametersSubscribe"]
    while "/truth" not in client.channels:
        client.receive()
    assert not client.services
    name = "/pd_feedforward.kd"
    before = told(client, {"op": "getParameters", "parameterNames": [name]})
    while name not in before:  # the node is still being met
        before = told(client, {"op": "getParameters", "parameterNames": [name]})
    requested = {"op": "setParameters", "parameters": [{"name": name, "value": [1.0, 1.0]}]}
    assert told(client, requested) == before
    client.send({"op": "advertise", "channels": [
        {"id": 1, "topic": "/effort_command", "encoding": "json", "schemaName": "x"}]})  # fmt: skip
    client.send_binary(struct.pack("<BI", 1, 1) + b"{}")
    for service in range(40):
        client.send_binary(struct.pack("<BIII4s", 2, service, 9, 4, b"json") + b"{}")
    failures = 0
    while failures < 40:
        message = client.receive()
        failures += isinstance(message, dict) and message["op"] == "serviceCallFailure"
        assert not (isinstance(message, bytes) and message[0] == 3)  # an answer
    assert any("read-only" in words for words in client.complaints)
    assert told(client, {"op": "getParameters", "parameterNames": [name]}) == before


@pytest.mark.parametrize("who", ["operated", "monitored"])
def test_a_foreign_page_a_wrong_host_or_no_token_is_not_let_in(servers: Servers, who: str) -> None:
    address = getattr(servers, who)
    where = urlsplit(address)
    for path, host, origin in (
        ("/", where.netloc, ""),
        ("/?token=wrong", where.netloc, ""),
        (f"/?{where.query}", where.netloc, "Origin: https://evil.example\r\n"),
        (f"/?{where.query}", f"evil.example:{where.port}", ""),
    ):
        with pytest.raises(AssertionError, match="403 Forbidden"):
            Client(f"ws://{where.netloc}{path}", host, origin)
    Client(address)


def test_a_client_gets_schemas_and_messages_byte_for_byte(bench: tuple[Client, Path]) -> None:
    client, bag = bench
    while not {"/truth", "/testbed"} <= {*client.channels}:
        client.receive()
    truth = client.channels["/truth"]
    assert (truth["encoding"], truth["schemaEncoding"]) == ("cdr", "ros2msg")
    assert truth["schema"] == schema_text("flexslew_msgs/msg/PlantState")
    found = {7: subscribed(client, 7, truth["id"])}
    for _ in range(10):  # by now the testbed has announced itself, once
        client.receive()
    found[8] = subscribed(client, 8, client.channels["/testbed"]["id"])
    (now,) = struct.unpack_from("<Q", binary(client, 2), 1)
    for number, topic in ((7, "/truth"), (8, "/testbed")):
        logged = {m.data.rstrip(b"\0") for m in BagReader(bag).messages([topic])}
        stamp, data = found[number]
        assert data.rstrip(b"\0") in logged  # DDS rounds lengths up
        assert stamp % 10_000_000 == 0  # simulated time of a tick
    assert found[7][0] <= now <= 6_000_000_000  # the server's clock is the bench's
    assert now % 10_000_000 == 0


def test_a_client_calls_the_services_of_the_bench_and_plans(bench: tuple[Client, Path]) -> None:
    client, _ = bench
    tune = "/pd_feedforward/tune"
    while tune not in client.services:
        client.receive()
    assert set(client.services) == {
        "/operate", "/step", "/set_rate", "/note", "/switch_controller", "/inject_fault",
        "/end_fault", "/decide_plan", "/retarget", "/plan_slew", "/draft_plan", tune,
    }  # fmt: skip
    answer = called(client, "/step", {"ticks": "many"})
    assert answer["message"] == "ticks: 'many' is not allowed: of type uint32"
    answer = called(client, tune, {"settings": "{kp: [510.0, 510.0]}"})
    assert answer["message"].startswith("kp: [510.0, 510.0] from tick")
    requested = "{method: reference_only, goal: {base_yaw: 0.1}, duration: 5}"
    while (
        "no planner" in (answer := called(client, "/draft_plan", {"request": requested}))["message"]
    ):
        continue
    assert answer["message"] == "reference_only: 5 s from 0 s on is drafted: adopt or refuse it"
    assert called(client, "/decide_plan", {"action": "refuse"})["ok"]
    assert not called(client, "/decide_plan", {"action": "adopt"})["ok"]


@pytest.mark.slow
def test_a_client_reads_and_sets_parameters(bench: tuple[Client, Path]) -> None:
    client, _ = bench

    every: dict[str, Any] = {}
    while not {"/pd_feedforward.kp", "/plant.rate"} <= {*every}:
        every = told(client, {"op": "getParameters", "parameterNames": []})
    assert every["/plant.rate"] == 0.05
    name = "/pd_feedforward.kd"
    for value in ([900.0, 900.0], [800, 800]):
        set_to = {"op": "setParameters", "parameters": [{"name": name, "value": value}]}
        assert told(client, set_to) == {name: value}
    set_to["parameters"] = [{"name": name, "value": [-1.0, 1.0]}]
    assert told(client, set_to) == {name: [800, 800]}
    [words] = client.complaints
    assert "-1.0 is not allowed" in words


def told(client: Client, request: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters that the answer to a request names."""
    client.send({**request, "id": "a"})
    while True:
        message = client.receive()
        if isinstance(message, dict) and message.get("id") == "a":
            return {p["name"]: p.get("value") for p in message["parameters"]}


def binary(client: Client, kind: int) -> bytes:
    """Return the next binary message of a kind."""
    while True:
        message = client.receive()
        if isinstance(message, bytes) and message[0] == kind:
            return message


def called(client: Client, name: str, request: dict[str, Any]) -> Any:
    """Return the answer of a service."""
    service = client.services[name]
    client.send_binary(
        struct.pack("<BIII4s", 2, service, 9, 4, b"json") + json.dumps(request).encode()
    )
    while True:
        message = binary(client, 3)
        of, call, length = struct.unpack_from("<III", message, 1)
        if (of, call) == (service, 9):
            return json.loads(message[13 + length :])


def subscribed(client: Client, number: int, channel: int) -> tuple[int, bytes]:
    """Return time and bytes of the first message of a channel."""
    subscription = {"id": number, "channelId": channel}
    client.send({"op": "subscribe", "subscriptions": [subscription]})
    while True:
        message = binary(client, 1)
        of, stamp = struct.unpack_from("<IQ", message, 1)
        if of == number:
            return stamp, message[13:]
