#!/usr/bin/python3
"""Golden results of the push-pull fill, its weights, mirroring and the background fill, in float64, from the PyTorch code that trains with them.

  make_fill.py OUT.safetensors      Debian: python3-torch, python3-numpy
"""
import json
import os
import struct
import sys

import numpy as np
import torch

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../weights_tools/train'))
from fill import background_fill, background_weight, followed, mirror_known, push_pull_fill  # noqa: E402


def save(path, tensors):
    header, blobs, at = {}, [], 0
    for name, tensor in tensors.items():
        values = np.ascontiguousarray(tensor.numpy())
        data = values.tobytes()
        header[name] = {'dtype': {'float32': 'F32', 'float64': 'F64'}[values.dtype.name], 'shape': list(tensor.shape), 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as out:
        out.write(struct.pack('<Q', len(text)) + text + b''.join(blobs))


def case(rng, shape, known):
    n, c, h, w = shape
    x = torch.from_numpy(rng.normal(size=shape).astype(np.float32).astype(np.float64))
    weight = (rng.random((n, 1, h, w)) < known) * rng.choice([.25, .75, 1.], (n, 1, h, w))
    return x, torch.from_numpy(weight)


def main():
    rng = np.random.default_rng(11)
    out = {}
    for name, shape, known, sweeps in (('odd', (2, 3, 23, 31), .1, 4), ('row', (1, 2, 1, 9), .4, 2), ('column', (1, 1, 12, 1), .4, 3),
                                       ('even', (1, 1, 16, 32), .05, 0), ('empty', (1, 1, 5, 6), 0, 1), ('pixel', (1, 2, 1, 1), 1, 4)):
        x, weight = case(rng, shape, known)
        out[name + '.x'], out[name + '.weight'], out[name + '.y'] = x, weight, push_pull_fill(x, weight, sweeps)
        out[name + '.mirrored'] = mirror_known(x, weight)
    y, x = np.mgrid[:20, :28] / 20
    d = .2 + .1 * y + .5 * ((x - .7) ** 2 + (y - .5) ** 2 < .09)
    hole = (np.abs((x - .7) ** 2 + (y - .5) ** 2 - .075) < .02).astype(np.float64)
    d, hole = (torch.from_numpy(v.astype(np.float32).astype(np.float64))[None, None] for v in (d, hole))
    out['scene.d'], out['scene.hole'], out['scene.weight'] = d, hole, background_weight(d, hole)
    colours = np.where((x - .7) ** 2 + (y - .5) ** 2 < .07, .6, -.2) + rng.normal(0, .1, (3, 20, 28))  # the disparity is grown
    rgbd = torch.cat([torch.from_numpy(colours.astype(np.float32).astype(np.float64))[None], 2 * d - 1], 1)
    out['scene.rgbd'] = rgbd
    _, out['scene.filled'], out['scene.colours'] = background_fill(rgbd, d, hole)
    edge = np.clip(.5 + 6 * (.24 - np.hypot(x - .78, y - .5)), 0, 1)  # off the disparity's, soft
    out['scene.matte'] = torch.from_numpy(edge.astype(np.float32).astype(np.float64))[None, None]
    agreement = (x > .3).astype(np.float64) * np.clip(1.2 - y, 0, 1)
    out['scene.agreement'] = torch.from_numpy(agreement.astype(np.float32).astype(np.float64))[None, None]
    out['scene.clear'] = followed(out['scene.matte'])[0]
    _, out['scene.matted.filled'], out['scene.matted.colours'] = background_fill(rgbd, d, hole, (out['scene.clear'], out['scene.agreement']))
    save(sys.argv[1], out)


if __name__ == '__main__':
    main()
