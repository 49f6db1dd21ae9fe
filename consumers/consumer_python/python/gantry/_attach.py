"""Finding the frames of a sensor that a CARLA client spawned."""

from __future__ import annotations

import time
from typing import Any

from ._domain import resolve
from ._errors import GantryError, NoSuchTopicError
from ._frame import Frame
from ._patience import PATIENCE
from ._topic import Topic, open as open_topic
from ._world import document

#: Seconds between two looks at the list of actors.
_LOOK_SECS = 0.01
#: Seconds that a list which is there may take to come, also at the end of the time.
_ANSWER_SECS = 2.0


def attach(sensor: int | Any, modality: str | None = None, domain: str | None = None, timeout: float = PATIENCE) -> Topic[Frame]:
    """Opens the frames of a sensor: of a `carla.Sensor`, or of the actor with this id.

    The frames are those that `sensor.listen()` would receive, but in Gantry's axes and encodings
    (metres as floats, classes as bytes) and without a copy; `listen()` need not be called.
    `modality` selects one of several modalities; the default is the first.
    Waits up to `timeout` seconds for the simulator to list the actor. Raises `NoSuchTopicError` if
    it does not, `GantryError` for an actor without frames or without this modality.
    """
    domain = resolve(domain)
    actor_id = int(getattr(sensor, "id", sensor))
    deadline = time.monotonic() + timeout
    while True:
        actor = _listed(actor_id, domain, max(_ANSWER_SECS, deadline - time.monotonic()))
        if actor is not None:
            topics = {info["modality"]: info["topic"] for info in actor["topics"]}
            return open_topic(_chosen(actor, topics, modality), domain, max(0.0, deadline - time.monotonic()))
        if time.monotonic() >= deadline:
            raise NoSuchTopicError(f"there is no actor {actor_id} on domain {domain!r}; it may have been destroyed, or runs elsewhere: pass domain=")
        time.sleep(_LOOK_SECS)


def _listed(actor_id: int, domain: str, timeout: float) -> dict[str, Any] | None:
    actors: list[dict[str, Any]] = document("world/actors", domain, timeout).json()["actors"]
    return next((actor for actor in actors if actor["id"] == actor_id), None)


def _chosen(actor: dict[str, Any], topics: dict[str, str], modality: str | None) -> str:
    if not topics:
        raise GantryError(f"actor {actor['id']} ({actor['type_id']}) has no frames; attach to a sensor")
    if modality is None:
        return next(iter(topics.values()))
    if modality not in topics:
        raise GantryError(f"actor {actor['id']} ({actor['type_id']}) has no {modality!r}; it has {', '.join(topics)}")
    return topics[modality]
