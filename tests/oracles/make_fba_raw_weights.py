#!/usr/bin/env python3
"""Runs the authors' FBA matting on raw weights, which their eval() standardises: the golden file of that path.

usage: make_fba_raw_weights.py FBA_MATTING_CHECKOUT FBA_GOLDEN.safetensors OUT.safetensors

The weights are the formula weights of the golden file, which holds a run without standardisation. The input is the top
left 32×40 of the golden file's. Needs NumPy and python3-torch.
"""
import json
import sys

import numpy as np
import torch

from shrink_golden import read, write

MASK = (1 << 64) - 1


def formula(name, shape, scale):
    hash64 = 0xcbf29ce484222325
    for c in name.encode():
        hash64 = ((hash64 ^ c) * 0x100000001b3) & MASK
    i = np.arange(1, np.prod(shape) + 1, dtype=np.uint64)
    with np.errstate(over='ignore'):
        z = np.uint64(hash64) + i * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    unit = ((z >> np.uint64(40)).astype(np.float64) * 2.0**-23 - 1).astype(np.float32)
    return (unit * np.float32(scale)).reshape(shape)


def main(checkout, golden, out):
    sys.path.insert(0, checkout)
    from networks.models import build_model
    metadata, tensors = read(golden)
    scales = json.loads(metadata['scales'])
    model = build_model('default').double()
    state = {name: torch.from_numpy(
        (tensors['param.' + name] if 'param.' + name in tensors else
         formula(metadata['salt'] + name, tuple(value.shape), scales[name])).astype(np.float64))
        for name, value in model.state_dict().items()}
    model.load_state_dict(state)
    model.eval()
    names = ['image', 'two_chan_trimap', 'image_n', 'trimap_transformed']
    inputs = {'input.' + name: np.ascontiguousarray(tensors['input.' + name][:, :32, :40]) for name in names}
    with torch.no_grad():
        result = model(*[torch.from_numpy(t.astype(np.float64))[None] for t in inputs.values()])
    write(out, {'network': 'fba'}, {**inputs, 'output.0': result.numpy()})


if __name__ == '__main__':
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
