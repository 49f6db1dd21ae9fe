"""Reads an exported KITTI set as its readme files describe it, and compares projections of clouds and
boxes (with the exported calibration alone) with instance images of the recording.

Usage: export_kitti.py RECORDING SET [PICTURE]
"""

import sys
from pathlib import Path

import numpy as np
from export_kit import Recording, agreement, inner, outside_hull, project
from PIL import Image, ImageDraw

recording, root = sys.argv[1], Path(sys.argv[2])
topics = ["ego/front/instance", "ego/front/depth", "ego/roof_semantic/semantic_lidar"]
truth = Recording(recording, topics)
training = root / "object/training"
frames = (root / "object/ImageSets/train.txt").read_text().split()
ticks = truth.ticks(*topics)
assert frames == [f"{at:06}" for at in range(len(frames))] and len(frames) == len(ticks), (len(frames), len(ticks))


def calibration(path):
    lines = (line.split() for line in path.read_text().splitlines())
    return {words[0].rstrip(":"): np.array(words[1:], float) for words in lines}


def corners(h, w, l, x, y, z, turn):
    box = np.array([[l / 2 * a, b, w / 2 * c] for a in (-1, 1) for b in (-h, 0) for c in (-1, 1)])
    cos, sin = np.cos(turn), np.sin(turn)
    return box @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T + [x, y, z]


