#!/usr/bin/python3
"""The number of tests/eval/lpips_test.cpp: LPIPS with AlexNet in PyTorch, float64, with the weights that
graphs::FormulaWeights::made_up() gives the names of PyPI's lpips.

  make_lpips.py      Debian: python3-numpy python3-torch
"""
import numpy as np
import torch
import torch.nn.functional as F

W, H = 79, 71
M = (1 << 64) - 1


def formula(name, shape):
    h = 0xcbf29ce484222325
    for b in name.encode():
        h = (h ^ b) * 0x100000001b3 & M
    i = np.arange(1, np.prod(shape) + 1, dtype=np.uint64)
    z = np.uint64(h) + i * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    unit = ((z >> np.uint64(40)).astype(np.float64) * 2.0 ** -23 - 1).astype(np.float32)
    scale = np.float32(np.sqrt(6 / np.prod(shape[1:]))) if len(shape) == 4 else np.float32(.1)
    return torch.from_numpy((unit * scale).astype(np.float64).reshape(shape))


def triangle(t, half):
    return abs(t % (2 * half) - half) * 255 // half


def picture(move):
    p = [[[(triangle((x + move) * (c + 2) + y, 23) + triangle(3 * y + (x + move) * c, 37)) // 2 for x in range(W)]
          for y in range(H)] for c in range(3)]
    return torch.from_numpy((np.array(p, np.float32) / np.float32(255)).astype(np.float64))[None]


LAYERS = [('net.slice1.0', 64, 11, 4, 2, False), ('net.slice2.3', 192, 5, 1, 2, True), ('net.slice3.6', 384, 3, 1, 1, True),
          ('net.slice4.8', 256, 3, 1, 1, False), ('net.slice5.10', 256, 3, 1, 1, False)]
SHIFT, SCALE = (torch.tensor(v, dtype=torch.float64).view(1, 3, 1, 1) for v in ((-.030, -.088, -.188), (.458, .448, .450)))

x = torch.cat([picture(0), picture(4)])
x = (2 * x - 1 - SHIFT) / SCALE
total = 0
with torch.no_grad():
    for i, (name, filters, kernel, stride, padding, pooled) in enumerate(LAYERS):
        if pooled:
            x = F.max_pool2d(x, 3, 2)
        w = formula(name + '.weight', (filters, x.shape[1], kernel, kernel))
        x = F.relu(F.conv2d(x, w, formula(name + '.bias', (filters,)), stride, padding))
        u = x / (torch.sqrt((x * x).sum(1, keepdim=True)) + 1e-10)
        d = F.conv2d(((u[:1] - u[1:]) ** 2), formula('lin%d.model.1.weight' % i, (1, filters, 1, 1))).mean()
        print('layer %d %.15g' % (i, d))
        total += d
print('lpips %.15g' % total)
