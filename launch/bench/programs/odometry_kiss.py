"""Lidar odometry with KISS-ICP (Vizzo et al., 2023). Needs `pip install kiss-icp`.

Settings: `max_range_m` (80), `voxel_m` (0.5), `ground_m` (-1.7): what lies lower, seen from the lidar, is
left out, because rings on a flat road travel with the car and say that it stands still.
"""

import gantry
import gantry.bench
import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import AdaptiveThresholdConfig, DataConfig, MappingConfig
from kiss_icp.kiss_icp import KissICP


class Odometry(gantry.bench.Program):
    inputs = {"cloud": "ego/roof/lidar"}
    outputs = ("kiss/odometry", "odometry")
    every = True  # a scan that is left out is motion that has to be guessed

    def __init__(self):
        settings = gantry.bench.params()
        max_range_m = float(settings.get("max_range_m", 80.0))
        voxel_m = float(settings.get("voxel_m", 0.5))
        data = DataConfig(max_range=max_range_m, min_range=2.5, deskew=False)  # a turn of our lidars is seen from one place
        self.icp = KissICP(KISSConfig(data=data, mapping=MappingConfig(voxel_size=voxel_m), adaptive_threshold=AdaptiveThresholdConfig()))
        self.ground_m = float(settings.get("ground_m", -1.7))
        self.last = None

    def work(self, cloud):
        points = cloud.array["hit_in_sensor_m"].astype(np.float64)
        points = points[points[:, 2] > self.ground_m]
        self.icp.register_frame(points, np.zeros(0))
        pose = self.icp.last_pose
        step = np.eye(4) if self.last is None else np.linalg.inv(self.last[1]) @ pose
        secs = 1.0 if self.last is None else max(cloud.sim_time - self.last[0], 1e-3)
        self.last = (cloud.sim_time, pose)
        return gantry.odometry(pose[:3, 3], rotation_xyzw=quaternion(pose[:3, :3]), velocity_mps=step[:3, 3] / secs)


def quaternion(rotation):
    """The unit quaternion [x, y, z, w] of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    k = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


if __name__ == "__main__":
    gantry.bench.run(Odometry())
