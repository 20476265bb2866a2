"""Benchmark of SciPy and COLMAP, which refine a hall of cameras jointly on one thread. Prints a JSON object.

The hall is the one of the benchmark `bundle_adjustment`: cameras on a grid with the same viewing direction, eight floor
points between neighbours, and one pixel of noise. Lines determine roll, pitch and focal length approximately. The first
camera is fixed. The result is the processor time in milliseconds, from a start with the errors of our benchmark.
Missing packages are skipped. SciPy receives the sparsity of its Jacobian. COLMAP uses neither lines nor the floor.

Usage: joint_peers.py [cameras along one side and along the other] [packages]
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np

SIZE = (1920.0, 1080.0)
STEP = 4.0
POINTS = 8
# Standard deviations of pitch, roll and the log of the focal length, as determined by lines.
LINES = np.array([0.003, 0.002, 0.01])


def axes(cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the right, down and forward axes of cameras (x, y, z, yaw, pitch, roll, log focal length)."""
    yaw, pitch, roll = cameras[:, 3], cameras[:, 4], cameras[:, 5]
    none = np.zeros_like(yaw)
    ahead = np.stack([-np.sin(yaw), np.cos(yaw), none], 1)
    right = np.stack([np.cos(yaw), np.sin(yaw), none], 1)
    below = np.array([0.0, 0.0, -1.0])
    forward = np.cos(pitch)[:, None] * ahead + np.sin(pitch)[:, None] * below
    down = np.cos(pitch)[:, None] * below - np.sin(pitch)[:, None] * ahead
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return c * right + s * down, c * down - s * right, forward


