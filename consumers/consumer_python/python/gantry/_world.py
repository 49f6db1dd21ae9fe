"""Reading the world: snapshots and documents."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _layout
from ._dtypes import ACTOR, SNAPSHOT_HEADER, TRAFFIC_LIGHT_PART, VEHICLE_PART
from ._domain import resolve
from ._errors import TimedOutError
from ._load import native
from ._patience import PATIENCE, appear
from ._pose import Pose

_KIND = {name: number for number, name in _layout.ACTOR_KINDS.items()}


@dataclass(frozen=True)
class Snapshot:
    """The world after one tick, copied out of shared memory."""

    #: Fields of `GantrySnapshotHeader` by name.
    header: dict[str, Any]
    #: Structured array (n,), one `ActorRecord` per actor by rising id; SPEC.md §5 has its fields.
    actors: npt.NDArray[Any]

    @property
    def tick(self) -> int:
        """Tick this snapshot shows."""
        return int(self.header["tick"])

    @property
    def epoch(self) -> int:
        """Random number of the simulator's start: another one means that it was restarted."""
        return int(self.header["epoch"])

    @property
    def sim_time(self) -> float:
        """Simulated time, seconds."""
        return int(self.header["sim_nanos"]) * 1e-9

    @property
    def vehicles(self) -> npt.NDArray[Any]:
        """Records of the vehicles, by rising id."""
        vehicles: npt.NDArray[Any] = self.actors[self.actors["kind"] == _KIND["vehicle"]]
        return vehicles

    @property
    def vehicle_parts(self) -> npt.NDArray[Any]:
        """`VehiclePart`s of `vehicles` (control, gear, lamps, …), in the same order."""
        return np.ascontiguousarray(self.vehicles["part"]).view(VEHICLE_PART).reshape(-1)

    @property
    def traffic_light_parts(self) -> npt.NDArray[Any]:
        """`TrafficLightPart`s of the traffic lights (state, times, …), by rising id."""
        lights = self.actors[self.actors["kind"] == _KIND["traffic_light"]]
        return np.ascontiguousarray(lights["part"]).view(TRAFFIC_LIGHT_PART).reshape(-1)

    def actor(self, actor_id: int) -> np.void:
        """Returns the record of one actor. Raises `KeyError` if there is none with this id."""
        idx = int(np.searchsorted(self.actors["id"], actor_id))
        if idx == len(self.actors) or self.actors["id"][idx] != actor_id:
            raise KeyError(f"there is no actor {actor_id} at tick {self.tick}")
        record: np.void = self.actors[idx]
        return record


    def pose(self, actor: int | Any) -> Pose:
        """Returns the pose world_from_actor of an actor: its id, or anything with an `id`. Raises as `actor`."""
        return Pose.of(self.actor(int(getattr(actor, "id", actor)))["world_from_actor"])

    def speed_mps(self, actor: int | Any) -> float:
        """Returns the speed of an actor, whatever its direction. Raises as `actor`."""
        return float(np.linalg.norm(self.actor(int(getattr(actor, "id", actor)))["velocity_in_world_mps"]))


def parse_snapshot(header: bytes, records: bytes) -> Snapshot:
    """Makes a snapshot of its bytes, which the native half has checked."""
    record = np.frombuffer(header, SNAPSHOT_HEADER, 1)[0]
    names = SNAPSHOT_HEADER.names or ()
    return Snapshot({name: record[name].item() for name in names if not name.startswith("reserved")}, np.frombuffer(records, ACTOR))


def snapshot(domain: str | None = None, timeout: float = PATIENCE) -> Snapshot:
    """Returns the newest snapshot of the world; waits up to `timeout` seconds for a simulator and its first.

    Raises `NoSuchTopicError` if there is none by then, `TimedOutError` if it sends nothing.
    """
    domain = resolve(domain)
    return parse_snapshot(*appear(lambda: native.snapshot(domain, timeout), timeout))


_trails: dict[str, native.Snapshots] = {}
_lock = threading.Lock()


def snapshot_at(tick: int, domain: str | None = None, timeout: float = PATIENCE) -> Snapshot:
    """Returns the world at exactly this tick, for example that of a frame; waits for it.

    The first call begins to follow the snapshots of the domain, and the last 32 are kept: call it
    while the tick is new, or use `sync(..., snapshots=True)`. Raises `GantryError` if the tick is
    gone, `TimedOutError` if it does not come within `timeout` seconds, `NoSuchTopicError` without a
    simulator.
    """
    domain = resolve(domain)
    trail = _trails.get(domain)
    if trail is None:
        made = appear(lambda: native.Snapshots(domain), timeout)
        with _lock:
            trail = _trails.setdefault(domain, made)
    found = trail.at(tick, None, timeout)
    if found is None:
        raise TimedOutError(f"the snapshot of tick {tick} did not come within {timeout} s; is the simulator running?")
    return parse_snapshot(*found)


def forget(domain: str) -> None:
    """Stops following the snapshots of a domain that is left."""
    with _lock:
        trail = _trails.pop(domain, None)
    if trail is not None:
        trail.close()


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


def document(name: str, domain: str | None = None, timeout: float = PATIENCE) -> Document:
    """Returns the newest text of a document: `gantry.document("world/info").json()["map"]`.

    Raises as `snapshot`.
    """
    domain = resolve(domain)
    revision, tick, _, text = appear(lambda: native.document(domain, name, timeout), timeout)
    return Document(revision, tick, text)
