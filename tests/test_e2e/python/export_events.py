"""Compares exports of events and ROS bags with the recording that they come from.

Usage: export_events.py RECORDING DSEC EVT3 BAG: the recording (payloads as they are), and the folders of
the scenario in each export. The recording is read with PyPI's mcap, the exports with h5py, evt3, OpenCV
and rosbags; nothing of Gantry's own is used.
"""

import struct
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import cv2
import evt3
import h5py
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

DVS = np.dtype([("nanos", "<u4"), ("x", "<u2"), ("y", "<u2"), ("id", "<u4"), ("p", "u1"), ("class", "u1"), ("r", "<u2")])
LIDAR = np.dtype([("xyz", "<f4", 3), ("intensity", "<u2"), ("channel", "<u2")])
SEMANTIC_LIDAR = np.dtype([("xyz", "<f4", 3), ("cos", "<f4"), ("id", "<u4"), ("class", "u1"), ("r", "u1"), ("channel", "<u2")])
RADAR = np.dtype([("velocity", "<f4"), ("azimuth", "<f4"), ("altitude", "<f4"), ("depth", "<f4"), ("cos", "<f4"), ("id", "<u4"), ("class", "u1"), ("r", "u1", 7)])


class Frame:
    """A frame of the recording: what its 256 header bytes say, and its payload."""

    def __init__(self, header, payload):
        self.tick, self.sim_nanos, self.seq = struct.unpack_from("<QQQ", header, 16)
        (payload_bytes,) = struct.unpack_from("<Q", header, 48)
        self.width, self.height = struct.unpack_from("<II", header, 56)
        (self.window_nanos,) = struct.unpack_from("<Q", header, 72)
        self.position = np.array(struct.unpack_from("<3d", header, 80))
        self.rotation = np.array(struct.unpack_from("<4d", header, 104))
        self.fx, self.fy, self.cx, self.cy = struct.unpack_from("<4d", header, 136)
        self.payload = payload[:payload_bytes]
        assert len(self.payload) == payload_bytes

    def image(self, kind, *more):
        return np.frombuffer(self.payload, kind).reshape(self.height, self.width, *more)

    def pose(self):
        return matrix(self.position, self.rotation)


def matrix(position, rotation):
    """A 4×4 matrix from a position and a quaternion x, y, z, w."""
    x, y, z, w = rotation
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = position
    return pose


def read_recording(path):
    """Frames by topic and snapshots as (tick, nanos, records), of whole ticks."""
    frames, data, snapshots = defaultdict(list), {}, []
    factory = DecoderFactory()
    with open(path, "rb") as file:
        heads = []
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.encoding != "protobuf":
                continue
            decoded = factory.decoder_for(channel.message_encoding, schema)(message.data)
            if schema.name == "gantry.Frame":
                assert not getattr(decoded, "codec", ""), "the recording must hold payloads as they are"
                heads.append((channel.topic[1:].removesuffix("/gantry"), decoded, message.log_time, message.sequence))
            elif schema.name in ("foxglove.RawImage", "foxglove.PointCloud"):
                data[channel.topic, message.log_time, message.sequence] = decoded.data
            elif schema.name == "gantry.Snapshot":
                snapshots.append((decoded.tick, decoded.sim_nanos, decoded.records))
    for topic, decoded, log_time, sequence in heads:
        payload = decoded.payload
        if decoded.payload_topic:
            payload = data[decoded.payload_topic, log_time, sequence]
        frames[topic].append(Frame(decoded.header, payload))
    return frames, snapshots


