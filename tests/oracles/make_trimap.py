#!/usr/bin/env python3
"""Makes the test vectors of FBA's trimap: tests/data/trimap.safetensors.

usage: make_trimap.py OUT.safetensors

saliency: a soft disc with a hole, cut by the picture's border, float32, no number near a threshold.
trimap: M <= 0.1 and M > 0.9, each eroded by SciPy's exact distance transform: 2×H×W, background first.
transformed: three Gaussians of OpenCV's distance transform for each region, as MarcoForte/FBA_Matting
networks/transforms.py defines them (cv2.distanceTransform, DIST_L2, exact; L = 320), 6×H×W, float32.
Needs NumPy, python3-scipy and python3-opencv.
"""
import sys

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from shrink_golden import write

HEIGHT, WIDTH, ERODED = 60, 44, 2


def soft_map():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    ring = np.minimum(20 - np.hypot(y - 46, x - 21), np.hypot(y - 40, x - 18) - 6)
    m = np.clip(ring / 6 + 0.5, 0, 1).astype(np.float32)
    assert min(np.abs(m - t).min() for t in (0.1, 0.9)) > 1e-5
    return m


def farther_than(mask, r):
    return distance_transform_edt(~mask) ** 2 > r * r + 0.5  # squares of whole distances: no ties by rounding


def transformed(trimap):
    planes = []
    for region in trimap:
        distance = cv2.distanceTransform((1 - region).astype(np.uint8) * 255, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        planes += [np.exp(-distance.astype(np.float64) ** 2 / (2 * (c * 320) ** 2)) for c in (0.02, 0.08, 0.16)]
    return np.array(planes, np.float32)


def main(out):
    m = soft_map()
    trimap = np.array([farther_than(m > 0.1, ERODED), farther_than(~(m > 0.9), ERODED)]).astype(np.uint8)
    assert all(100 < region.sum() < HEIGHT * WIDTH / 2 for region in trimap), trimap.sum((1, 2))
    write(out, {'source': f'OpenCV {cv2.__version__}, SciPy'},
          {'saliency': m, 'trimap': trimap, 'transformed': transformed(trimap)})


if __name__ == '__main__':
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
