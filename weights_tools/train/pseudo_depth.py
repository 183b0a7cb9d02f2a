"""Pseudo-disparity for a photo that has only a soft matte, after the photo pop-up prior (Hoiem et al. 2005).

The background is a ground plane whose disparity grows from the horizon to the lower edge. Each connected part of the
subject stands on it: it has the disparity of the ground at its feet, and bulges a little in its middle. A part cut by the
lower edge of the picture is near. In a close-up (a large subject) the background falls back.
"""
import numpy as np
from scipy import ndimage

HORIZON, FAR, SLOPE = .42, .06, .8
SCALE = 200  # disparity is stored as round(SCALE * d), d <= 1.2


def ground(v):
    """Disparity of the ground plane at height v in [0, 1] (0 is the top)."""
    return FAR + SLOPE * np.clip((v - HORIZON) / (1 - HORIZON), 0, 1)


def pseudo_disparity(matte):
    """matte: H x W uint8 -> disparity H x W float32 in [0, 1], and whether there is a subject at all"""
    h, w = matte.shape
    m = matte.astype(np.float32) / 255
    plane = np.broadcast_to(ground(np.linspace(0, 1, h, dtype=np.float32)[:, None]), (h, w)).copy()
    area = (m > .5).mean()
    if area < .02:
        return plane, False
    if area > .35:
        plane *= max(.15, 1 - 1.6 * (area - .35))
    parts, n = ndimage.label(ndimage.binary_closing(m > .5, iterations=2))
    subject = np.zeros((h, w), np.float32)
    for k in range(1, n + 1):
        part = parts == k
        if part.sum() < .004 * h * w:
            continue
        feet = np.percentile(np.nonzero(part)[0], 97) / (h - 1)
        base = .9 if feet > .96 else max(float(ground(feet)), .45)
        inside = ndimage.distance_transform_edt(part)
        subject[part] = base + .08 * np.minimum(1, inside[part] / (.12 * w))
    if not subject.any():
        return plane, False
    nearest = ndimage.distance_transform_edt(subject == 0, return_distances=False, return_indices=True)
    alpha = np.clip((m - .3) / .4, 0, 1) * ndimage.binary_dilation(subject > 0, iterations=6)
    return alpha * subject[nearest[0], nearest[1]] + (1 - alpha) * np.minimum(plane, .95), True