def events_of(frames):
    """All events of a camera: time in microseconds, x, y, polarity, class, id."""
    parts = defaultdict(list)
    for frame in frames:
        events = np.frombuffer(frame.payload, DVS)
        parts["t"].append((frame.sim_nanos - frame.window_nanos + events["nanos"].astype(np.int64)) // 1000)
        for name in ("x", "y", "p", "class", "id"):
            parts[name].append(events[name])
    return {name: np.concatenate(values) for name, values in parts.items()}


def same_events(found, wanted, what):
    assert len(found["t"]) == len(wanted["t"]) > 1000, f"{what}: {len(found['t'])} events, not {len(wanted['t'])}"
    for name in ("t", "x", "y", "p"):
        assert np.array_equal(np.asarray(found[name]).astype(np.int64), wanted[name].astype(np.int64)), f"{what}: {name}"


def decoded(path):
    """The events of a RAW file."""
    events = evt3.decode_file(str(path))
    assert (events.sensor_width, events.sensor_height) == (160, 120)
    return {"t": events.t, "x": events.x, "y": events.y, "p": events.p}


def check_evt3(folder, frames):
    for camera in ("left", "right"):
        same_events(decoded(folder / f"{camera}.raw"), events_of(frames[f"ego/{camera}/dvs"]), camera)
        head = (folder / f"{camera}.raw").read_bytes()[:200]
        assert b"% geometry 160x120\n" in head and b"% end\n" in head
    print("evt3 passed")


def check_dsec(folder, frames):
    for side in ("left", "right"):
        wanted = events_of(frames[f"ego/{side}/dvs"])
        with h5py.File(folder / f"events/{side}/events.h5") as file:
            offset = int(file["t_offset"][()])
            events = file["events"]
            assert [str(events[k].dtype) for k in "ptxy"] == ["uint8", "uint32", "uint16", "uint16"]
            t = events["t"][:].astype(np.int64)
            same_events({"t": t + offset, "x": events["x"][:], "y": events["y"][:], "p": events["p"][:]}, wanted, side)
            assert np.array_equal(file["labels/class"][:], wanted["class"])
            assert np.array_equal(file["labels/object_id"][:], wanted["id"])
            index = file["ms_to_idx"][:].astype(np.int64)
            assert len(index) == t[-1] // 1000 + 1
            ms = np.arange(len(index))
            assert np.all(t[index] >= ms * 1000)
            later = index > 0
            assert np.all(t[index[later] - 1] < ms[later] * 1000)
        with h5py.File(folder / f"events/{side}/rectify_map.h5") as file:
            rectify = file["rectify_map"][:]
            assert rectify.shape == (120, 160, 2) and tuple(rectify[7, 5]) == (5.0, 7.0)
        images = sorted((folder / f"images/{side}/rectified").glob("*.png"))
        rgb = frames[f"ego/{side}/rgb"]
        assert len(images) == len(rgb)
        for path, frame in zip(images, rgb):
            assert np.array_equal(cv2.imread(str(path)), frame.image("u1", 4)[:, :, :3]), path
    times = np.loadtxt(folder / "images/timestamps.txt", dtype=np.int64)
    assert list(times) == [frame.sim_nanos // 1000 for frame in frames["ego/left/rgb"]]
    check_semantic(folder, frames)
    check_flow(folder, frames)
    check_disparity(folder, frames)
    print("dsec passed")


def check_semantic(folder, frames):
    semantic = frames["ego/left/semantic"]
    for name, road, sky, car in (("19classes", 0, 10, 13), ("11classes", 5, 0, 8)):
        paths = sorted((folder / f"semantic/{name}").glob("*.png"))
        assert len(paths) == len(semantic)
        for path, frame in zip(paths, semantic):
            found, wanted = cv2.imread(str(path), cv2.IMREAD_UNCHANGED), frame.image("u1")
            for label, number in ((road, 1), (sky, 11), (car, 14)):
                assert np.all(found[wanted == number] == label), (path, number)
        assert np.any(found == road)


def check_flow(folder, frames):
    flows = [frame for frame in frames["ego/left/flow"] if frame.window_nanos][-len(list((folder / "flow/backward").glob("*.png"))):]
    depths = {frame.tick: frame.image("<f4") for frame in frames["ego/left/depth"]}
    times = np.loadtxt(folder / "flow/backward_timestamps.txt", delimiter=",", dtype=np.int64)
    assert len(flows) == len(times) >= len(frames["ego/left/flow"]) - 1
    n_moving = 0
    for n, frame in enumerate(flows):
        assert tuple(times[n]) == (frame.sim_nanos // 1000, (frame.sim_nanos - frame.window_nanos) // 1000)
        flow = frame.image("<f4", 2)
        # OpenCV turns the order of the channels round.
        backward = cv2.imread(str(folder / f"flow/backward/{n:06}.png"), cv2.IMREAD_UNCHANGED)[:, :, ::-1]
        fits = np.all(np.abs(flow) < 255, axis=2)
        decoded = (backward[:, :, :2].astype(np.float64) - 2**15) / 128
        assert np.all(backward[fits][:, 2] == 1)
        assert np.max(np.abs(decoded + flow)[fits]) <= 1 / 256 + 1e-6
        forward = cv2.imread(str(folder / f"flow/forward/{n:06}.png"), cv2.IMREAD_UNCHANGED)[:, :, ::-1]
        rows, columns = np.mgrid[:120, :160]
        from_x = np.rint(columns - flow[:, :, 0]).astype(int)
        from_y = np.rint(rows - flow[:, :, 1]).astype(int)
        inside = (from_x >= 0) & (from_x < 160) & (from_y >= 0) & (from_y < 120)
        nearest = np.full((120, 160), np.inf)
        np.minimum.at(nearest, (from_y[inside], from_x[inside]), np.minimum(depths[frame.tick], 1e30)[inside])
        known = forward[:, :, 2] == 1
        # Halves of a pixel may be rounded either way.
        assert np.mean(known == np.isfinite(nearest)) > 0.98
        n_moving += int(np.sum(np.abs(decoded) > 0.5))
    assert n_moving > 1000, "something moves"


def check_disparity(folder, frames):
    """A point of the left image lies in the right one as far to the left as the disparity says."""
    paths = sorted((folder / "disparity/event").glob("*.png"))
    left, right = frames["ego/left/depth"], {frame.tick: frame.image("<f4") for frame in frames["ego/right/depth"]}
    assert len(paths) == len(left)
    for path, frame in zip(paths, left):
        disparity = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float64) / 256
        depth = frame.image("<f4")
        known = (disparity > 0) & np.isfinite(depth) & (depth < 60)
        assert np.max(np.abs(disparity - frame.fx * 0.5 / depth)[known]) < 1 / 256
        rows, columns = np.nonzero(known)
        to = np.rint(columns - disparity[known]).astype(int)
        inside = to >= 0
        other = right[frame.tick][rows[inside], to[inside]]
        # What one camera sees and the other does not is nearer or farther.
        near = np.abs(other - depth[known][inside]) < 0.05 * depth[known][inside] + 0.1
        assert np.mean(near) > 0.85, f"{path}: {np.mean(near)}"


def seconds(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def check_bag(folder, frames, snapshots):
    messages = defaultdict(list)
    with AnyReader([folder]) as reader:
        for connection, nanos, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            messages[connection.topic].append((nanos, message))
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts == {topic: len(found) for topic, found in messages.items()}, "metadata.yaml counts right"
    check_images(messages, frames)
    check_clouds(messages, frames)
    check_motion(messages, frames, snapshots)
    check_transforms(messages, frames)
    packets = [bytes(message.events) for _, message in messages["/ego/left/dvs/events"]]
    assert {message.encoding for _, message in messages["/ego/left/dvs/events"]} == {"evt3"}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "joined.raw"
        path.write_bytes(b"% evt 3.0\n% format EVT3;height=120;width=160\n% geometry 160x120\n% end\n" + b"".join(packets))
        same_events(decoded(path), events_of(frames["ego/left/dvs"]), "packets")
    print("bag passed")


def check_images(messages, frames):
    kinds = {"rgb": ("bgra8", "u1"), "depth": ("32FC1", "<f4"), "semantic": ("mono8", "u1"), "instance": ("32SC1", "<u4"), "flow": ("32FC2", "<f4")}
    for name, (encoding, _) in kinds.items():
        found = messages[f"/ego/left/{name}/image_raw"]
        infos = messages[f"/ego/left/{name}/camera_info"]
        wanted = frames[f"ego/left/{name}"]
        assert len(found) == len(infos) == len(wanted) > 10, name
        for (nanos, image), (_, info), frame in zip(found, infos, wanted):
            assert nanos == frame.sim_nanos == seconds(image.header.stamp) == seconds(info.header.stamp)
            assert (image.encoding, image.width, image.height, image.is_bigendian) == (encoding, 160, 120, 0)
            assert image.step * image.height == len(image.data) and image.header.frame_id == "ego/left_optical"
            assert bytes(image.data) == bytes(frame.payload), (name, frame.tick)
            assert np.allclose(info.k.reshape(3, 3), [[frame.fx, 0, frame.cx - 0.5], [0, frame.fy, frame.cy - 0.5], [0, 0, 1]])
            assert (info.width, info.height, info.p[3]) == (160, 120, 0)
    normals = messages["/ego/left/normals/image_raw"]
    for (_, image), frame in zip(normals, frames["ego/left/normals"]):
        found = np.frombuffer(image.data, "<f4").reshape(120, 160, 3)
        assert image.encoding == "32FC3"
        assert np.array_equal(found, frame.image("<f2", 4)[:, :, :3].astype("<f4"))


def points_of(cloud):
    names = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4"}
    kind = np.dtype({
        "names": [field.name for field in cloud.fields],
        "formats": [names[field.datatype] for field in cloud.fields],
        "offsets": [field.offset for field in cloud.fields],
        "itemsize": cloud.point_step,
    })
    assert cloud.row_step == cloud.point_step * cloud.width == len(cloud.data)
    return np.frombuffer(cloud.data, kind)


def check_clouds(messages, frames):
    for (_, cloud), frame in zip(messages["/ego/roof/points"], frames["ego/roof/lidar"], strict=True):
        points, wanted = points_of(cloud), np.frombuffer(frame.payload, LIDAR)
        assert np.array_equal(np.stack([points["x"], points["y"], points["z"]], 1), wanted["xyz"])
        assert np.array_equal(points["ring"], wanted["channel"])
        assert np.allclose(points["intensity"], wanted["intensity"] / 65535)
        assert len(points) > 100 and cloud.header.frame_id == "ego/roof"
    for (_, cloud), frame in zip(messages["/ego/labels/semantic_points"], frames["ego/labels/semantic_lidar"], strict=True):
        points, wanted = points_of(cloud), np.frombuffer(frame.payload, SEMANTIC_LIDAR)
        assert np.array_equal(points["object_id"], wanted["id"]) and np.array_equal(points["class"], wanted["class"])
        assert np.array_equal(points["cos_incidence"], wanted["cos"]) and np.array_equal(points["z"], wanted["xyz"][:, 2])
    for (_, cloud), frame in zip(messages["/ego/radar/detections"], frames["ego/radar/radar"], strict=True):
        points, wanted = points_of(cloud), np.frombuffer(frame.payload, RADAR)
        assert np.array_equal(points["velocity"], wanted["velocity"]) and np.array_equal(points["range"], wanted["depth"])
        assert np.allclose(np.hypot(np.hypot(points["x"], points["y"]), points["z"]), wanted["depth"], rtol=1e-5)
        assert np.allclose(np.arctan2(points["y"], points["x"]), wanted["azimuth"], atol=1e-5)


def check_motion(messages, frames, snapshots):
    for (_, imu), frame in zip(messages["/ego/imu/data"], frames["ego/imu/imu"], strict=True):
        force, turn = struct.unpack_from("<3d", frame.payload), struct.unpack_from("<3d", frame.payload, 24)
        found = imu.linear_acceleration, imu.angular_velocity
        assert [(v.x, v.y, v.z) for v in found] == [force, turn]
        q = imu.orientation
        assert np.allclose([q.x, q.y, q.z, q.w], frame.rotation)
    for (_, fix), frame in zip(messages["/ego/gnss/fix"], frames["ego/gnss/gnss"], strict=True):
        assert (fix.latitude, fix.longitude, fix.altitude) == struct.unpack_from("<3d", frame.payload)
    [(_, parked)] = messages["/world/scenery"]
    assert len(parked.detections) > 50 and all(int(car.id) >> 31 for car in parked.detections)
    assert {car.results[0].hypothesis.class_id for car in parked.detections} == {"Car"}
    assert all(3 < car.bbox.size.x < 8 and 1.4 < car.bbox.size.y < 2.6 for car in parked.detections)
    assert [seconds(clock.clock) for _, clock in messages["/clock"]] == [nanos for _, nanos, _ in snapshots]
    for (nanos, odom), (_, objects), (_, when, records) in zip(messages["/ego/odom"], messages["/world/objects"], snapshots, strict=True):
        assert nanos == when and odom.child_frame_id == "ego/base_link"
        boxes = {detection.id: detection for detection in objects.detections}
        by_id = {}
        for at in range(0, len(records), 256):
            actor_id, _, _, kind, _ = struct.unpack_from("<IIIHB", records, at)
            half = struct.unpack_from("<3f", records, at + 144)
            pose = struct.unpack_from("<7d", records, at + 16)
            velocity = struct.unpack_from("<3d", records, at + 72)
            if kind == 1:
                by_id[actor_id] = pose, velocity
            if kind in (1, 2):
                size = boxes[str(actor_id)].bbox.size
                assert np.allclose([size.x, size.y, size.z], 2 * np.array(half))
                centre = boxes[str(actor_id)].bbox.center.position
                assert np.linalg.norm(np.array([centre.x, centre.y, centre.z]) - pose[:3]) < 5
        # The ego is the first vehicle that is spawned.
        pose, velocity = by_id[min(by_id)]
        at = odom.pose.pose.position
        assert (at.x, at.y, at.z) == pose[:3]
        linear = odom.twist.twist.linear
        world = matrix(pose[:3], pose[3:])[:3, :3] @ [linear.x, linear.y, linear.z]
        assert np.allclose(world, velocity, atol=1e-9)


def check_transforms(messages, frames):
    fixed = {}
    for _, message in messages["/tf_static"]:
        for it in message.transforms:
            fixed[it.child_frame_id] = it.header.frame_id, pose_of(it.transform)
    moving = defaultdict(dict)
    for nanos, message in messages["/tf"]:
        for it in message.transforms:
            assert seconds(it.header.stamp) == nanos
            moving[nanos][it.child_frame_id] = it.header.frame_id, pose_of(it.transform)
    sensor_from_camera = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    for topic, leaf in (("ego/left/rgb", "ego/left_optical"), ("ego/roof/lidar", "ego/roof"), ("ego/imu/imu", "ego/imu")):
        for frame in frames[topic]:
            pose, name = np.eye(4), leaf
            while name != "map":
                parent, step = {**moving[frame.sim_nanos], **fixed}[name]
                pose, name = step @ pose, parent
            wanted = frame.pose()
            if leaf.endswith("optical"):
                wanted = wanted @ sensor_from_camera
            assert np.allclose(pose, wanted, atol=1e-6), (topic, frame.tick)


def pose_of(transform):
    t, q = transform.translation, transform.rotation
    return matrix([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])


def main():
    recording, dsec, evt3, bag = map(Path, sys.argv[1:5])
    frames, snapshots = read_recording(recording)
    check_evt3(evt3, frames)
    check_dsec(dsec, frames)
    check_bag(bag, frames, snapshots)


if __name__ == "__main__":
    main()
