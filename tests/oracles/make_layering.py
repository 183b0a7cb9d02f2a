#!/usr/bin/python3
"""Golden maps of soft layering in float64, straight from the definition (docs/method.md: conditioning, eq. 1 to 3, matte).

  make_layering.py OUT.safetensors      Debian: python3-numpy

All windows are evaluated pair by pair; nothing here is fast.
"""
import json
import math
import struct
import sys

import numpy as np


def save(path, tensors, metadata):
    header, blobs, at = {'__metadata__': metadata}, [], 0
    for name, array in tensors.items():
        data = np.ascontiguousarray(array, np.float64).tobytes()
        header[name] = {'dtype': 'F64', 'shape': list(array.shape), 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as out:
        out.write(struct.pack('<Q', len(text)) + text + b''.join(blobs))


def at(d, y, x):
    """The border replicated."""
    h, w = d.shape
    return d[min(max(y, 0), h - 1), min(max(x, 0), w - 1)]


def over(d, radius, combine):
    h, w = d.shape
    return np.array([[combine([at(d, y + j, x + i) for j in range(-radius, radius + 1) for i in range(-radius, radius + 1)])
                      for x in range(w)] for y in range(h)])


def gauss(d, sigma):
    r = math.ceil(3 * sigma)
    k = np.exp(-np.arange(-r, r + 1) ** 2 / (2 * sigma ** 2))
    k2 = np.outer(k, k) / k.sum() ** 2
    return over(d, r, lambda v: float((np.array(v) * k2.ravel()).sum()))


def sobel(d):
    gx = np.array([-1, 0, 1, -2, 0, 2, -1, 0, 1]) / 8
    gy = np.array([-1, -2, -1, 0, 0, 0, 1, 2, 1]) / 8
    return over(d, 1, lambda v: float(np.dot(v, gx))), over(d, 1, lambda v: float(np.dot(v, gy)))


def cone(d, rho, m, sign):
    """max over i of sign·(d(i) - d(p)) - rho·K(i), along the row and the column"""
    h, w = d.shape
    out = np.zeros_like(d)
    for y in range(h):
        for x in range(w):
            values = [sign * (at(d, y, x + k) - d[y, x]) - rho * abs(k) for k in range(-m, m + 1)]
            values += [sign * (at(d, y + k, x) - d[y, x]) - rho * abs(k) for k in range(-m, m + 1)]
            out[y, x] = max(values)
    return out


def layering(d, p, sigma=1.0, k=3):
    beta, gamma, rho, m = 4 * math.log(2) * p * p, p, 1 / p, math.ceil(p)
    d1 = over(gauss(d, sigma), k // 2, max)
    gx, gy = sobel(d1)
    a = np.exp(-beta * (gx ** 2 + gy ** 2))
    s = np.maximum(np.tanh(gamma * cone(d1, rho, m, -1)), 0)
    s_hat = np.maximum(np.tanh(gamma * cone(d1, rho, m, 1)), 0)
    hole = over((s > 0.05).astype(np.float64), 1, max)
    return {'D1': d1, 'A': a, 'S': s, 'S_hat': s_hat, 'H': hole}


def main():
    rng = np.random.default_rng(7)
    h, w = 23, 31
    y, x = np.mgrid[:h, :w]
    disc = ((x - 13) ** 2 + (y - 11) ** 2 < 49).astype(np.float64)
    d = np.clip(0.25 + 0.2 * y / h + 0.5 * disc + 0.02 * rng.standard_normal((h, w)), 0, 1)
    tensors = {'D': d}
    for p in (1.5, 6.0, 40.0):
        for name, value in layering(d, p).items():
            tensors[f'P{p:g}.{name}'] = value
    save(sys.argv[1], tensors, {'source': 'make_layering.py: the definition, pair by pair, float64'})


if __name__ == '__main__':
    main()
