#!/usr/bin/env python3
"""Makes the test vectors of MiDaS' pre- and post-processing: tests/data/midas_io.safetensors.

usage: make_midas_io.py PHOTO.png OUT.safetensors

A crop of the photo (chelsea.png of Debian's python3-skimage, CC0) resized with OpenCV's INTER_CUBIC in float32 and
normalised in float64, stored in float32; a depth-like map resized with torch's bicubic in float64; working sizes as
isl-org/MiDaS midas/transforms.py computes them. Needs NumPy, python3-opencv and python3-torch.
"""
import sys

import cv2
import numpy as np
import torch

from shrink_golden import write

MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])


def working_size(height, width, bound):
    scale = min(bound / height, bound / width)

    def side(x):
        y = int(np.round(x / 32) * 32)
        return int(np.floor(x / 32) * 32) if y > bound else y
    return side(scale * height), side(scale * width)


def preprocessed(crop, bound):
    height, width = working_size(*crop.shape[:2], bound)
    image = cv2.resize(crop.astype(np.float32) / np.float32(255), (width, height), interpolation=cv2.INTER_CUBIC)
    return ((image.astype(np.float64) - MEAN) / STD).transpose(2, 0, 1).astype(np.float32)


def sizes():
    rng = np.random.default_rng(1)
    rows = [(384, 48 + 32 * k, 384) for k in range(10)] + [(672, 1008, 384), (1008, 672, 256), (1, 1, 32)]
    while len(rows) < 400:
        h, w = rng.integers(1, 6000, 2)
        rows.append((h, w, rng.choice([256, 384])))
    table = [(h, w, b) + working_size(h, w, b) for h, w, b in rows]
    return np.array([row for row in table if min(row[3:]) > 0], np.int64)


def main(photo, out):
    crop = cv2.cvtColor(cv2.imread(photo)[80:140, 160:248], cv2.COLOR_BGR2RGB)
    depth = cv2.resize(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY), (32, 24), interpolation=cv2.INTER_AREA).astype(np.float64)
    restored = torch.nn.functional.interpolate(torch.from_numpy(depth)[None, None], size=crop.shape[:2], mode='bicubic',
                                               align_corners=False)
    write(out, {'source': f'OpenCV {cv2.__version__}, torch {torch.__version__}'},
          {'crop': crop, 'smaller': preprocessed(crop, 64), 'larger': preprocessed(crop, 96), 'depth': depth,
           'restored': restored.numpy()[0, 0], 'sizes': sizes()})


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
