"""Reading the world: the newest snapshot and the documents."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _bus, _layout
from ._dtypes import ACTOR, DOCUMENT_HEADER, SNAPSHOT_HEADER, TRAFFIC_LIGHT_PART, VEHICLE_PART
from ._errors import FrameFormatError, GantryError

_KIND = {name: number for number, name in _layout.ACTOR_KINDS.items()}


@dataclass(frozen=True)
class Snapshot:
    """The world after one tick, copied out of shared memory."""

    #: Fields of `GantrySnapshotHeader` by name.
    header: dict[str, Any]
    #: Structured array (n,), one `ActorRecord` per actor by rising id; SPEC.md §5 has its fields.
    actors: np.ndarray

    @property
    def tick(self) -> int:
        """Tick this snapshot shows."""
        return self.header["tick"]

    @property
    def sim_time(self) -> float:
        """Simulated time, seconds."""
        return self.header["sim_nanos"] * 1e-9

    @property
    def vehicles(self) -> np.ndarray:
        """Records of the vehicles, by rising id."""
        return self.actors[self.actors["kind"] == _KIND["vehicle"]]

    @property
    def vehicle_parts(self) -> np.ndarray:
        """`VehiclePart`s of `vehicles` (control, gear, lamps, …), in the same order."""
        return np.ascontiguousarray(self.vehicles["part"]).view(VEHICLE_PART).reshape(-1)

    @property
    def traffic_light_parts(self) -> np.ndarray:
        """`TrafficLightPart`s of the traffic lights (state, times, …), by rising id."""
        lights = self.actors[self.actors["kind"] == _KIND["traffic_light"]]
        return np.ascontiguousarray(lights["part"]).view(TRAFFIC_LIGHT_PART).reshape(-1)

    def actor(self, actor_id: int) -> np.void:
        """Returns the record of one actor. Raises `KeyError` if there is none with this id."""
        idx = int(np.searchsorted(self.actors["id"], actor_id))
        if idx == len(self.actors) or self.actors["id"][idx] != actor_id:
            raise KeyError(f"there is no actor {actor_id} at tick {self.tick}")
        return self.actors[idx]


def snapshot(domain: str = "gantry", timeout: float = 2.0) -> Snapshot:
    """Returns the newest snapshot of the world.

    Raises `GantryError` if none arrives within `timeout` seconds, `NoSuchTopicError` without a
    simulator.
    """
    sample = _newest("world/snapshot", domain, "SnapshotHeader", timeout)
    record = np.frombuffer(_bus.header_bytes(sample, "SnapshotHeader"), SNAPSHOT_HEADER, 1)[0]
    header = {name: record[name].item() for name in SNAPSHOT_HEADER.names if not name.startswith("reserved")}
    data = bytes(sample.payload().as_memory_view())
    if header["magic"] != _layout.SNAPSHOT_MAGIC or header["n_actors"] * ACTOR.itemsize != len(data):
        raise FrameFormatError(f"snapshot claims {header['n_actors']} actors in {len(data)} bytes; the publisher is broken")
    return Snapshot(header, np.frombuffer(data, ACTOR))


@dataclass(frozen=True)
class Document:
    """A text of `world/info`, `world/map`, `world/actors` or `world/catalogue`."""

    #: Number of this text among the changes within an epoch, from 1.
    revision: int
    #: Tick from whose end on it holds.
    tick: int
    #: The text: JSON, or OpenDRIVE.
    text: str

    def json(self) -> Any:
        """Parses the text as JSON."""
        return json.loads(self.text)


def document(name: str, domain: str = "gantry", timeout: float = 2.0) -> Document:
    """Returns the newest text of a document: `gantry.document("world/info").json()["map"]`.

    Raises as `snapshot`.
    """
    sample = _newest(name, domain, "DocumentHeader", timeout)
    record = np.frombuffer(_bus.header_bytes(sample, "DocumentHeader"), DOCUMENT_HEADER, 1)[0]
    data = bytes(sample.payload().as_memory_view())
    if record["magic"] != _layout.DOCUMENT_MAGIC or record["payload_bytes"] > len(data):
        raise FrameFormatError(f"document {name!r} breaks its contract; the publisher is broken")
    return Document(record["revision"].item(), record["tick"].item(), data[: record["payload_bytes"].item()].decode())


def _newest(topic: str, domain: str, header: str, timeout: float) -> Any:
    """Returns the newest sample of a topic with history.

    iceoryx2 delivers it in a call of the writer, so this wakes the daemon.
    """
    full = _bus.full_name(topic, domain)
    service = _bus.open_slices(topic, domain, header)
    port = _bus.subscribe(service, full)
    try:
        _bus.wake_daemon(domain)
        deadline, newest = time.monotonic() + timeout, None
        while newest is None:
            sample = _bus.receive(port, full, service.static_config.subscriber_max_borrowed_samples)
            while sample is not None:
                newest = sample
                sample = _bus.receive(port, full, service.static_config.subscriber_max_borrowed_samples)
            if newest is None:
                if time.monotonic() >= deadline:
                    raise GantryError(f"{full!r} sent nothing within {timeout} s; is the simulator running?")
                time.sleep(0.005)
        return newest
    finally:
        port.delete()
