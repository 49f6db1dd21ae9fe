"""Opens exported nuScenes, SemanticKITTI and KITTI-360 sets: with nuscenes-devkit, with kiss-icp's reader
of KITTI's odometry and its odometry, and as their readme files say; compares projections with the
recording's images.

Usage: export_clouds.py RECORDING NUSCENES SEMANTICKITTI KITTI360
"""

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from export_kit import Recording, agreement, inner, outside_hull, project
from kiss_icp.config import KISSConfig
from kiss_icp.datasets.kitti import KITTIOdometryDataset
from kiss_icp.kiss_icp import KissICP
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from nuscenes.utils.geometry_utils import points_in_box
from nuscenes.utils.splits import get_scenes_of_custom_split
from PIL import Image

recording, nuscenes, semantickitti, kitti360 = sys.argv[1:]
topics = ["ego/front/semantic", "ego/front/instance", "ego/roof_semantic/semantic_lidar"]
truth = Recording(recording, topics)
ticks = truth.ticks(*topics)

# nuScenes.
tables = NuScenes("v1.0-trainval", nuscenes, verbose=False)
scene = tables.scene[0]
assert get_scenes_of_custom_split("train", tables) == [scene["name"]] and scene["nbr_samples"] == len(tables.sample)
by_time = {tick * 50_000: tick for tick in ticks}
# Lidarseg's numbers of CARLA's classes that are things of one kind.
LABELS = {1: 24, 24: 24, 2: 26, 3: 28, 9: 30, 12: 2, 14: 17, 15: 23, 18: 21, 19: 14}
token, n_points, n_equal, n_boxes, n_inside, n_radar = scene["first_sample_token"], 0, 0.0, 0, 0, 0
places = []
while token:
    sample = tables.get("sample", token)
    tick = by_time[sample["timestamp"]]
    semantic = truth.frames[topics[0]][tick]
    instance = truth.frames[topics[1]][tick]
    lidar = sample["data"]["LIDAR_TOP"]
    path, boxes, _ = tables.get_sample_data(lidar)
    cloud = LidarPointCloud.from_file(path)
    labels = np.fromfile(Path(nuscenes) / tables.get("lidarseg", lidar)["filename"], np.uint8)
    assert cloud.points.shape == (4, len(labels)) and 1 < cloud.points[3].max() <= 255
    for box in boxes:
        row = tables.get("sample_annotation", box.token)
        fewer, more = (points_in_box(box, cloud.points[:3], factor).sum() for factor in (1.0, 1.1))
        assert fewer <= row["num_lidar_pts"] <= more, (row, fewer, more)
        n_boxes += 1
        n_inside += row["num_lidar_pts"]
    # The devkit brings the cloud into the image by way of calibrations and vehicle poses.
    uv, depth, _ = tables.explorer.map_pointcloud_to_image(lidar, sample["data"]["CAM_FRONT"], min_dist=1.0)
    assert uv.shape[1] > 100
    camera = tables.get("sample_data", sample["data"]["CAM_FRONT"])
    sensor = tables.get("calibrated_sensor", camera["calibrated_sensor_token"])
    from nuscenes.utils.geometry_utils import transform_matrix
    from pyquaternion import Quaternion

    def chain(data):
        own = tables.get("calibrated_sensor", data["calibrated_sensor_token"])
        ego = tables.get("ego_pose", data["ego_pose_token"])
        return transform_matrix(ego["translation"], Quaternion(ego["rotation"])) @ transform_matrix(own["translation"], Quaternion(own["rotation"]))

    camera_from_lidar = np.linalg.inv(chain(camera)) @ chain(tables.get("sample_data", lidar))
    intrinsic = np.c_[np.array(sensor["camera_intrinsic"]), np.zeros(3)]
    uv, depth = project(cloud.points[:3].T, intrinsic @ camera_from_lidar)
    seen = np.vectorize(lambda value: LABELS.get(value, 255))(semantic)
    known = np.isin(seen, list(set(LABELS.values())))
    n, share = agreement(uv, depth, labels, seen, inner(instance) & inner(semantic) & known)
    n_points, n_equal = n_points + n, n_equal + n * share
    if "RADAR_FRONT" in sample["data"]:
        radar = RadarPointCloud.from_file(tables.get_sample_data_path(sample["data"]["RADAR_FRONT"]))
        n_radar += radar.points.shape[1]
    places.append(tables.get("ego_pose", tables.get("sample_data", lidar)["ego_pose_token"])["translation"])
    token = sample["next"]
