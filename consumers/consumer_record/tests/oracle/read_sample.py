"""Reads a file of the example `record_sample` with PyPI mcap and mcap-protobuf-support, which share no code with the recorder.

    pip install mcap mcap-protobuf-support
    cargo run --release -p consumer_record --example record_sample -- sample.mcap 20
    python read_sample.py sample.mcap 20

Checks every payload byte, the headers' places, the clocks, the attachment, and that our own schemas decode by their descriptors.
"""

import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

PERIOD_NANOS = 50_000_000
WALL_NANOS = 1_700_000_000_000_000_000
ELEMENT_BYTES = {"rgb": 4, "depth": 4, "semantic": 1, "instance": 4, "flow": 8, "dvs": 16, "lidar": 16, "imu": 72, "gnss": 40}
FIXED = ("imu", "gnss")


def payload_bytes(modality, tick):
    n_elements = {"lidar": 100 + tick, "dvs": 3 * tick, "imu": 1, "gnss": 1}.get(modality, 64 * 48)
    return n_elements * ELEMENT_BYTES[modality]


def check(path, n_ticks):
    shown, frames = {}, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        attachments = [(a.name, a.data) for a in reader.iter_attachments()]
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert message.publish_time == WALL_NANOS + message.log_time, (channel.topic, message.publish_time)
            kept = frames if schema.name == "gantry.Frame" else shown
            kept[channel.topic, message.log_time // PERIOD_NANOS] = (schema.name, decoded)
    assert attachments == [("Sample.xodr", b"<OpenDRIVE/>")], attachments
    assert metadata["gantry"]["domain"] == "sample", metadata
    assert shown["/world/info", 0][1].text == '{"map":"Sample"}'
    for tick in range(1, n_ticks + 1):
        for topic in ["ego/front/" + m for m in ("rgb", "depth", "semantic", "instance", "flow", "dvs")] + ["ego/roof/lidar", "ego/imu/imu", "ego/gnss/gnss"]:
            modality = topic.rsplit("/", 1)[1]
            frame = frames[f"/{topic}/gantry", tick][1]
            assert len(frame.header) == 256 and frame.header[:4] == b"GFRM" and frame.tick == tick and frame.seq == tick
            assert struct.unpack_from("<QQQ", frame.header, 16) == (tick, tick * PERIOD_NANOS, tick)
            payload = shown[frame.payload_topic, tick][1].data if frame.payload_topic else frame.payload
            assert len(payload) == payload_bytes(modality, tick), (topic, tick, len(payload))
            if modality not in FIXED:
                assert payload == bytes((i * 7 + tick * 13) & 0xFF for i in range(len(payload))), (topic, tick)
        image = shown["/ego/front/depth", tick][1]
        assert (image.width, image.height, image.encoding, image.step) == (64, 48, "32FC1", 256)
        assert image.timestamp.seconds * 10**9 + image.timestamp.nanos == tick * PERIOD_NANOS
        fix = shown["/ego/gnss/gnss", tick][1]
        assert abs(fix.latitude - (49 + tick * 1e-5)) < 1e-12
        imu = shown["/ego/imu/imu", tick][1]
        assert (imu.specific_force_z_mps2, imu.angular_velocity_z_radps, imu.compass_rad) == (9.81, float(tick), 1.0)
        k = list(shown["/ego/front/calibration", tick][1].K)
        assert k == [50, 0, 31.5, 0, 50, 23.5, 0, 0, 1], k
        snapshot = shown["/world/snapshot", tick][1]
        assert len(snapshot.header) == 128 and len(snapshot.records) == 256
        cloud = shown["/ego/roof/lidar", tick][1]
        assert [f.name for f in cloud.fields] == ["x", "y", "z", "intensity", "channel"] and cloud.point_stride == 16
    print(f"{path}: {len(frames)} frames and {len(shown)} other messages are as written")


if __name__ == "__main__":
    check(sys.argv[1], int(sys.argv[2]))
