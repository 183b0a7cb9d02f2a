"""The depth-aware background fill that slide_inpaint starts from. Same operators and names as ops/fill and graphs/slide_inpaint."""
import torch
import torch.nn.functional as F

SWEEPS = 4
GAP, REST = 1 / 16, 1e-6  # disparity; weight of pixels that are not behind


def smooth(x):
    """The four-neighbour mean, the border replicated: one Jacobi step of Laplace's equation."""
    p = F.pad(x, (1, 1, 1, 1), mode='replicate')
    return (p[..., :-2, 1:-1] + p[..., 2:, 1:-1] + p[..., 1:-1, :-2] + p[..., 1:-1, 2:]) / 4


def push_pull_fill(x, weight, sweeps=SWEEPS):
    """x: N x C x H x W, weight: N x 1 x H x W in [0, 1] -> x where the weight is 1, a smooth continuation where it is 0.

    Pull: halve, averaging x by weight, until one pixel is left; a cell of which a quarter is known counts as known.
    Push: from the coarsest level up, blend with the bilinear enlargement of the level below, then relax by `sweeps` Jacobi
    steps what is not known.
    """
    h, w = x.shape[-2:]
    if h == 1 and w == 1:
        return x
    mean = F.avg_pool2d(weight, 2, ceil_mode=True)
    coarse = F.avg_pool2d(x * weight, 2, ceil_mode=True) / mean.clamp_min(1e-12)
    y = F.interpolate(push_pull_fill(coarse, (4 * mean).clamp_max(1), sweeps), size=(h, w), mode='bilinear', align_corners=False)
    y = weight * x + (1 - weight) * y
    for _ in range(sweeps):
        y = weight * x + (1 - weight) * smooth(y)
    return y


def background_weight(d, hole):
    """Which pixels show what lies behind the hole: 1 for background, 0 for the hole and for what covers it.

    The disparity of the hole's pixels (the front) is spread over the picture; a pixel belongs to the background as far as it
    is behind the front: wholly from GAP on. The small rest gives a fill where nothing is behind.
    """
    front = push_pull_fill(d, hole, 0)
    return ((1 - hole) * ((front - d) / GAP).clamp(0, 1)).clamp_min(REST)