def shown(cameras: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Project floor points, each to its own camera. Pixels are relative to the image centre."""
    off = np.concatenate([points, np.zeros((len(points), 1))], 1) - cameras[:, :3]
    u, v, w = (np.einsum("ij,ij->i", axis, off) for axis in axes(cameras))
    return np.exp(cameras[:, 6])[:, None] * np.stack([u / w, v / w], 1)


class Hall:
    """Ground truth, observations and initial values."""

    def __init__(self, side: int, rows: int) -> None:
        random = np.random.default_rng(900)
        at = np.array([(STEP * (i % side), STEP * (i // side)) for i in range(side * rows)])
        height = random.uniform(3, 5, len(at))
        pitch = np.arctan2(height, 6) + random.uniform(-0.05, 0.05, len(at))
        focal = SIZE[0] / 2 / np.tan(np.radians(random.uniform(70, 95, len(at))) / 2)
        turn, roll = random.uniform(-0.1, 0.1, (2, len(at)))
        self.cameras = np.column_stack([at, height, turn, pitch, 0.5 * roll, np.log(focal)])
        pairs = [(i, i + 1) for i in range(len(at)) if i % side + 1 < side]
        pairs += [(i, i + side) for i in range(len(at) - side)]
        points, views = [], []
        for a, b in pairs:
            found = 0
            while found < POINTS:
                point = at[a] + random.uniform([-6, 1], [6, 14])
                both = shown(self.cameras[[a, b]], np.array([point, point]))
                ahead = all(np.dot(axes(self.cameras[[k]])[2][0], [*point, 0] - self.cameras[k, :3]) > 0.5 for k in (a, b))
                if ahead and (np.abs(both) < np.array(SIZE) / 2).all():
                    views += [(a, len(points)), (b, len(points))]
                    points.append(point)
                    found += 1
        self.points, self.views = np.array(points), np.array(views)
        exact = shown(self.cameras[self.views[:, 0]], self.points[self.views[:, 1]])
        self.pixels = exact + random.normal(size=exact.shape)
        self.lines = self.cameras[:, 4:] + random.normal(size=(len(at), 3)) * LINES
        off = random.normal(size=self.cameras.shape) * [0.3, 0.3, 0.1, 0.02, 0, 0, 0]
        self.start = self.cameras + off
        self.start[:, 4:] = self.lines
        self.start[0] = self.cameras[0]
        self.start_points = self.points + random.normal(size=self.points.shape) * 0.3


def by_scipy(hall: Hall) -> tuple[float, float]:
    """Return the time in milliseconds and the RMS position error of the cameras in metres."""
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix

    count, views = len(hall.cameras), hall.views
    unknowns = 7 * count + 2 * len(hall.points)

    def residuals(state: np.ndarray) -> np.ndarray:
        cameras, points = state[: 7 * count].reshape(-1, 7), state[7 * count :].reshape(-1, 2)
        seen = shown(cameras[views[:, 0]], points[views[:, 1]]) - hall.pixels
        lines = (cameras[:, 4:] - hall.lines) / LINES
        fixed = (cameras[0] - hall.cameras[0]) * 1e4
        return np.concatenate([seen.ravel(), lines.ravel(), fixed])

    sparsity = lil_matrix((2 * len(views) + 3 * count + 7, unknowns), dtype=int)
    for row, (camera, point) in enumerate(views):
        sparsity[2 * row : 2 * row + 2, 7 * camera : 7 * camera + 7] = 1
        sparsity[2 * row : 2 * row + 2, 7 * count + 2 * point : 7 * count + 2 * point + 2] = 1
    for camera in range(count):
        for k in range(3):
            sparsity[2 * len(views) + 3 * camera + k, 7 * camera + 4 + k] = 1
    for k in range(7):
        sparsity[2 * len(views) + 3 * count + k, k] = 1
    state = np.concatenate([hall.start.ravel(), hall.start_points.ravel()])
    start = time.process_time()
    found = least_squares(residuals, state, jac_sparsity=sparsity, method="trf", x_scale="jac", ftol=1e-8)
    took = 1e3 * (time.process_time() - start)
    off = found.x[: 7 * count].reshape(-1, 7)[:, :3] - hall.cameras[:, :3]
    return took, float(np.sqrt((off**2).sum(1).mean()))


def by_colmap(hall: Hall) -> tuple[float, float]:
    """Return the time in milliseconds and the RMS position error in metres, after alignment to the ground truth."""
    import pycolmap

    scene = pycolmap.Reconstruction()
    rights, downs, forwards = axes(hall.start)
    for index, camera in enumerate(hall.start):
        focal = float(np.exp(camera[6]))
        scene.add_camera_with_trivial_rig(
            pycolmap.Camera(
                camera_id=index + 1, model="SIMPLE_PINHOLE", width=1920, height=1080, params=[focal, 960, 540]
            )
        )
        turn = np.stack([rights[index], downs[index], forwards[index]])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), -turn @ camera[:3])
        own = np.flatnonzero(hall.views[:, 0] == index)
        image = pycolmap.Image(
            name=str(index), keypoints=hall.pixels[own] + [960, 540], camera_id=index + 1, image_id=index + 1
        )
        scene.add_image_with_trivial_frame(image, pose)
    places = {}
    for index in range(len(hall.cameras)):
        for place, row in enumerate(np.flatnonzero(hall.views[:, 0] == index)):
            places[int(row)] = (index + 1, place)
    for point in range(len(hall.points)):
        track = pycolmap.Track()
        for row in np.flatnonzero(hall.views[:, 1] == point):
            track.add_element(*places[int(row)])
        scene.add_point3D(np.array([*hall.start_points[point], 0.0]), track, np.zeros(3, dtype=np.uint8))
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length, options.refine_principal_point, options.refine_extra_params = True, False, False
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1
    start = time.process_time()
    pycolmap.bundle_adjustment(scene, options)
    took = 1e3 * (time.process_time() - start)
    found = np.array([scene.image(i + 1).projection_center() for i in range(len(hall.cameras))])
    truth = hall.cameras[:, :3]
    a, b = found - found.mean(0), truth - truth.mean(0)
    left, size, right = np.linalg.svd(b.T @ a)
    turn = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
    scale = size.sum() / (a**2).sum()
    off = scale * a @ turn.T - b
    return took, float(np.sqrt((off**2).sum(1).mean()))


if __name__ == "__main__":
    sides = [int(side) for side in sys.argv[1:3]] or [10, 10]
    packages = sys.argv[3:] or ["scipy", "colmap"]
    hall = Hall(*sides)
    measured = {}
    for name, work in (("scipy", by_scipy), ("colmap", by_colmap)):
        if name in packages:
            try:
                measured[f"{name}_ms"], measured[f"{name}_off_m"] = work(hall)
            except ImportError as error:
                print(f"SKIPPED {name}: {error}", file=sys.stderr)
    print(json.dumps(measured))
