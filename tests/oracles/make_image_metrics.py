#!/usr/bin/python3
"""Numbers of tests/eval/image_metrics_test.cpp, from the papers' definitions with SciPy in float64, and FLIP's from the
authors' own package (PyPI: flip-evaluator), which computes in float32.

  make_image_metrics.py      Debian: python3-numpy python3-scipy; in a venv: numpy scipy flip-evaluator
"""
import numpy as np
from scipy.ndimage import convolve, correlate

W, H = 100, 84


def triangle(t, half):
    return abs(t % (2 * half) - half) * 255 // half


def pictures():
    a, b = np.zeros((H, W, 3)), np.zeros((H, W, 3))
    value = lambda x, y, c: (triangle(x * (c + 2) + y, 23) + triangle(3 * y + x * c, 37)) // 2
    for y in range(H):
        for x in range(W):
            for c in range(3):
                a[y, x, c] = value(x, y, c)
                noise = (x * 7919 + y * 104729 + c * 31) % 41 - 20
                b[y, x, c] = min(255, max(0, value(x + 1, y, c) + noise + (30 if x > 60 else 0)))
    return a / 255, b / 255


def luma(p): return p @ [.299, .587, .114]


def window_mean(p):
    k = np.exp(-np.arange(-5, 6) ** 2 / 4.5)
    k = np.outer(k, k)
    return convolve(p, k, mode='constant') / convolve(np.ones_like(p), k, mode='constant')


def similarity(a, b):
    ma, mb = window_mean(a), window_mean(b)
    va, vb, cov = window_mean(a * a) - ma ** 2, window_mean(b * b) - mb ** 2, window_mean(a * b) - ma * mb
    return (2 * ma * mb + 1e-4) / (ma ** 2 + mb ** 2 + 1e-4), (2 * cov + 9e-4) / (va + vb + 9e-4)


def halved(p):
    p = np.pad(p, ((0, p.shape[0] % 2), (0, p.shape[1] % 2)), mode='edge')
    return (p[::2, ::2] + p[1::2, ::2] + p[::2, 1::2] + p[1::2, 1::2]) / 4


def mean(p, w): return (p * w).sum() / w.sum()


def ms_ssim(a, b, w):
    result = 1
    for i, power in enumerate([.0448, .2856, .3001, .2363, .1333]):
        if i:
            a, b, w = halved(a), halved(b), halved(w)
        l, cs = similarity(a, b)
        result *= mean(l * cs if i == 4 else cs, w) ** power
    return result


def gmsd(a, b, w):
    k = np.array([[-1, 0, 1]] * 3) / 3
    g = lambda p: np.hypot(correlate(p, k, mode='nearest'), correlate(p, k.T, mode='nearest')) * 255
    p, q = g(a), g(b)
    s = (2 * p * q + 170) / (p * p + q * q + 170)
    return np.sqrt(mean((s - mean(s, w)) ** 2, w))


def main():
    a, b = pictures()
    mask = np.zeros((H, W))
    mask[17:H - 17, 20:W - 20] = 1
    ones = np.ones((H, W))
    x, y = luma(a), luma(b)
    for name, w in (('everywhere', ones), ('without border', mask)):
        l, cs = similarity(x, y)
        print(name)
        print('  psnr    %.15g' % (-10 * np.log10(mean(((a - b) ** 2).mean(2), w))))
        print('  ssim    %.15g' % mean(l * cs, w))
        print('  ms_ssim %.15g' % ms_ssim(x, y, w))
        print('  gmsd    %.15g at half size, %.15g at full size' % (gmsd(halved(x), halved(y), halved(w)), gmsd(x, y, w)))
    try:
        import flip_evaluator
    except ImportError:
        return
    error, total, _ = flip_evaluator.evaluate(a.astype(np.float32), b.astype(np.float32), 'LDR', applyMagma=False)
    error = error[..., 0] if error.ndim == 3 else error
    print('flip: mean %.7g, without border %.7g' % (total, mean(error, mask)))
    for px, py in ((0, 0), (50, 40), (61, 40), (99, 83), (30, 10)):
        print('  (%d, %d) %.7g' % (px, py, error[py, px]))


main()
