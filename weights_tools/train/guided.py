"""Image-guided upsampling, the definition of ops/guided in numpy: the fast guided filter (He and Sun 2015) with a colour guide."""
import cv2
import numpy as np

RADIUS, MATTE_RADIUS, EPS = 4, 2, 1e-3  # of disparity, of mattes; of both


def guided_coefficients(guide, x, radius=RADIUS, eps=EPS):
    """guide: H x W x C, x: H x W, both float64 -> H x W x (C + 1): a and b of x = a · guide + b, averaged; windows cut at the border."""
    box = lambda v: cv2.boxFilter(v, -1, (2 * radius + 1,) * 2, normalize=False, borderType=cv2.BORDER_CONSTANT).reshape(v.shape)
    pixels = box(np.ones(x.shape))
    mean = lambda v: np.stack([box(np.ascontiguousarray(p)) / pixels for p in np.moveaxis(v, -1, 0)], -1)
    g, m = mean(guide), mean(x[..., None])
    c = guide.shape[-1]
    products = (guide[..., :, None] * guide[..., None, :]).reshape(*x.shape, c * c)
    covariance = mean(products).reshape(*x.shape, c, c) - g[..., :, None] * g[..., None, :] + eps * np.eye(c)
    a = np.linalg.solve(covariance, (mean(guide * x[..., None]) - g * m)[..., None])[..., 0]
    return mean(np.concatenate([a, m - (a * g).sum(-1, keepdims=True)], -1))


def guided_upsample(x, small_guide, guide, radius=RADIUS, eps=EPS):
    """x: h x w, small_guide: h x w x C, guide: H x W x C -> H x W."""
    h, w = guide.shape[:2]
    k = cv2.resize(guided_coefficients(small_guide.astype(np.float64), x.astype(np.float64), radius, eps), (w, h), interpolation=cv2.INTER_LINEAR)
    return (k[..., :-1] * guide).sum(-1) + k[..., -1]
