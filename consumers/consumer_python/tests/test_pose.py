"""Poses against matrices of numpy, and against pixels that were worked out by hand."""

import math
import pathlib
import sys
import unittest

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402


def random_poses(n):
    """Poses anywhere, turned in any direction."""
    random = np.random.default_rng(5)
    for _ in range(n):
        turn = random.normal(size=4)
        yield gantry.Pose(tuple(random.uniform(-50, 50, 3).tolist()), tuple((turn / np.linalg.norm(turn)).tolist()))


class Poses(unittest.TestCase):
    def test_products_inverses_and_points_are_those_of_matrices(self):
        poses = list(random_poses(40))
        points = np.random.default_rng(6).uniform(-20, 20, (7, 3))
        for a, b in zip(poses, poses[1:]):
            np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)
            np.testing.assert_allclose(a.inverse().matrix(), np.linalg.inv(a.matrix()), atol=1e-9)
            moved = (a.matrix() @ np.column_stack([points, np.ones(7)]).T).T[:, :3]
            np.testing.assert_allclose(a.apply(points), moved, atol=1e-9)
            np.testing.assert_allclose(a.apply(points[0]), moved[0], atol=1e-9)
            self.assertAlmostEqual(math.hypot(*(a @ b).rotation_xyzw), 1.0, places=12)

    def test_yaw_is_the_angle_of_the_x_axis_on_the_ground(self):
        for yaw in np.linspace(-3.1, 3.1, 23):
            pose = gantry.Pose.turned((1.0, 2.0, 3.0), yaw)
            self.assertAlmostEqual(pose.yaw_rad, yaw)
            np.testing.assert_allclose(pose.apply([1.0, 0.0, 0.0]), [1 + math.cos(yaw), 2 + math.sin(yaw), 3.0], atol=1e-12)
        for pose in random_poses(20):
            ahead = pose.matrix()[:3, 0]
            self.assertAlmostEqual(pose.yaw_rad, math.atan2(ahead[1], ahead[0]))

    def test_points_are_seen_where_a_pinhole_has_them(self):
        # Turned to the left by 90°: the world's y is ahead, its -x to the left, its z up.
        camera = gantry.Pose.turned((10.0, 0.0, 1.5), math.pi / 2)
        seen = camera.project([[10.0, 8.0, 1.5], [8.0, 8.0, 1.5], [10.0, 8.0, 2.5], [10.0, -1.0, 1.5]], (400.0, 300.0, 160.0, 120.0))
        np.testing.assert_allclose(seen[:3], [[160.0, 120.0], [160.0 - 400.0 * 2 / 8, 120.0], [160.0, 120.0 - 300.0 / 8]], atol=1e-9)
        self.assertTrue(np.isnan(seen[3]).all(), "behind the camera")
        np.testing.assert_allclose(camera.project([10.0, 8.0, 1.5], (400.0, 300.0, 160.0, 120.0)), [160.0, 120.0], atol=1e-9)

    def test_a_pose_is_read_from_a_record(self):
        record = np.zeros(1, gantry.ACTOR)[0]
        record["world_from_actor"]["translation_m"], record["world_from_actor"]["rotation_xyzw"] = (1, 2, 3), (0, 0, 1, 0)
        pose = gantry.Pose.of(record["world_from_actor"])
        self.assertEqual((pose, pose.yaw_rad), (gantry.Pose((1.0, 2.0, 3.0), (0.0, 0.0, 1.0, 0.0)), math.pi))
        with self.assertRaisesRegex(ValueError, r"points have the shape \(2,\)"):
            pose.apply([1.0, 2.0])


if __name__ == "__main__":
    unittest.main()
