"""Fuses detections of several cameras to tracks on the floor: python fuse_tracks.py SITE.json DETECTIONS.csv TRACKS.csv

The same tracker as `fuse_tracks.rs` of calib-site, which has more comments. It is a Kalman filter of position and velocity
that considers the error of each calibration, but does not estimate it (Schmidt 1966). This error is common to all
detections of a camera.
"""

import csv
import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

import calib

Array = npt.NDArray[np.float64]
FOOT_PX, SPEED, AGILITY, GATE, PATIENCE, DOUBT, ENOUGH = 2.0, 1.2, 0.8, 13.8, 3.0, 0.5, 4


@dataclass
class Track:
    id: int
    state: Array
    covariance: Array
    seen_by: str
    seen_at: float
    hits: int = 1
    shared: dict[str, Array] = field(default_factory=dict)

    def predict(self, dt: float) -> None:
        motion = np.eye(4) + dt * np.eye(4, k=2)
        wander = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], AGILITY * np.eye(2))
        self.state, self.covariance = motion @ self.state, motion @ self.covariance @ motion.T + wander
        self.shared = {camera: motion @ shared for camera, shared in self.shared.items()}


def on_floor(camera: calib.Camera, u: Array, v: Array) -> list[tuple[Array, Array, Array]]:
    x, y, _ = camera.to_floor(u, v)
    noise, _ = camera.floor_covariance(u, v, FOOT_PX)
    slopes = camera.floor_jacobian(u, v)
    return [seen for seen in zip(np.stack([x, y], axis=-1), noise, slopes, strict=True) if np.isfinite(seen[0]).all()]


def assign(tracks: list[Track], seen: list[tuple[Array, Array, Array]], camera: calib.Camera, at: float, ids: Iterator[int]) -> None:
    # A camera placed by hand has infinite variances; its position is assumed to be exact.
    own, pairs = np.nan_to_num(camera.covariance, posinf=0.0), []
    for (t, track), (d, (point, noise, slopes)) in itertools.product(enumerate(tracks), enumerate(seen)):
        shared = track.shared.get(camera.id, np.zeros((4, len(own))))
        cross = shared[:2] @ slopes.T
        spread = track.covariance[:2, :2] + noise + slopes @ own @ slopes.T - cross - cross.T
        gain = (track.covariance[:, :2] - shared @ slopes.T) @ np.linalg.inv(spread)
        off = point - track.state[:2]
        distance = off @ np.linalg.solve(spread, off)
        if distance < GATE:
            pairs.append((track.hits < ENOUGH, distance + np.log(np.linalg.det(spread)), t, d, gain, spread, off))
    taken: set[tuple[str, int]] = set()
    for _, _, t, d, gain, spread, off in sorted(pairs, key=lambda pair: pair[:2]):
        if ("t", t) in taken or ("d", d) in taken:
            continue
        taken |= {("t", t), ("d", d)}
        track, slopes = tracks[t], seen[d][2]
        track.state, covariance = track.state + gain @ off, track.covariance - gain @ spread @ gain.T
        track.covariance = 0.5 * (covariance + covariance.T)
        track.shared.setdefault(camera.id, np.zeros((4, len(own))))
        for other, shared in track.shared.items():
            track.shared[other] = shared + gain @ ((slopes @ own if other == camera.id else 0.0) - shared[:2])
        track.seen_by, track.seen_at, track.hits = camera.id, at, track.hits + 1
    for d, (point, noise, slopes) in enumerate(seen):
        if ("d", d) not in taken:
            covariance = np.diag([0.0, 0.0, SPEED**2, SPEED**2])
            covariance[:2, :2] = noise + slopes @ own @ slopes.T
            first = {camera.id: np.vstack([slopes @ own, np.zeros((2, len(own)))])}
            tracks.append(Track(next(ids), np.array([*point, 0.0, 0.0]), covariance, camera.id, at, shared=first))


def main(site_path: str, detections: str, out: str) -> None:
    site, ids, now = calib.Site.open(site_path), itertools.count(1), 0.0
    cameras, tracks = [site.camera(name) for name in site.cameras], list[Track]()
    with open(detections, newline="") as rows, open(out, "w", newline="") as to:
        writer = csv.writer(to)
        writer.writerow(["at_s", "track", "x_m", "y_m", "sigma_x_m", "sigma_y_m", "seen_by"])
        for at, moment in itertools.groupby(csv.DictReader(rows), key=lambda row: float(row["at_s"])):
            for track in tracks:
                track.predict(at - now)
            now, found = at, list(moment)
            for camera in cameras:
                feet = np.array([[row["u"], row["v"]] for row in found if row["camera"] == camera.id], dtype=float)
                if len(feet):
                    assign(tracks, on_floor(camera, *feet.T), camera, at, ids)
            tracks = [track for track in tracks if at - track.seen_at < (PATIENCE if track.hits >= ENOUGH else DOUBT)]
            for track in (track for track in tracks if track.hits >= ENOUGH):
                numbers = [*track.state[:2], *np.sqrt(np.diag(track.covariance)[:2])]
                writer.writerow([at, track.id, *(f"{number:.4f}" for number in numbers), track.seen_by])


if __name__ == "__main__":
    main(*sys.argv[1:])
