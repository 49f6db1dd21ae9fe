"""Packs returns of a lidar as its maker does, has the maker's or another reader decode them, and prints how far both are apart.
Estimates the noise of an IMU from what it measures at rest."""

import importlib.metadata
import json
import struct
import sys

import numpy as np

RETURN = np.dtype([
    ("xyz", "<f4", 3), ("time_ns", "<i4"), ("object_id", "<u4"), ("intensity", "<u2"), ("ring", "<u2"), ("reflectivity", "u1"),
    ("returns", "u1"), ("class", "u1"), ("flags", "u1"), ("ambient", "<u2"), ("range_mm_lsb", "<u2"),
])


def grid(case, points):
    """Column and channel of each point, by its nominal time and ring, and its whole range in millimetres."""
    channel_of = {ring: channel for channel, ring in enumerate(case["rings"])}
    channel = np.array([channel_of[int(ring)] for ring in points["ring"]])
    offsets = np.array(case["fire_offsets_ns"])
    nominal = (points["time_ns"] + offsets.max() - offsets[channel]) / case["column_ns"]
    column = case["columns"] - 1 + np.rint(nominal).astype(int)
    azimuth = np.pi - 2 * np.pi * (column + 1) / case["columns"]
    lever = case["origin_offset_m"] * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(points))], 1)
    range_mm = (np.linalg.norm(points["xyz"] - lever, axis=1) + case["origin_offset_m"]) * 1000
    whole = points["range_mm_lsb"] + 65536 * np.rint((range_mm - points["range_mm_lsb"]) / 65536)
    return column, channel, whole.astype(np.int64)


def velodyne(case, points):
    """A VLP-16's packets: two firings of 16 lasers are a block, 12 blocks are a packet."""
    import velodyne_decoder as vd

    n, n_lasers = case["columns"], len(case["rings"])
    column, channel, range_mm = grid(case, points)
    laser_of = np.argsort(np.argsort(case["fire_offsets_ns"]))
    ranges = np.zeros((n, n_lasers), int)
    ranges[column, laser_of[channel]] = range_mm // 2
    config = vd.Config()
    config.model = vd.Model.VLP16
    config.min_range, config.max_range = 0.0, 200.0
    packets = []
    for first in range(0, n, 24):
        data = b""
        for block in range(first, first + 24, 2):
            # Clockwise from ahead; column i looks at 180 - 360 (i + 1) / n, counter-clockwise.
            data += struct.pack("<HH", 0xEEFF, round((360 * (block + 1) / n - 180) * 100) % 36000)
            data += b"".join(struct.pack("<HB", value, 1) for value in ranges[block:block + 2].ravel())
        micros = first * case["column_ns"] * 1e-3
        data += struct.pack("<IBB", round(micros), 0x37, 0x22)
        packets.append(vd.VelodynePacket(1000.0 + micros * 1e-6, data))
    stamp, seen = vd.ScanDecoder(config).decode(packets)
    ring, time_us = seen[:, 6].astype(int), (stamp.device + seen[:, 4].astype(float)) * 1e6
    # Both in the order of time, which is that of the packets.
    own_us = points["time_ns"] * 1e-3 + (n - 1) * case["column_ns"] * 1e-3 + max(case["fire_offsets_ns"]) * 1e-3
    key = column * n_lasers + laser_of[channel]
    order = np.argsort(key)
    n_both = min(len(order), len(seen))
    own, seen, ring, time_us = points[order][:n_both], seen[:n_both], ring[:n_both], time_us[:n_both]
    apart = np.linalg.norm(own["xyz"] - seen[:, :3], axis=1)
    return {
        "version": importlib.metadata.version("velodyne-decoder"), "n_points": n_both,
        "n_missing": abs(len(points) - n_both), "max_mm": float(apart.max() * 1000),
        "max_us": float(np.abs(own_us[order][:n_both] - time_us).max()), "n_wrong_rings": int((own["ring"] != ring).sum()),
    }


def ouster(case, points):
    """An image of ranges, a row a beam and a column a firing, through the table of directions of Ouster's own library."""
    from ouster.sdk import core

    n, n_beams = case["columns"], len(case["rings"])
    column, channel, range_mm = grid(case, points)
    info = core.SensorInfo()
    info.format.columns_per_frame, info.format.pixels_per_column = n, n_beams
    info.beam_altitude_angles = case["elevations_deg"]
    info.beam_azimuth_angles = [-degrees for degrees in case["azimuth_offsets_deg"]]
    info.lidar_origin_to_beam_origin_mm = case["origin_offset_m"] * 1000
    beam_to_lidar = np.eye(4)
    beam_to_lidar[0, 3] = case["origin_offset_m"] * 1000
    info.beam_to_lidar_transform, info.lidar_to_sensor_transform = beam_to_lidar, np.eye(4)
    # Ouster counts columns clockwise from ahead.
    place = (column + 1 + n // 2) % n
    image = np.zeros((n_beams, n), np.uint32)
    image[channel, place] = range_mm
    seen = core.XYZLut(info, False)(image)[channel, place]
    apart = np.linalg.norm(points["xyz"] - seen, axis=1)
    return {
        "version": importlib.metadata.version("ouster-sdk"), "n_points": len(points),
        "n_missing": int(n * n_beams - len(points)), "max_mm": float(apart.max() * 1000), "max_us": None, "n_wrong_rings": None,
    }


def allan(case, values):
    """The parameter of IEEE 952 that makes a slope of the Allan deviation, between two averaging times."""
    import allantools

    taus = np.geomspace(*case["taus_secs"], 24)
    taus, deviations, _, _ = allantools.oadev(values, rate=case["rate_hz"], data_type="freq", taus=taus)
    # N is the deviation times the root of the time, B the floor over 0.664, K the deviation over the root of a third of the time.
    parameters = deviations * {
        "white": np.sqrt(taus), "instability": np.sqrt(np.pi / (2 * np.log(2))) * np.ones_like(taus), "walk": np.sqrt(3 / taus),
    }[case["process"]]
    slope = np.polyfit(np.log(taus), np.log(deviations), 1)[0]
    return {
        "version": importlib.metadata.version("allantools"), "parameter": float(np.exp(np.log(parameters).mean())), "slope": float(slope),
    }


def main():
    case = json.loads(sys.stdin.buffer.readline())
    data = sys.stdin.buffer.read()
    if case["tool"] == "allantools":
        print(json.dumps(allan(case, np.frombuffer(data, "<f8"))))
        return
    judges = {"velodyne-decoder": velodyne, "ouster-sdk": ouster}
    print(json.dumps(judges[case["tool"]](case, np.frombuffer(data, RETURN))))


main()
