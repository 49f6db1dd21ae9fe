"""Reads a file of the example `record_results` with PyPI mcap and mcap-protobuf-support, which share no code with the recorder.

    pip install mcap mcap-protobuf-support
    cargo run --release -p consumer_record --example record_results -- results.mcap 20
    python read_results.py results.mcap 20

Checks that a user's own protobuf messages decode by the user's own schema, that boxes, masks and numbers are as written, and that
header, inputs and body of every result come back.
"""

import json
import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

TYPES = "image tensor boxes2d boxes3d tracks masks keypoints flow depth semantic instance points pose odometry path control scalars text json bytes".split()


def check(path, n_ticks):
    shown, kept = {}, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        protobuf = DecoderFactory()
        for schema, channel, message in reader.iter_messages():
            decode = protobuf.decoder_for(channel.message_encoding, schema)
            value = decode(message.data) if decode else json.loads(message.data)
            if schema.encoding == "jsonschema":
                assert isinstance(json.loads(schema.data), dict), schema.name
            place = kept if schema.name == "gantry.Result" else shown
            place[channel.topic, message.log_time // 50_000_000] = (schema.name, value, message.data)
    for tick in range(1, n_ticks + 1):
        for number, name in enumerate(TYPES, 1):
            _, result, _ = kept[f"/user/{name}/gantry", tick]
            assert len(result.header) == 320 and result.header[:4] == b"GRES" and result.tick == tick
            assert struct.unpack_from("<H", result.header, 8) == (number,)
            topic, in_tick = result.inputs[:200].rstrip(b"\0").decode(), struct.unpack_from("<Q", result.inputs, 200)[0]
            assert (topic, in_tick) == ("ego/front/rgb", tick)
            (body_bytes,) = struct.unpack_from("<Q", result.header, 56)
            body = result.body
            if result.body_topic:
                schema, message, data = shown[result.body_topic, tick]
                body = message.data if schema.startswith("foxglove.") else data
            assert len(body) == body_bytes, (name, tick, len(body), body_bytes)
        boxes = shown["/user/boxes2d", tick][1]
        assert [text.text for text in boxes.texts] == ["car 0.75", "person 0.75"], boxes.texts
        x0, y0, x1, y1 = struct.unpack_from("<4f", kept["/user/boxes2d/gantry", tick][1].body)
        assert [(p.x, p.y) for p in boxes.points[0].points] == [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        assert shown["/user/scalars", tick][1]["values"] == {"speed_mps": tick}
        assert shown["/user/json", tick][1] == {"tick": tick}
        schema, detection, _ = shown["/user/bytes", tick]
        assert (schema, detection.label, detection.score) == ("user.Detection", "car", 0.5)
        mask = shown["/user/masks", tick][1].points[-1]
        assert [(p.x, p.y) for p in mask.points] == [(1.5, 1), (1.5, 4)]
    print(f"{path}: {len(kept)} results and {len(shown)} other messages are as written")


if __name__ == "__main__":
    check(sys.argv[1], int(sys.argv[2]))
