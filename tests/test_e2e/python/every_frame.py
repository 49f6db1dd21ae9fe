"""Reads every kind of frame of a running simulator in place; `python every_frame.py DOMAIN`. The simulator has the rig of the tests.

Run by `tests/it/python.rs` in a sandbox. Ends with 1 and a traceback if a promise is broken.
"""

import re
import sys

import gantry
import numpy as np

DOMAIN = sys.argv[1]
PATIENCE_SECS = 60.0
WIDTH, HEIGHT = 96, 64
# Topic -> shape of the array (None: as long as the frame says), type of an element or of its parts.
FRAMES = {
    "ego/front/rgb": ((HEIGHT, WIDTH, 4), "u1"),
    "ego/front/depth": ((HEIGHT, WIDTH), "f4"),
    "ego/front/semantic": ((HEIGHT, WIDTH), "u1"),
    "ego/front/instance": ((HEIGHT, WIDTH), "u4"),
    "ego/front/flow": ((HEIGHT, WIDTH, 2), "f4"),
    "ego/front/normals": ((HEIGHT, WIDTH, 4), "f2"),
    "ego/front/dvs": (None, gantry.DVS_EVENT),
    "ego/roof/lidar": (None, gantry.LIDAR_POINT),
    "ego/labels/semantic_lidar": (None, gantry.SEMANTIC_LIDAR_POINT),
    "ego/imu/imu": ((1,), gantry.IMU_SAMPLE),
    "ego/gnss/gnss": ((1,), gantry.GNSS_SAMPLE),
}


def mapped_files(address, n_bytes):
    """Files whose read-only mapping into this process holds the bytes."""
    found = []
    with open("/proc/self/maps") as maps:
        for line in maps:
            span, rights, *rest = line.split()
            first, last = (int(part, 16) for part in span.split("-"))
            if first <= address and address + n_bytes <= last:
                found.append((rights, rest[-1]))
    return found


def check_in_place(frame):
    """The array shows shared memory itself: no copy was made and none can be changed."""
    array = frame.array
    assert not array.flags.owndata and not array.flags.writeable, array.flags
    address = array.__array_interface__["data"][0]
    maps = mapped_files(address, array.nbytes)
    assert len(maps) == 1 and "/dev/shm/" in maps[0][1], (frame, maps)
    assert maps[0][0].startswith("r-"), (frame, maps)
    try:
        array.flags.writeable = True
    except ValueError:
        pass
    else:
        raise AssertionError(f"{frame} can be made writeable")


def read_with_content(topic):
    """The next frame that is not empty: events come only when something moves."""
    for _ in range(200):
        frame = topic.next(timeout=PATIENCE_SECS)
        assert frame is not None, f"{topic} sent nothing"
        if len(frame):
            return frame
        del frame
    raise AssertionError(f"{topic} sent only empty frames")


def check_every_kind():
    """Opens each topic and looks at one frame."""
    listed = {topic.name: topic.modality for topic in gantry.topics(DOMAIN) if topic.modality}
    # The window of people, which every simulator has.
    assert listed.pop("spectator/rgb") == "rgb"
    assert set(listed) == set(FRAMES), listed
    for name, (shape, dtype) in FRAMES.items():
        with gantry.open(name, domain=DOMAIN, timeout=PATIENCE_SECS) as topic:
            frame = read_with_content(topic)
            header, array = frame.header, frame.array
            assert frame.modality == name.rsplit("/", 1)[-1] == listed[name]
            assert array.shape == (shape or (header.width,)), (name, array.shape)
            assert array.dtype == np.dtype(dtype), (name, array.dtype)
            assert header.cpu_copies == 0 and header.seq >= 1 and header.published_mono_nanos >= header.rendered_mono_nanos > 0
            check_in_place(frame)
            check_content(name, frame)
            print(f"{name}: tick {frame.tick}, {array.nbytes} bytes in place")
            del frame, array


