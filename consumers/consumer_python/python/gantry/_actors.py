"""Finding actors by role and type, and spawning them."""

from __future__ import annotations

import fnmatch
import time
from dataclasses import dataclass
from typing import Any, Mapping

from ._command import command
from ._control import Vehicle
from ._domain import resolve
from ._errors import TimedOutError
from ._patience import PATIENCE, appear
from ._pose import Pose
from ._world import Snapshot, document, snapshot

#: Seconds between two looks at the list of actors.
_LOOK_SECS = 0.05


@dataclass(frozen=True)
class Actor:
    """An actor as the simulator lists it; `Snapshot.actor(id)`, `pose` and `speed_mps` say where it is."""

    #: Its id, which is never given again within a run.
    id: int
    #: Its type in the catalogue: `vehicle.tesla.model3`.
    type_id: str
    #: Its role, `ego_vehicle` for instance; may be empty.
    role: str
    #: The actor that it is attached to; None without one.
    parent_id: int | None
    #: Its attributes by name.
    attributes: Mapping[str, str]
    #: Its topics by modality, if it is a sensor.
    topics: Mapping[str, str]


class World:
    """The actors of a simulator, as they were when they were asked for."""

    def __init__(self, actors: list[Actor], newest: Snapshot) -> None:
        #: All actors by rising id.
        self.actors = actors
        #: The world after the newest tick.
        self.snapshot = newest

    def __repr__(self) -> str:
        return f"<gantry.World tick={self.snapshot.tick} {len(self.actors)} actors>"

    def find(self, *, role: str | None = None, type: str | None = None) -> list[Actor]:
        """Returns the actors of a role and a type, both patterns with `*` and `?`, by rising id.

        `world.find(type="vehicle.*")`, `world.find(role="ego_vehicle")`; all without either.
        """
        return [
            actor
            for actor in self.actors
            if (role is None or fnmatch.fnmatchcase(actor.role, role)) and (type is None or fnmatch.fnmatchcase(actor.type_id, type))
        ]


def world(domain: str | None = None, timeout: float = PATIENCE) -> World:
    """Returns the world with its actors by role and type: `gantry.world().find(type="walker.*")`. Raises as `snapshot`."""
    newest = snapshot(domain, timeout)
    listed = document("world/actors", domain, timeout).json()["actors"]
    return World(sorted(map(_actor, listed), key=lambda actor: actor.id), newest)


def _actor(listed: dict[str, Any]) -> Actor:
    topics = {info["modality"]: info["topic"] for info in listed["topics"]}
    return Actor(int(listed["id"]), listed["type_id"], listed["role"], listed["parent_id"] or None, dict(listed["attributes"]), topics)


def ego(domain: str | None = None, timeout: float = PATIENCE, *, role: str = "ego_vehicle") -> Vehicle:
    """Returns the vehicle that carries the launch file's sensors; waits up to `timeout` seconds for it.

    Of several with this `role` it is the first that was spawned. `ego.control(…)` drives it,
    `snapshot.pose(ego)` says where it is. Raises `NoSuchTopicError` without a simulator,
    `TimedOutError` if there is no such vehicle.
    """
    domain = resolve(domain)
    deadline = time.monotonic() + timeout
    while True:
        there = world(domain, max(_LOOK_SECS, deadline - time.monotonic()))
        found = there.find(role=role, type="vehicle.*")
        if found:
            return Vehicle(found[0].id, domain)
        if time.monotonic() >= deadline:
            others = ", ".join(sorted({actor.role for actor in there.find(type="vehicle.*") if actor.role})) or "none"
            raise TimedOutError(f"no vehicle of domain {domain!r} has the role {role!r}; roles of its vehicles: {others}. Pass role=, or gantry.vehicle(ID)")
        time.sleep(_LOOK_SECS)


def spawn(
    type_id: str,
    pose: Pose,
    *,
    parent: int | Any | None = None,
    role: str = "",
    attributes: Mapping[str, str] | None = None,
    domain: str | None = None,
    timeout: float = PATIENCE,
) -> Actor:
    """Spawns an actor of the catalogue at a pose in the world, or on `parent`: its id, or anything with an `id`.

    `gantry.spawn("vehicle.tesla.model3", world_from_ego @ gantry.Pose((20.0, 0.0, 0.3)))`. The next
    snapshot has it. What is returned has the attributes that were asked for. Waits up to `timeout` seconds for a simulator. Raises `NoSuchTopicError` without
    one, `GantryError` with the simulator's sentence if it refuses.
    """
    parent_id = None if parent is None else int(getattr(parent, "id", parent))
    at = {"translation_m": list(map(float, pose.translation_m)), "rotation_xyzw": list(map(float, pose.rotation_xyzw))}
    asked = {"do": "spawn", "type_id": type_id, "pose": at, "parent_id": parent_id, "role": role, "attributes": dict(attributes or {})}
    (reply,) = appear(lambda: command(asked, domain=domain, timeout=timeout), timeout)
    topics = {name.rsplit("/", 1)[-1]: name for name in reply["topics"]}
    return Actor(int(reply["actor_id"]), type_id, role, parent_id, dict(attributes or {}), topics)
