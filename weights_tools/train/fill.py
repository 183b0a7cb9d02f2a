"""The depth-aware background fill that slide_inpaint starts from. Same operators and names as ops/fill and graphs/slide_inpaint."""
import torch
import torch.nn.functional as F

SWEEPS = 4
GAP, REST = 1 / 16, 1e-11  # disparity; weight of pixels that are not behind
WINDOW, LEAST = 9, 1 / 128  # pixels, side of the window whose largest disparity is the cover's; smallest step that counts
FAR, NEAR = .1, .4  # of the way from the background's disparity to the cover's: background wholly up to FAR, not from NEAR on
MATTE_REACH = 60  # the photo's longer side over it: around the subject its matte counts
CLEAR = .1  # alpha from which a pixel of an exact matte is not background at all
DETAIL, DETAIL_LIMIT = 1.75, .1  # gain and largest amount of mirrored detail
TRUST = 16  # a cell whose mean weight is over 1 / TRUST counts as known


def smooth(x):
    """The four-neighbour mean, the border replicated: one Jacobi step of Laplace's equation."""
    p = F.pad(x, (1, 1, 1, 1), mode='replicate')
    return (p[..., :-2, 1:-1] + p[..., 2:, 1:-1] + p[..., 1:-1, :-2] + p[..., 1:-1, 2:]) / 4


def halve(x):
    """Every second sample after the binomial filter (1 3 3 1) / 8 along rows and columns; zero beyond the border."""
    n, c, h, w = x.shape
    k = torch.tensor([1., 3., 3., 1.], dtype=x.dtype, device=x.device) / 8
    y = F.pad(x, (1, 1 + w % 2, 1, 1 + h % 2)).flatten(0, 1)[:, None]
    return F.conv2d(y, (k[:, None] * k)[None, None], stride=2).view(n, c, (h + 1) // 2, (w + 1) // 2)


def push_pull_fill(x, weight, sweeps=SWEEPS):
    """x: N x C x H x W, weight: N x 1 x H x W in [0, 1] -> x where the weight is 1, a smooth continuation where it is 0.

    Pull: halve, averaging x by weight, until one pixel is left.
    Push: from the coarsest level up, blend with the bilinear enlargement of the level below, then relax by `sweeps` Jacobi
    steps what is not known.
    """
    h, w = x.shape[-2:]
    if h == 1 and w == 1:
        return x
    mean = halve(weight)
    coarse = halve(x * weight) / mean.clamp_min(1e-12)
    y = F.interpolate(push_pull_fill(coarse, (TRUST * mean).clamp_max(1), sweeps), size=(h, w), mode='bilinear', align_corners=False)
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


def colour_weight(d, behind):
    """Which pixels have the background's colour, whether or not they are in the hole: by where their disparity lies between the
    background's, continued (behind), and the cover's, the largest around.

    Disparity is grown and soft, so a rim of the hole is background, and some of what lies just outside of it is not.
    """
    way = (d - behind) / (F.max_pool2d(d, WINDOW, 1, WINDOW // 2) - behind).clamp_min(LEAST)
    return ((NEAR - way) / (NEAR - FAR)).clamp(REST, 1)


def clear(alpha):
    """What of a pixel is background, by an exact matte of what covers it."""
    return (1 - alpha / CLEAR).clamp(0, 1)


def followed(alpha):
    """What matted_weight() takes of a matte that agrees with disparity everywhere: how far a pixel, unmixed, shows the background, and 1
    near the matte's rim."""
    reach = (max(alpha.shape[-2:]) + MATTE_REACH // 2) // MATTE_REACH
    around = lambda x, r: F.max_pool2d(x, 2 * r + 1, 1, r)
    rim = torch.maximum(4 * alpha * (1 - alpha), around(alpha, 1) + around(-alpha, 1)) > .1
    return ((.9 - alpha) / .4).clamp(0, 1), around(rim.to(alpha.dtype), reach)


def matted_weight(weight, clear, agreement):
    """colour_weight() with a matte of the subject: near it the matte's outline replaces the disparity's."""
    return (weight + agreement * (clear - weight)).clamp(REST, 1)


def mirror_known(x, weight):
    """Pixels of weight < 1/2 take the value mirrored at the nearest known pixel (of several the first, row by row); reflected
    at the border."""
    if len(x) > 1:
        return torch.cat([mirror_known(a, b) for a, b in zip(x.split(1), weight.split(1))])
    h, w = x.shape[-2:]
    known = weight[0, 0] >= .5
    i, j = torch.arange(h)[:, None].expand(h, w), torch.arange(w)[None].expand(h, w)
    up = torch.cummax(torch.where(known, i, -4 * h), 0).values
    down = torch.cummin(torch.where(known, i, 4 * h).flip(0), 0).values.flip(0)
    row = torch.where(i - up <= down - i, up, down)
    best = torch.full((h, w), 2 ** 62)
    for k in range(w):
        if k * k * h * w > best.max():
            break
        for s in (-k, k):
            a, b = max(0, -s), min(w, w - s)
            r = row[:, a + s:b + s]
            key = ((k * k + (i[:, a:b] - r) ** 2) * h + r) * w + j[:, a + s:b + s]
            best[:, a:b] = torch.minimum(best[:, a:b], torch.where((r >= 0) & (r < h), key, 2 ** 62))
    if not known.any():
        return x
    mirrored = lambda q, p, n: torch.minimum((2 * q - p).abs(), 2 * (n - 1) - (2 * q - p).abs())
    return x[..., mirrored(best // w % h, i, h), mirrored(best % w, j, w)]


def gauss(x):
    """Deviation 1, seven taps, the border replicated."""
    n, c, h, w = x.shape
    k = torch.exp(-torch.arange(-3, 4, dtype=x.dtype) ** 2 / 2)
    y = F.pad(x, (3, 3, 3, 3), mode='replicate').flatten(0, 1)[:, None]
    return F.conv2d(F.conv2d(y, (k / k.sum()).view(1, 1, 1, 7)), (k / k.sum()).view(1, 1, 7, 1)).view(n, c, h, w)


def detail(rgb, weight, known):
    """Texture for the unknown: what the background is beyond its own blur, mirrored into the hole at the outline of `known`. The limit
    keeps edges out."""
    fine = weight * (rgb - gauss(rgb * weight) / gauss(weight))
    return (1 - weight) * (DETAIL * mirror_known(fine, known)).clamp(-DETAIL_LIMIT, DETAIL_LIMIT)


def background_fill(rgbd, d, hole, matte=None, network=None):
    """matte: followed() of the subject's; network: InpaintNet, for the weights -> RGBD of the background in [-1, 1], smooth; the
    same with detail(); the weight that its colours have. Disparity is continued by background_weight()."""
    rgb, behind = rgbd[:, :3], push_pull_fill(d, background_weight(d, hole))
    colours = colour_weight(d, behind)
    known = colours
    if network is not None:
        colours = network.weigh(rgb, push_pull_fill(rgb, colours), d, behind, colours, hole)
    if matte is not None:
        known, colours = (matted_weight(w, *matte) for w in (known, colours))
    smooth, disparity = push_pull_fill(rgb, colours), 2 * behind - 1
    return torch.cat([smooth, disparity], 1), torch.cat([smooth + detail(rgb, colours, known), disparity], 1), colours