def check_content(name, frame):
    """What the numbers must be wherever the car is."""
    array, kind = frame.array, name.rsplit("/", 1)[-1]
    if kind == "rgb":
        assert frame.rgb.shape == (HEIGHT, WIDTH, 3) and (array[..., 3] == 255).all() and np.ptp(frame.rgb) > 50
    elif kind == "depth":
        assert (array > 0.09).all() and np.isfinite(array).any()
    elif kind == "semantic":
        assert set(np.unique(array)) <= set(range(len(gantry.CLASS_NAMES))) and len(np.unique(array)) > 3
    elif kind == "instance":
        assert len(np.unique(array)) > 3
    elif kind == "flow":
        assert np.isfinite(array).all()
    elif kind == "normals":
        lengths = np.linalg.norm(array[..., :3].astype(np.float32), axis=2)
        assert (np.isclose(lengths, 1.0, atol=0.01) | (lengths == 0.0)).all()
    elif kind == "dvs":
        assert (array["x_px"] < WIDTH).all() and (array["y_px"] < HEIGHT).all()
    elif kind in ("lidar", "semantic_lidar"):
        ranges_m = np.linalg.norm(array["hit_in_sensor_m"], axis=1)
        assert (ranges_m > 0.0).all() and (ranges_m <= 1.01 * frame.header.range_limit_m).all()
    elif kind == "imu":
        assert 5.0 < np.linalg.norm(array["specific_force_mps2"][0]) < 20.0
    elif kind == "gnss":
        # The map's reference, from which no street of this town is more than a kilometre away.
        text = gantry.document("world/map", DOMAIN, timeout=PATIENCE_SECS).text
        latitude, longitude = (float(re.search(rf"\+{name}_0=(-?[\d.]+)", text).group(1)) for name in ("lat", "lon"))
        assert abs(float(array["latitude_deg"][0]) - latitude) < 0.02, (array, latitude)
        assert abs(float(array["longitude_deg"][0]) - longitude) < 0.02, (array, longitude)


def check_sync():
    """Frames of one tick, of sensors with different rates."""
    names = ["ego/front/rgb", "ego/front/dvs", "ego/roof/lidar", "ego/imu/imu"]
    with gantry.sync(names, domain=DOMAIN, timeout=PATIENCE_SECS) as rows:
        ticks = []
        for _ in range(5):
            row = rows.next(timeout=PATIENCE_SECS)
            assert row is not None and {row[name].tick for name in names} == {row.tick}
            assert len({row[name].header.sim_nanos for name in names}) == 1
            ticks.append(row.tick)
            del row
    assert all(later > earlier and (later - earlier) % 2 == 0 for earlier, later in zip(ticks, ticks[1:])), ticks


def check_world():
    """Snapshot, documents and commands."""
    snapshot = gantry.snapshot(DOMAIN, timeout=PATIENCE_SECS)
    assert len(snapshot.vehicles) == 5 and len(snapshot.vehicle_parts) == 5 and len(snapshot.traffic_light_parts) > 0
    info = gantry.document("world/info", DOMAIN, timeout=PATIENCE_SECS).json()
    assert info["map"].endswith("Town10HD") and info["seed"] == 7, info
    assert gantry.document("world/map", DOMAIN, timeout=PATIENCE_SECS).text.lstrip().startswith("<?xml")
    actors = gantry.document("world/actors", DOMAIN, timeout=PATIENCE_SECS).json()["actors"]
    ego = [actor for actor in actors if actor["role"] == "ego_vehicle"]
    assert len(ego) == 1 and snapshot.actor(ego[0]["id"])["id"] == ego[0]["id"]
    assert gantry.document("world/catalogue", DOMAIN, timeout=PATIENCE_SECS).json()
    assert gantry.command({"do": "ping"}, domain=DOMAIN, timeout=PATIENCE_SECS)[0]["is"] == "pong"


def sentence_of(error, action):
    """The message of the error that `action` must raise."""
    try:
        action()
    except error as caught:
        return str(caught)
    raise AssertionError(f"no {error.__name__}")


def check_sentences():
    """What goes wrong is told in a sentence."""
    text = sentence_of(gantry.NoSuchTopicError, lambda: gantry.open("ego/rear/rgb", domain=DOMAIN, timeout=0))
    assert "there is no topic" in text and "ego/front/rgb" in text, text
    text = sentence_of(gantry.NoSuchTopicError, lambda: gantry.open("ego/front/rgb", domain="nobody-here", timeout=0))
    assert 'nothing runs on domain "nobody-here"' in text, text
    text = sentence_of(gantry.GantryError, lambda: gantry.command({"do": "destroy", "actor_id": 999999}, domain=DOMAIN))
    assert "999999" in text, text
    held = []
    with gantry.open("ego/front/depth", domain=DOMAIN) as depth:
        text = sentence_of(gantry.BorrowLimitError, lambda: held.extend(depth.next(timeout=PATIENCE_SECS) for _ in range(9)))
        assert "already holds 3 (limit 3)" in text and "frame.copy()" in text, text
        kept = held[0].array[5:, 7:]
        before = kept.copy()
        held.clear()
        for _ in range(6):
            assert depth.next(timeout=PATIENCE_SECS) is not None, "after dropping what was held reading goes on"
        assert np.array_equal(kept, before), "a slice keeps its frame's memory"


for check in (check_every_kind, check_sync, check_world, check_sentences):
    check()
    print(f"{check.__name__} passed")
