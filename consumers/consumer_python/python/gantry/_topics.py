"""The topics of a domain."""

from __future__ import annotations

from dataclasses import dataclass

from ._domain import resolve
from ._load import native


@dataclass(frozen=True)
class TopicDetails:
    """One topic of a domain."""

    #: Name without the domain.
    name: str
    #: `frame`, `result`, `snapshot`, `document`, `control` or `other`.
    kind: str
    #: Modality of a frame topic, otherwise None.
    modality: str | None
    #: Number of writers.
    publishers: int
    #: Number of readers.
    subscribers: int
    #: Schema version that the topic carries.
    schema: str
    #: Type of a topic of results, otherwise None.
    result: str | None = None
    #: Number of readers that are allowed.
    max_subscribers: int = 0
    #: Longest payload that its writers can send, bytes; 0 without a writer.
    payload_bytes: int = 0


def topics(domain: str | None = None) -> list[TopicDetails]:
    """Lists all topics of the domain, sorted by name.

    Raises `GantryError` if shared memory cannot be used.
    """
    return [
        TopicDetails(name, kind, modality, publishers, subscribers, schema, result, max_subscribers, payload_bytes)
        for name, kind, modality, publishers, subscribers, max_subscribers, payload_bytes, schema, result in native.topics(resolve(domain))
    ]


@dataclass(frozen=True)
class BatchCamera:
    """A camera of a batch, in the order of the batch's images."""

    #: What its own topics are called but for the modality: `ego/left`.
    name: str
    #: Its actor, whose pose the snapshots have; 0 if it is gone.
    sensor_id: int
    #: Focal length and principal point `[fx, fy, cx, cy]`, pixels.
    intrinsics_px: tuple[float, float, float, float]
    #: The lens's distortion as in the header of its own frames; all 0 for a pinhole.
    lens: tuple[float, float, float, float]


def cameras_of(topic: str, domain: str) -> list[BatchCamera]:
    """Lists the cameras of a batch's topic in the order of its images; none for any other topic."""
    from ._world import document

    if not topic.startswith("batch/"):
        return []
    for batch in document("world/info", domain).json().get("batches", []):
        if any(found["topic"] == topic for found in batch["topics"]):
            return [BatchCamera(it["name"], it["sensor_id"], tuple(it["intrinsics_px"]), tuple(it["lens"])) for it in batch["cameras"]]
    return []
