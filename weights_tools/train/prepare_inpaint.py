#!/usr/bin/python3
"""What slide_depth sees in the pictures that slide_inpaint learns from: run once, before train_inpaint.py.

  prepare_inpaint.py --cache CACHE --weights slide_depth.safetensors [--composites 4000] [--part K --parts N]

The disparities of the photos with a subject (none of them held out) and of composites, with what made them; several programs may
make a part each. Also the pictures that train_inpaint.py tests with.
"""
import argparse

import cv2
import numpy as np
import torch

from common import Ragged
from depth_net import DepthNet
from evaluate import bytes_of, disparity, estimated, held_subjects, load
from inpaint_data import ESTIMATED_SIZE, InpaintData, estimated_subjects, finished

p = argparse.ArgumentParser()
p.add_argument('--cache', required=True)
p.add_argument('--weights', required=True)
p.add_argument('--composites', type=int, default=4000)
p.add_argument('--part', type=int, default=0)
p.add_argument('--parts', type=int, default=1)
a = p.parse_args()
torch.set_num_threads(1)
cv2.setNumThreads(1)
net = load(DepthNet(), a.weights)
if a.part == 0:
    # Held out, what train_inpaint.py tests with.
    data, rng, tests = InpaintData(a.cache, 779, ESTIMATED_SIZE, held=True), np.random.default_rng(3), {'slide_depth, composites': [], 'slide_depth, photos': []}
    while len(tests['slide_depth, composites']) < 60:
        s = estimated(net, data.sample(), np.exp(rng.uniform(np.log(5), np.log(30))))
        if s[5].sum() >= 200:
            tests['slide_depth, composites'].append(s)
    for photo, matte in held_subjects(a.cache):
        v = np.concatenate([photo / np.float32(255), disparity(net, photo)[..., None].astype(np.float32)], 2)
        h, w = (n // 8 * 8 for n in matte.shape)
        v = v[:h, :w]
        tests['slide_depth, photos'].append(finished(v[..., :3], None, v[..., 3], matte[:h, :w] / np.float32(255), 20))
    np.save(a.cache + '/estimated_held.npy', tests, allow_pickle=True)
photos = Ragged(a.cache + '/photos')
mine = estimated_subjects(a.cache)[a.part::a.parts]
flat = np.concatenate([disparity(net, photos[i]).astype(np.float16).ravel() for i in mine])
np.save(f'{a.cache}/estimated_photos_{a.part}.npy', flat)
np.save(f'{a.cache}/estimated_photos_{a.part}_index.npy', mine)
print(len(mine), 'photos', flush=True)

data, n, size = InpaintData(a.cache, 1000 + a.part, ESTIMATED_SIZE), a.composites // a.parts, ESTIMATED_SIZE
pictures = np.lib.format.open_memmap(f'{a.cache}/estimated_composites_{a.part}.npy', 'w+', np.uint8, (n, 7, size, size))
disparities = np.lib.format.open_memmap(f'{a.cache}/estimated_composites_{a.part}_disparity.npy', 'w+', np.float16, (n, size, size))
for k in range(n):
    scene, truth, _, alpha, *_ = data.sample()
    pictures[k] = np.concatenate([bytes_of(scene).transpose(2, 0, 1), bytes_of(truth).transpose(2, 0, 1), (alpha * 255).round().astype(np.uint8)])
    disparities[k] = disparity(net, bytes_of(scene))
print(n, 'composites')
