"""A node of ROS 2 as far as its wire goes: zenoh's own client with the CDR types of rosbags, which shares no code with the bridge.

Usage: bridge_ros2.py PORT look|drive

look: says what the graph has, subscribes, says "ready", and prints every message as a line of JSON until it is ended.
drive: drives with ackermann_cmd until the odometry says 1.5 m/s, then brakes with vehicle_control_cmd until it says 0.2.
"""

import json
import struct
import sys
import threading
import time

import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

OWN = {
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
    "carla_msgs/msg/CarlaEgoVehicleControl": "std_msgs/Header header\nfloat32 throttle\nfloat32 steer\nfloat32 brake\nbool hand_brake\nbool reverse\nint32 gear\nbool manual_gear_shift\n",
    "carla_msgs/msg/CarlaEgoVehicleStatus": "std_msgs/Header header\nfloat32 velocity\ngeometry_msgs/Accel acceleration\ngeometry_msgs/Quaternion orientation\ncarla_msgs/CarlaEgoVehicleControl control\n",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y\n",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox2D bbox\nstring id\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}
LOOK_AT = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/carla/ego/odometry": "nav_msgs/msg/Odometry",
    "/carla/ego/vehicle_status": "carla_msgs/msg/CarlaEgoVehicleStatus",
    "/carla/ego/front/image": "sensor_msgs/msg/Image",
    "/carla/ego/front/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/carla/ego/front/camera_info": "sensor_msgs/msg/CameraInfo",
    "/carla/ego/front/depth/image": "sensor_msgs/msg/Image",
    "/carla/ego/front/semantic/image": "sensor_msgs/msg/Image",
    "/carla/ego/roof": "sensor_msgs/msg/PointCloud2",
    "/carla/ego/imu": "sensor_msgs/msg/Imu",
    "/carla/ego/gnss": "sensor_msgs/msg/NavSatFix",
    "/carla/detector/boxes": "vision_msgs/msg/Detection2DArray",
}

saying = threading.Lock()
types = get_typestore(Stores.ROS2_JAZZY)
types.register({name: of for key, text in OWN.items() for name, of in get_types_from_msg(text, key).items()})


def dds(name):
    package, _, last = name.split("/")
    return f"{package}::msg::dds_::{last}_"


def key(topic, name):
    return f"0/{topic.strip('/')}/{dds(name)}/{types.hash_rihs01(name)}"


def fnv(data):
    value = 0xCBF29CE484222325
    for byte in bytes(data):
        value = ((value ^ byte) * 0x100000001B3) % (1 << 64)
    return f"{value:016x}"


def plain(value):
    """A message as JSON; long arrays by length and hash."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    if hasattr(value, "dtype"):
        return value.tolist() if value.size <= 64 else {"length": int(value.size), "hash": fnv(value.tobytes())}
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def check_graph(session):
    """Every token has the parts that rmw_zenoh_cpp splits it into, and the hash that its type has."""
    by_wire = {dds(name): name for name in types.fielddefs if name.count("/") == 2}
    topics = set()
    for reply in session.liveliness().get("@ros2_lv/**", timeout=5):
        parts = str(reply.ok.key_expr).split("/")
        assert parts[0] == "@ros2_lv" and parts[1] == "0" and parts[6] == "%" and parts[7] == "%", parts
        if parts[5] == "NN":
            assert len(parts) == 9, parts
            continue
        assert len(parts) == 13 and parts[5] in ("MP", "MS"), parts
        topic, wire, found, quality = parts[9].replace("%", "/"), parts[10], parts[11], parts[12]
        assert found == types.hash_rihs01(by_wire[wire]), (wire, found)
        assert [part.count(",") for part in quality.split(":")] == [0, 0, 1, 1, 1, 2], quality
        topics.add((parts[5], topic))
    return topics


def say(line):
    # Each subscription calls from a thread of its own.
    with saying:
        print(line, flush=True)


def look(session):
    for topic, name in LOOK_AT.items():

        def take(sample, topic=topic, name=name):
            sequence, moment, length = struct.unpack_from("<qqB", bytes(sample.attachment))
            assert length == 16 and len(bytes(sample.attachment)) == 33 and moment > 0
            message = plain(types.deserialize_cdr(bytes(sample.payload), name))
            say(json.dumps({"topic": topic, "sequence": sequence, "message": message}))

        keep.append(session.declare_subscriber(key(topic, name), take))
    say("ready")
    time.sleep(1000)


def drive(session):
    speed, moved = [0.0], threading.Event()

    def take(sample):
        speed[0] = types.deserialize_cdr(bytes(sample.payload), "nav_msgs/msg/Odometry").twist.twist.linear.x
        moved.set()

    keep.append(session.declare_subscriber(key("/carla/ego/odometry", "nav_msgs/msg/Odometry"), take))
    steps = [
        ("ackermann_cmd", "ackermann_msgs/msg/AckermannDrive", lambda T: T[0](0.05, 0.0, 4.0, 0.0, 0.0), lambda v: v > 1.5),
        ("vehicle_control_cmd", "carla_msgs/msg/CarlaEgoVehicleControl", lambda T: T[0](T[1], 0.0, 0.3, 1.0, False, False, 0, False), lambda v: v < 0.2),
    ]
    Header, Time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    for last, name, make, is_done in steps:
        publisher = session.declare_publisher(key(f"/carla/ego/{last}", name))
        message = make((types.types[name], Header(Time(0, 0), "ego")))
        end = time.monotonic() + 110
        while not (moved.is_set() and is_done(speed[0])):
            assert time.monotonic() < end, f"{last}: still {speed[0]} m/s"
            publisher.put(bytes(types.serialize_cdr(message, name)))
            time.sleep(0.05)
        say(f"{last}: {speed[0]:.2f} m/s")


keep = []
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{sys.argv[1]}"]))
config.insert_json5("scouting/multicast/enabled", "false")
# It would leave a file in /dev/shm when it is killed.
config.insert_json5("transport/shared_memory/enabled", "false")
session = zenoh.open(config)
if sys.argv[2] == "look":
    deadline = time.monotonic() + 60
    wanted = {("MP", topic) for topic in LOOK_AT} | {("MS", "/carla/ego/ackermann_cmd"), ("MS", "/carla/ego/vehicle_control_cmd")}
    while not wanted <= (found := check_graph(session)):
        assert time.monotonic() < deadline, f"the graph lacks {sorted(wanted - found)}"
        time.sleep(0.2)
    look(session)
else:
    drive(session)
session.close()
