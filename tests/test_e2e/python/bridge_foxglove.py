"""A client of Foxglove's websocket protocol, written from its description alone.

Usage: bridge_foxglove.py PORT

Subscribes to an image, reads and sets parameters, steps the world by the service, and says what it saw.
"""

import json
import struct
import sys
import time

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

MESSAGE, TIME, RESPONSE = 1, 2, 3
CALL = 2


class Client:
    def __init__(self, port):
        protocols = ["foxglove.sdk.v1", "foxglove.websocket.v1"]
        self.socket = connect(f"ws://127.0.0.1:{port}", subprotocols=protocols, max_size=None).__enter__()
        assert self.socket.subprotocol in protocols, self.socket.subprotocol
        self.channels, self.services, self.parameters, self.responses, self.messages = {}, {}, {}, {}, []
        self.info, self.last_time, self.failures, self.answered = None, 0, [], set()

    def turn(self):
        """Takes one message of the server."""
        data = self.socket.recv(timeout=60)
        if isinstance(data, bytes):
            if data[0] == MESSAGE:
                subscription, nanos = struct.unpack_from("<IQ", data, 1)
                self.messages.append((subscription, nanos, data[13:]))
            elif data[0] == TIME:
                (self.last_time,) = struct.unpack_from("<Q", data, 1)
            elif data[0] == RESPONSE:
                _, call, length = struct.unpack_from("<III", data, 1)
                self.responses[call] = data[13 + length :]
            return
        text = json.loads(data)
        if text["op"] == "serverInfo":
            self.info = text
        elif text["op"] == "advertise":
            self.channels.update({channel["topic"]: channel for channel in text["channels"]})
        elif text["op"] == "advertiseServices":
            self.services.update({service["name"]: service for service in text["services"]})
        elif text["op"] == "parameterValues":
            self.parameters.update({of["name"]: of.get("value") for of in text["parameters"]})
            self.answered.add(text.get("id"))
        elif text["op"] == "serviceCallFailure":
            self.failures.append(text["message"])

    def until(self, what, holds):
        end = time.monotonic() + 100
        while not (found := holds()):
            assert time.monotonic() < end, f"{what}: {self.info}, {sorted(self.channels)}, {self.parameters}, {self.failures}"
            self.turn()
        return found

    def send(self, **fields):
        self.socket.send(json.dumps(fields))

    def call(self, number, service, request):
        encoding = b"json"
        head = struct.pack("<BIII", CALL, self.services[service]["id"], number, len(encoding))
        self.socket.send(head + encoding + request)
        return json.loads(self.until(service, lambda: number in self.responses and self.responses[number]))


def fields(data):
    """Number and value of each field of a protobuf message."""
    at = 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(data):
        tag = varint()
        number, wire = tag >> 3, tag & 7
        if wire == 0:
            yield number, varint()
        elif wire == 1:
            yield number, data[at : at + 8]
            at += 8
        elif wire == 5:
            yield number, data[at : at + 4]
            at += 4
        else:
            length = varint()
            yield number, data[at : at + length]
            at += length


def of_page(site):
    """Status of the answer to a page of this site."""
    try:
        with connect(f"ws://127.0.0.1:{sys.argv[1]}", subprotocols=["foxglove.sdk.v1"], origin=site):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


assert of_page("https://evil.example") == 403
assert of_page("https://app.foxglove.dev") == 101
client = Client(sys.argv[1])
client.until("server info", lambda: client.info)
assert {"time", "parameters", "services"} <= set(client.info["capabilities"]), client.info
image = client.until("the camera", lambda: client.channels.get("/ego/front/rgb"))
assert (image["encoding"], image["schemaName"], image["schemaEncoding"]) == ("protobuf", "foxglove.RawImage", "protobuf"), image
client.until("services", lambda: {"/pause", "/resume", "/step"} <= set(client.services))
client.send(op="subscribeParameterUpdates", parameterNames=["paused", "weather.fog_density"])
# The server may have been asked before it knew the world.
for _ in range(200):
    client.send(op="getParameters", parameterNames=[], id="first")
    client.until("an answer", lambda: "first" in client.answered)
    client.answered.clear()
    if "map" in client.parameters:
        break
    time.sleep(0.1)
assert client.parameters["map"] == "Town10HD" and client.parameters["paused"] is True, client.parameters

client.send(op="subscribe", subscriptions=[{"id": 7, "channelId": image["id"]}])
before = client.call(1, "/step", b'{"n": 3}')["last_tick"]
# The camera is rendered from the first tick on that the subscription is known in.
number = 1
while not (images := [message for message in client.messages if message[0] == 7]):
    number += 1
    assert number < 1000, "no image came"
    before = client.call(number, "/step", b"")["last_tick"]
    time.sleep(0.02)
first = images[0]
parts = dict(fields(first[2]))
# RawImage: 2 width, 3 height, 4 encoding, 5 step, 6 data, 7 frame_id.
width, height, step = (struct.unpack("<I", parts[n])[0] for n in (2, 3, 5))
assert (width, height, step, parts[4]) == (96, 64, 384, b"bgra8"), parts
assert len(parts[6]) == step * height and len(set(parts[6])) > 10
assert first[1] % 50_000_000 == 0 and first[1] > 0, "messages carry simulated time"
client.until("the time", lambda: client.last_time >= first[1])
assert client.call(5000, "/step", b"")["last_tick"] == before + 1

client.send(op="setParameters", parameters=[{"name": "weather.fog_density", "value": 42.0}, {"name": "paused", "value": False}], id="second")
client.until("the fog", lambda: client.parameters.get("weather.fog_density") == 42.0)
client.until("the world runs", lambda: client.parameters.get("paused") is False)
seen = len(client.messages)
client.until("images that nobody asked for", lambda: len(client.messages) > seen + 3)
client.call(5001, "/pause", b"{}")
client.until("the world stands", lambda: client.parameters.get("paused") is True)
print(f"saw {width}x{height} images, stepped to {before + 1}", flush=True)
