"""Cameras from control points by OpenCV and PoseLib: position errors over the bound, and the share that is solved.

This comparison uses PoseLib with known focal lengths only."""

import json
import sys

import cv2
import numpy as np
import poselib

CENTRE = (960.0, 540.0)


def matrix(focal):
    return np.array([[focal, 0.0, CENTRE[0]], [0.0, focal, CENTRE[1]], [0.0, 0.0, 1.0]])


def position(rotation, translation):
    return -cv2.Rodrigues(rotation)[0].T @ np.asarray(translation).reshape(3)


def known_focal(world, pixels, focal, has_wrong):
    if len(world) == 3:
        count, rotations, translations = cv2.solveP3P(world, pixels, matrix(focal), None, cv2.SOLVEPNP_AP3P)
        return position(rotations[0], translations[0]) if count else None
    if has_wrong:
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            world, pixels, matrix(focal), None, reprojectionError=8.0, iterationsCount=500
        )
        if found and inliers is not None and len(inliers) >= 4:
            inliers = inliers.ravel()
            rotation, translation = cv2.solvePnPRefineLM(
                world[inliers], pixels[inliers], matrix(focal), None, rotation, translation
            )
    else:
        found, rotation, translation = cv2.solvePnP(world, pixels, matrix(focal), None, flags=cv2.SOLVEPNP_SQPNP)
        if found:
            rotation, translation = cv2.solvePnPRefineLM(world, pixels, matrix(focal), None, rotation, translation)
    return position(rotation, translation) if found else None


def unknown_focal(world, pixels):
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    objects, images = [world.astype(np.float32)], [pixels.astype(np.float32)]
    _, _, _, rotations, translations = cv2.calibrateCamera(
        objects, images, (1920, 1080), matrix(1300.0), None, flags=flags
    )
    return position(rotations[0], translations[0])


def opencv(world, pixels, focal, has_wrong):
    if focal is None:
        return unknown_focal(world, pixels)
    return known_focal(world, pixels, focal, has_wrong)


def pose_lib(world, pixels, focal, _has_wrong):
    camera = {"model": "SIMPLE_PINHOLE", "width": 1920, "height": 1080, "params": [focal, *CENTRE]}
    pose, found = poselib.estimate_absolute_pose(pixels, world, camera, {"max_reproj_error": 8.0}, {})
    return -pose.R.T @ pose.t if found["num_inliers"] >= 3 else None


def row(cases, solve):
    if solve is pose_lib and any(case["focal"] is None for case in cases):
        return [None, None]
    errors, solved = [], 0
    for case in cases:
        world, pixels = np.array(case["world"]), np.array(case["pixels"])
        try:
            found = solve(world, pixels, case["focal"], case["wrong"])
        except cv2.error:
            found = None
        if found is None or not np.all(np.isfinite(found)):
            continue
        error = np.linalg.norm(found - np.array(case["position"])) / case["bound"]
        if error <= 25.0:
            solved += 1
            errors.append(error)
    rmse = float(np.sqrt(np.mean(np.square(errors)))) if errors else None
    return [rmse, solved / len(cases)]


if __name__ == "__main__":
    json.dump([row(cases, opencv) + row(cases, pose_lib) for cases in json.load(sys.stdin)], sys.stdout)