share = n_equal / n_points
assert n_points > 1000 and share > 0.97, (n_points, share)
assert n_boxes > 20 and n_inside > 100 and n_radar > 20, (n_boxes, n_inside, n_radar)
places = np.array(places)
assert tables.map[0]["mask"].is_on_mask(places[:, 0], places[:, 1]).all()
# Rows hang together: every chain of sample_data is a line in time, every instance has its annotations.
for row in tables.sample_data:
    if row["next"]:
        after = tables.get("sample_data", row["next"])
        assert after["prev"] == row["token"] and after["timestamp"] > row["timestamp"]
        assert tables.get("sample", row["sample_token"])["timestamp"] >= row["timestamp"] or not tables.get("sample", row["sample_token"])["next"]
    assert (Path(nuscenes) / row["filename"]).exists()
for instance_row in tables.instance:
    token, n = instance_row["first_annotation_token"], 0
    while token:
        row = tables.get("sample_annotation", token)
        assert row["instance_token"] == instance_row["token"] and row["visibility_token"] in "1234"
        last, token, n = token, row["next"], n + 1
    assert n == instance_row["nbr_annotations"] and last == instance_row["last_annotation_token"]
# Parked cars stand still, and the same car is the same instance throughout.
parked = {}
for row in tables.sample_annotation:
    if [tables.get("attribute", attribute)["name"] for attribute in row["attribute_tokens"]] == ["vehicle.parked"]:
        assert row["category_name"] == "vehicle.car"
        parked.setdefault(row["instance_token"], []).append(row["translation"] + row["rotation"])
assert len(parked) >= 5 and max(map(len, parked.values())) >= 3, {token: len(rows) for token, rows in parked.items()}
assert all((np.ptp(rows, axis=0) == 0).all() for rows in parked.values())
moving = [tables.box_velocity(row["token"]) for row in tables.sample_annotation]
assert np.nanmax(np.linalg.norm(moving, axis=1)) < 40
print(f"nuScenes: {n_points} points, {share:.4f} equal; {n_boxes} boxes with {n_inside} points; {n_radar} radar points")

# SemanticKITTI and KITTI's odometry.
sequence = Path(semantickitti) / "sequences/00"
clouds = sorted((sequence / "velodyne").iterdir())
assert len(clouds) == len(sorted((sequence / "labels").iterdir())) == len((sequence / "times.txt").read_text().splitlines())
instances = {}
for cloud, tick in zip(clouds, sorted(truth.frames[topics[2]])):
    points = np.fromfile(cloud, np.float32).reshape(-1, 4)
    label = np.fromfile(sequence / f"labels/{cloud.stem}.label", np.uint32)
    expected = truth.frames[topics[2]][tick]
    assert (points[:, :3] == expected["hit"]).all()
    number, kind = label >> 16, label & 0xFFFF
    assert (kind[expected["class"] == 1] == 40).all() and (kind[expected["class"] == 3] == 50).all()
    cars = expected["class"] == 14
    assert np.isin(kind[cars], [10, 252]).all() and (number[cars] > 0).all() and (number[expected["class"] == 1] == 0).all()
    for ident in np.unique(expected["id"][cars]):
        numbers = set(number[cars & (expected["id"] == ident)])
        assert len(numbers) == 1 and instances.setdefault(ident, numbers) == numbers
dataset = KITTIOdometryDataset(semantickitti, 0)
assert len(dataset) == len(clouds) == len(dataset.gt_poses)
config = KISSConfig()
config.data.deskew, config.mapping.voxel_size = False, 1.0
odometry, found = KissICP(config), []
for path in dataset.scan_files:
    points = np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].astype(np.float64)
    odometry.register_frame(points, np.array([]))
    found.append(odometry.last_pose[:3, 3])
exact = dataset.gt_poses[:, :3, 3]
length = np.linalg.norm(np.diff(exact, axis=0), axis=1).sum()
error = np.linalg.norm(np.array(found) - exact, axis=1).max()
assert length > 5 and error < 0.04 * length + 0.2, (error, length)
print(f"kiss-icp: {error:.2f} m off after {length:.1f} m; {len(instances)} cars")

