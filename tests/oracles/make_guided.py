#!/usr/bin/python3
"""Golden results of the guided filter's coefficients and of upsampling with them, in float64, from the numpy code that the networks are evaluated with.

  make_guided.py OUT.safetensors      Debian: python3-opencv, python3-torch, python3-numpy
"""
import os
import sys

import numpy as np
import torch

from make_fill import save

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../weights_tools/train'))
from guided import guided_coefficients, guided_upsample  # noqa: E402


def main():
    rng = np.random.default_rng(12)
    out = {}
    for name, (n, c, h, w), radius, eps in (('colour', (2, 3, 23, 37), 4, 1e-3), ('grey', (1, 1, 17, 9), 2, 1e-2),
                                            ('row', (1, 3, 1, 13), 3, 1e-1), ('wide', (1, 2, 6, 5), 9, 1.), ('pixel', (1, 4, 1, 1), 1, 1e-2)):
        guide, x = (rng.random((n, k, h, w)).astype(np.float32).astype(np.float64) for k in (c, 1))
        y = [guided_coefficients(g.transpose(1, 2, 0), v[0], radius, eps).transpose(2, 0, 1) for g, v in zip(guide, x)]
        out[name + '.guide'], out[name + '.x'], out[name + '.y'] = (torch.from_numpy(np.ascontiguousarray(v)) for v in (guide, x, np.stack(y)))
    small, guide, x = (rng.random(shape).astype(np.float32).astype(np.float64) for shape in ((9, 14, 3), (31, 40, 3), (9, 14)))
    for name, v in (('small', small), ('guide', guide), ('x', x[..., None]), ('y', guided_upsample(x, small, guide, 2, 1e-2)[..., None])):
        out['upsampled.' + name] = torch.from_numpy(np.ascontiguousarray(v.transpose(2, 0, 1)[None]))
    save(sys.argv[1], out)


if __name__ == '__main__':
    main()
