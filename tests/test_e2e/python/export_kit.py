"""What the checks of exported sets share: the recording, read with PyPI's mcap alone, and geometry."""

import json

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

TICK, SIM_NANOS, WIDTH, HEIGHT, STRIDE = 16, 24, 56, 60, 64
SEMANTIC_POINT = np.dtype([("hit", "<f4", 3), ("cos", "<f4"), ("id", "<u4"), ("class", "u1"), ("_", "u1"), ("channel", "<u2")])
KINDS = {"semantic": np.uint8, "instance": np.uint32, "depth": np.float32, "semantic_lidar": SEMANTIC_POINT}


def number(header, at, size):
    return int.from_bytes(header[at : at + size], "little")


class Recording:
    """Frames of some topics by tick, whole."""

    def __init__(self, path, topics):
        self.frames = {topic: {} for topic in topics}
        self.actors = {}
        self.scenery = {}
        own = {f"/{topic}/gantry": topic for topic in topics}
        shown = {f"/{topic}": topic for topic in topics}
        waiting = {}
        with open(path, "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for attachment in reader.iter_attachments():
                if attachment.name.startswith("scenery."):
                    found = json.loads(attachment.data)
                    assert found["complete"] and attachment.name == f"scenery.{found['tick']}.json"
                    self.scenery |= {thing["id"]: thing for thing in found["objects"]}
            wanted = [*own, *shown, "/world/actors"]
            for _, channel, message, decoded in reader.iter_decoded_messages(topics=wanted):
                if channel.topic == "/world/actors":
                    for actor in json.loads(decoded.text)["actors"]:
                        self.actors[actor["id"]] = actor
                elif channel.topic in own:
                    payload = decoded.payload or waiting.pop((own[channel.topic], message.log_time), b"")
                    if payload:
                        self.add(own[channel.topic], decoded.header, payload)
                    else:
                        waiting[own[channel.topic], message.log_time] = decoded.header
                elif hasattr(decoded, "data"):
                    key = shown[channel.topic], message.log_time
                    header = waiting.pop(key, None)
                    if header is None:
                        waiting[key] = decoded.data
                    else:
                        self.add(key[0], header, decoded.data)

    def add(self, topic, header, payload):
        kind = KINDS[topic.rsplit("/", 1)[1]]
        values = np.frombuffer(payload, kind)
        if number(header, HEIGHT, 4) > 1:
            values = values.reshape(number(header, HEIGHT, 4), number(header, WIDTH, 4))
        self.frames[topic][number(header, TICK, 8)] = values

    def ticks(self, *topics):
        """Ticks that have a frame of each of these topics."""
        return sorted(set.intersection(*(set(self.frames[topic]) for topic in topics)))


def inner(ids, reach=2):
    """Pixels whose surroundings all show the same."""
    same = np.ones(ids.shape, bool)
    for axis in (0, 1):
        for step in range(-reach, reach + 1):
            same &= np.roll(ids, step, axis) == ids
    same[:reach], same[-reach:], same[:, :reach], same[:, -reach:] = False, False, False, False
    return same


def project(points, matrix):
    """Pixel coordinates (from the middle of the first pixel) and depths of points (n × 3)."""
    at = matrix @ np.c_[points, np.ones(len(points))].T
    with np.errstate(divide="ignore", invalid="ignore"):
        return (at[:2] / at[2]).T, at[2]


def agreement(uv, depth, values, image, is_inner):
    """How many points lie on inner pixels, and the share of them whose value is the image's."""
    height, width = image.shape
    column, row = np.round(uv[:, 0]), np.round(uv[:, 1])
    seen = (depth > 0.2) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row = column[seen].astype(int), row[seen].astype(int)
    kept = is_inner[row, column]
    equal = values[seen][kept] == image[row[kept], column[kept]]
    return int(kept.sum()), float(equal.mean()) if kept.any() else 1.0


def outside_hull(corners, points):
    """How far points (n × 2) lie outside of the convex hull of corners, pixels; 0 inside."""
    from scipy.spatial import ConvexHull

    equations = ConvexHull(corners).equations
    return np.maximum((points @ equations[:, :2].T + equations[:, 2]).max(axis=1), 0.0)