# KITTI-360.
root, name = Path(kitti360), "2013_05_28_drive_0000_sync"
calib = {words[0].rstrip(":"): words[1:] for words in map(str.split, (root / "calibration/perspective.txt").read_text().splitlines())}
rect = np.array(calib["P_rect_00"], float).reshape(3, 4)
velo_from_camera = np.vstack([np.loadtxt(root / "calibration/calib_cam_to_velo.txt").reshape(3, 4), [0, 0, 0, 1]])
to_pose = {words[0].rstrip(":"): np.array(words[1:], float).reshape(3, 4) for words in map(str.split, (root / "calibration/calib_cam_to_pose.txt").read_text().splitlines())}
world_from_camera = np.loadtxt(root / f"data_poses/{name}/cam0_to_world.txt")
poses = np.loadtxt(root / f"data_poses/{name}/poses.txt")
chained = poses[5, 1:].reshape(3, 4) @ np.vstack([to_pose["image_00"], [0, 0, 0, 1]])
assert np.abs(chained - world_from_camera[5, 1:].reshape(4, 4)[:3]).max() < 1e-6
cars = {ident: thing for ident, thing in truth.scenery.items() if thing["class"] == 14}
boxes, still = {}, {}
for child in ET.parse(root / f"data_3d_bboxes/train/{name}.xml").getroot():
    matrix = {tag: np.array(child.find(tag).find("data").text.split(), float) for tag in ("transform", "vertices", "faces")}
    transform = matrix["transform"].reshape(4, 4)
    corners = matrix["vertices"].reshape(8, 3) @ transform[:3, :3].T + transform[:3, 3]
    entry = int(child.find("semanticId_orig").text), int(child.find("instanceId").text), corners
    first, last, time = (int(child.find(tag).text) for tag in ("start_frame", "end_frame", "timestamp"))
    # Parked cars are there once, for all frames.
    assert (time == -1) == (child.find("dynamic").text == "0") and (time == -1 or first == last == time)
    for frame in range(first, last + 1):
        boxes.setdefault(frame, []).append(entry)
    if time == -1:
        [ident] = [ident for ident, car in cars.items() if np.abs(transform[:3, 3] - car["box_pose"]["translation_m"]).max() < 1e-3]
        still[ident] = np.linalg.inv(transform)
n_boxes, n_points, n_equal, n_in_cars = 0, 0, 0.0, 0
frames = sorted((root / f"data_2d_raw/{name}/image_00/data_rect").iterdir())
assert len(frames) == len(poses) == len(ticks)
for path, tick in list(zip(frames, ticks))[::3]:
    frame = int(path.stem)
    assert poses[frame, 0] == world_from_camera[frame, 0] == frame
    folder = root / f"data_2d_semantics/train/{name}/image_00"
    semantic, numbered = (np.array(Image.open(folder / kind / path.name)) for kind in ("semantic", "instance"))
    assert (numbered // 1000 == semantic).all() and (semantic[truth.frames[topics[0]][tick] == 1] == 7).all()
    camera_from_world = np.linalg.inv(world_from_camera[frame, 1:].reshape(4, 4))
    cloud = np.fromfile(root / f"data_3d_raw/{name}/velodyne_points/data/{path.stem}.bin", np.float32).reshape(-1, 4)
    uv, depth = project(cloud[:, :3], rect @ np.linalg.inv(velo_from_camera))
    n, share = agreement(uv, depth, truth.frames[topics[2]][tick]["id"], truth.frames[topics[1]][tick], inner(truth.frames[topics[1]][tick]))
    n_points, n_equal = n_points + n, n_equal + n * share
    # Points that the lidar says are a parked car's lie in its box.
    world_from_velo = world_from_camera[frame, 1:].reshape(4, 4) @ np.linalg.inv(velo_from_camera)
    ids = truth.frames[topics[2]][tick]["id"]
    for ident in set(np.unique(ids)) & set(still):
        at = np.c_[cloud[ids == ident, :3], np.ones((ids == ident).sum())] @ (still[ident] @ world_from_velo).T
        size = 2 * np.array(cars[ident]["box_half_m"])
        assert ((np.abs(at[:, :3]) - 0.5) * size < 0.01).all(), (frame, ident, np.abs(at).max(axis=0))
        n_in_cars += len(at)
    for label, number, corners in boxes.get(frame, []):
        at, depth = project(corners, rect @ camera_from_world)
        rows, columns = np.nonzero(numbered == label * 1000 + number)
        if label == 26 and len(rows) > 50 and depth.min() > 0.5:
            far = outside_hull(at, np.c_[columns, rows])
            assert (far > 1.5).mean() < 0.01, (frame, label, number, far.max())
            n_boxes += 1
share = n_equal / n_points
assert n_boxes >= 10 and share > 0.97, (n_boxes, share)
assert len(still) == len(cars) > 50 and n_in_cars > 50, (len(still), len(cars), n_in_cars)
print(f"KITTI-360: {n_boxes} boxes round their pixels, {len(still)} cars of the map with {n_in_cars} points; {n_points} points, {share:.4f} equal")
print("ok")
