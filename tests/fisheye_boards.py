"""Detects the chessboards in fisheye images with OpenCV, and calibrates the lens from them.

Prints JSON: "size"; "edges", the rows and columns of every board as polylines of pixels, with the corner of the image as
origin; "board", the result of cv2.fisheye.calibrate: fx, fy, cx, cy, k1 to k4; and its "rms", in pixels.
"""

import glob
import json
import sys

import cv2
import numpy as np

PATTERNS = [(8, 6), (6, 5)]
# OpenCV's origin is the centre of the first pixel.
CENTRE = 0.5


def corners(path):
    """Returns the corners by row and column, with OpenCV's origin."""
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    for size in PATTERNS:
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
        found, at = cv2.findChessboardCornersSB(image, size, flags=flags)
        if found:
            return at.reshape(size[1], size[0], 2).astype(float)
    return None


def main(folder):
    paths = sorted(glob.glob(folder + "/*.jpg"))
    boards = [board for board in map(corners, paths) if board is not None]
    height, width = cv2.imread(paths[0]).shape[:2]
    objects = [np.array([[[c, r, 0.0] for r in range(b.shape[0]) for c in range(b.shape[1])]]) for b in boards]
    matrix, bend = np.array([[width / 3, 0, width / 2], [0, width / 3, height / 2], [0, 0, 1]]), np.zeros((4, 1))
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
    seen = [board.reshape(1, -1, 2) for board in boards]
    rms, matrix, bend, *_ = cv2.fisheye.calibrate(
        objects, seen, (width, height), matrix, bend, flags=flags, criteria=stop
    )
    board = [matrix[0, 0], matrix[1, 1], matrix[0, 2] + CENTRE, matrix[1, 2] + CENTRE, *bend.ravel()]
    lines = [line + CENTRE for board in boards for line in [*board, *board.transpose(1, 0, 2)]]
    edges = [line.tolist() for line in lines]
    json.dump({"size": [width, height], "edges": edges, "board": board, "rms": rms}, sys.stdout)


main(sys.argv[1])