parked = {ident for ident, thing in truth.scenery.items() if thing["class"] == 14}
vehicles = parked | {ident for ident, actor in truth.actors.items() if actor["kind"] == "vehicle"}
n_points, n_equal, n_boxes, n_labels, kinds, n_parked, n_parked_points = 0, 0.0, 0, 0, set(), 0, 0
for frame, tick in zip(frames, ticks):
    calib = calibration(training / f"calib/{frame}.txt")
    p2 = calib["P2"].reshape(3, 4)
    to_camera = np.vstack([calib["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    rectified = np.eye(4)
    rectified[:3, :3] = calib["R0_rect"].reshape(3, 3)
    image = Image.open(training / f"image_2/{frame}.png")
    instance, depth, points = (truth.frames[topic][tick] for topic in topics)
    cloud = np.fromfile(training / f"velodyne/{frame}.bin", np.float32).reshape(-1, 4)
    # The plain lidar stands where the semantic one does and hits the same points.
    assert np.abs(cloud[:, :3] - points["hit"]).max() < 0.01
    assert 0 < cloud[:, 3].min() <= cloud[:, 3].max() <= 1
    uv, z = project(cloud[:, :3], p2 @ rectified @ to_camera)
    n, share = agreement(uv, z, points["id"], instance, inner(instance))
    n_points, n_equal = n_points + n, n_equal + n * share
    drive = root / f"depth/train/{Path(recording).stem}/proj_depth/groundtruth/image_02"
    coded = np.array(Image.open(drive / f"{int(frame):010}.png")).astype(float) / 256
    near = np.isfinite(depth) & (depth < 255)
    assert np.abs(coded[near] - depth[near]).max() < 0.0021 and (coded[~np.isfinite(depth)] == 0).all()
    lines = (training / f"label_2/{frame}.txt").read_text().splitlines()
    # No parked car that can be seen well is a region that nobody cares about.
    regions = {tuple(round(float(word)) for word in line.split()[4:8]) for line in lines if line.startswith("DontCare")}
    for ident in parked & set(np.unique(instance)):
        rows, columns = np.nonzero(instance == ident)
        rectangle = columns.min(), rows.min(), columns.max(), rows.max()
        assert len(rows) < 10 or rectangle not in regions, (frame, ident)
    for line in lines:
        words = line.split()
        assert len(words) == 15
        left, top, right, bottom = (float(word) for word in words[4:8])
        assert 0 <= left <= right <= image.width - 1 and 0 <= top <= bottom <= image.height - 1, line
        kinds.add(words[0])
        if words[0] == "DontCare":
            continue
        n_labels += 1
        box = corners(*(float(word) for word in words[8:15]))
        assert words[2] in "012" and 0 <= float(words[1]) <= 1
        turn, at = float(words[14]), [float(word) for word in words[11:14]]
        alpha = (turn - np.arctan2(at[0], at[2]) + np.pi) % (2 * np.pi) - np.pi
        assert abs((alpha - float(words[3]) + np.pi) % (2 * np.pi) - np.pi) < 2e-3, line
        if words[2] != "0" or float(words[1]) > 0 or words[0] == "Pedestrian" or (box[:, 2] < 0.5).any():
            continue
        # Whose label it is: the actor whose pixels' rectangle fits best.
        hull, _ = project(box, p2)
        best = None
        for ident in np.unique(instance[round(top) : round(bottom) + 1, round(left) : round(right) + 1]):
            if ident in vehicles:
                rows, columns = np.nonzero(instance == ident)
                a = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
                misfit = np.abs(a - [left, top, right, bottom]).max()
                if best is None or misfit < best[0]:
                    best = misfit, ident, np.c_[columns, rows]
        if best and best[0] <= 0.1 * max(right - left, bottom - top) + 3:
            far = outside_hull(hull, best[2])
            assert (far > 1.5).mean() < 0.01, (frame, line, far.max())
            n_boxes += 1
            if best[1] in parked:
                # Points that the lidar says are this car's lie in its box, which knows no pitch.
                at_car = cloud[points["id"] == best[1], :3]
                x, y, z = (np.c_[at_car, np.ones(len(at_car))] @ to_camera.T)[:, :3].T - np.array(at)[:, None]
                h, w, l = (float(word) for word in words[8:11])
                along, across = np.cos(turn) * x - np.sin(turn) * z, np.sin(turn) * x + np.cos(turn) * z
                excess = np.max([np.abs(along) - l / 2, np.abs(across) - w / 2, y, -y - h], axis=0, initial=0)
                assert (excess < 0.12).all(), (frame, line, excess.max())
                n_parked, n_parked_points = n_parked + 1, n_parked_points + len(at_car)
share = n_equal / n_points
assert n_points > 2000 and share >= 0.97, (n_points, share)
assert n_boxes - n_parked >= 10 and {"Car"} <= kinds, (n_boxes, n_labels, kinds)
assert n_parked >= 5 and n_parked_points > 50, (n_parked, n_parked_points)

# A pair's baseline is the one of the launch file.
calib = calibration(training / f"calib/{frames[0]}.txt")
p2, p3 = calib["P2"].reshape(3, 4), calib["P3"].reshape(3, 4)
assert abs(p3[0, 3] / p3[0, 0] + 0.5) < 1e-9 and p2[0, 3] == 0

# Flow leads from each image to the one before it: colours there are the same.
pairs = sorted((root / "flow/training/flow_occ").glob("*_10.png"))
errors, still = [], []
import cv2  # noqa: E402 (16-bit colour PNGs, which Pillow does not read)

for path in pairs[:20]:
    code = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[:, :, ::-1].astype(float)
    flow, valid = (code[:, :, :2] - 2**15) / 64, code[:, :, 2] > 0
    name = path.name[:6]
    now, before = (np.array(Image.open(root / f"flow/training/image_2/{name}_{at}.png")).astype(np.float32) for at in (10, 11))
    height, width = valid.shape
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    there = cv2.remap(before, (column + flow[:, :, 0]).astype(np.float32), (row + flow[:, :, 1]).astype(np.float32), cv2.INTER_LINEAR)
    moved = valid & (np.hypot(flow[:, :, 0], flow[:, :, 1]) > 1)
    inside = (column + flow[:, :, 0] >= 0) & (column + flow[:, :, 0] < width - 1) & (row + flow[:, :, 1] >= 0) & (row + flow[:, :, 1] < height - 1)
    if (moved & inside).sum() > 500:
        errors.append(np.abs(there - now)[moved & inside].mean())
        still.append(np.abs(before - now)[moved & inside].mean())
assert len(errors) >= 5 and np.mean(errors) < 0.75 * np.mean(still), (len(errors), np.mean(errors), np.mean(still))

# Tracking: the same images, tracks, and lines of motion that fit one another.
labels = (root / "tracking/training/label_02/0000.txt").read_text().splitlines()
tracks = {}
for line in labels:
    words = line.split()
    assert len(words) == 17
    if words[2] != "DontCare":
        tracks.setdefault(int(words[1]), []).append((int(words[0]), words[2]))
assert sorted(tracks) == list(range(len(tracks)))
assert all(len({kind for _, kind in track}) == 1 for track in tracks.values())
assert max(len(track) for track in tracks.values()) >= 5
assert len(list((root / "tracking/training/image_02/0000").iterdir())) == len(frames)
oxts = np.loadtxt(root / "tracking/training/oxts/0000.txt")
assert oxts.shape == (len(frames), 30)
metres = np.deg2rad(oxts[:, :2]) * 6371e3 * np.array([1, np.cos(np.deg2rad(oxts[0, 0]))])
travelled = np.linalg.norm(np.diff(metres, axis=0), axis=1).sum()
speed = np.hypot(oxts[:, 8], oxts[:, 9])
expected = speed[:-1].sum() * 0.1
assert abs(travelled - expected) < 0.05 * expected + 0.5, (travelled, expected)
assert np.abs(oxts[:, 11:14]).max() < 60 and 5 < oxts[:, 13].mean() < 15
print(f"ok: {n_points} points, {share:.4f} equal; {n_boxes} of {n_labels} boxes compared, {n_parked} of parked cars with {n_parked_points} points; flow {np.mean(errors):.1f} against {np.mean(still):.1f}")

if len(sys.argv) > 3:
    frame = max(frames, key=lambda name: sum(not line.startswith("DontCare") for line in (training / f"label_2/{name}.txt").open()))
    image = Image.open(training / f"image_2/{frame}.png").convert("RGB")
    draw = ImageDraw.Draw(image)
    calib = calibration(training / f"calib/{frame}.txt")
    p2, to_camera = calib["P2"].reshape(3, 4), np.vstack([calib["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    cloud = np.fromfile(training / f"velodyne/{frame}.bin", np.float32).reshape(-1, 4)
    uv, z = project(cloud[:, :3], p2 @ to_camera)
    for (u, v), far in zip(uv[z > 0.2], z[z > 0.2]):
        if 0 <= u < image.width - 1 and 0 <= v < image.height - 1:
            near = max(0.0, 1 - far / 50)
            image.putpixel((round(u), round(v)), (int(255 * near), int(120 + 135 * (1 - near)), int(255 * (1 - near))))
    for line in (training / f"label_2/{frame}.txt").read_text().splitlines():
        words = line.split()
        if words[0] == "DontCare":
            continue
        box = corners(*(float(word) for word in words[8:15]))
        if (box[:, 2] > 0.2).all():
            at, _ = project(box, p2)
            for a in range(8):
                for bit in (1, 2, 4):
                    if not a & bit:
                        draw.line([tuple(at[a]), tuple(at[a | bit])], fill=(255, 220, 0))
    image.save(sys.argv[3])
