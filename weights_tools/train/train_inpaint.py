#!/usr/bin/python3
"""Trains slide_inpaint on composites whose hidden background is known, and on photos with mattes.

  train_inpaint.py --cache CACHE --out inpaint.pt --minutes 60 [--device cuda]

Goes on from inpaint.pt when it exists. prepare_inpaint.py comes first. Loss: around the hole, cross entropy between the weights and
what of a pixel is background by the exact matte; in the hole of composites, the logarithm of the fill's squared error over that of
the fill with weights by disparity alone.
"""
import cv2
import numpy as np
import torch
import torch.nn.functional as F

from common import arguments, resume, train
from fill import REST, background_weight, clear, colour_weight, push_pull_fill
from inpaint_data import Estimated, InpaintData
from inpaint_net import InpaintNet

NEAR = 13  # pixels, side of the window: so near to the hole weights are learnt
ORDER = .03  # by how much in front the subject must be, in disparity, for its matte to tell what covers what
SURROUNDINGS = 31  # ... on average over such windows
GAIN = 3  # of the filled hole, beside the weights' cross entropy


class Batches(torch.utils.data.IterableDataset):
    """(composites, of which half have slide_depth's disparity; and photos) of n x n pixels, for ever."""

    def __init__(self, cache, seed, size, composites, photos):
        self.arguments = cache, seed, size, composites, photos

    def __iter__(self):
        cv2.setNumThreads(1)
        cache, seed, size, composites, photos = self.arguments
        rng = np.random.default_rng(seed)
        own = {n: InpaintData(cache, seed + n, n) for n in (size // 2, size * 3 // 4, size)}
        estimated = Estimated(cache, seed, size)
        while True:
            batch = [self.enlarged(own[rng.choice(list(own))].sample(), size) for _ in range(composites // 2)]
            batch += [estimated.composite() for _ in range(composites - len(batch))] + [estimated.photo() for _ in range(photos)]
            yield [torch.from_numpy(np.stack(t)) for t in zip(*((*s, told(s)) for s in batch))]

    @staticmethod
    def enlarged(sample, n):
        """Soft edges of large photos; hole, mask and outline stay zeros and ones."""
        if sample[2].shape[-1] == n:
            return sample
        y = [F.interpolate(torch.from_numpy(v)[None], size=(n, n), mode='bilinear', align_corners=False)[0].numpy() for v in sample]
        return (*y[:4], *((v > .5).astype(np.float32) for v in y[4:]))


def told(sample):
    """Where the alpha of what is in front tells what of a pixel is background: near the hole, where it stands before its surroundings."""
    _, _, d, alpha, hole, *_ = (v[0] for v in sample)
    mean = lambda v: cv2.blur(v, (SURROUNDINGS, SURROUNDINGS))
    inside, outside = mean(alpha), mean(1 - alpha)
    step = mean(d * alpha) / inside.clip(1e-3) - mean(d * (1 - alpha)) / outside.clip(1e-3)
    near = cv2.dilate(hole, np.ones((NEAR, NEAR), np.uint8))
    return (near * ((inside > .02) & (outside > .02) & (step > ORDER)))[None].astype(np.float32)


def squared(y, truth, mask):
    return ((y - truth) ** 2 * mask).sum(dim=(1, 2, 3)) / (3 * mask.sum(dim=(1, 2, 3))).clamp_min(1)


def inputs(scene, d, hole):
    """Those of InpaintNet.logit()."""
    rgb, behind = scene[:, :3], push_pull_fill(d, background_weight(d, hole))
    weight = colour_weight(d, behind)
    return rgb, push_pull_fill(rgb, weight), d, behind, weight, hole


def losses_of(net, scene, truth, d, alpha, hole, mask, where, composites):
    """-> cross entropy, logarithm of the error over that by disparity alone"""
    with torch.no_grad():
        x = inputs(scene, d, hole)
        target = clear(alpha)
    logit = net.logit(*x)
    entropy = F.binary_cross_entropy_with_logits(logit, target, reduction='none')
    entropy = (entropy * where).sum(dim=(1, 2, 3)) / where.sum(dim=(1, 2, 3)).clamp_min(50)
    c = slice(0, composites)
    filled = push_pull_fill(scene[c, :3], net.weight_of(logit[c]))
    before, after = squared(x[1][c], truth[c], mask[c]), squared(filled, truth[c], mask[c])
    return entropy.mean(), torch.log((after + 1e-3) / (before + 1e-3)).mean()


@torch.no_grad()
def evaluate(net, tests, device):
    lines = []
    for name, samples in tests.items():
        rows, errors = [], []
        for sample in samples:
            scene, truth, d, alpha, hole, mask, _ = (torch.from_numpy(v)[None].to(device) for v in sample)
            x = inputs(scene, d, hole)
            ours = net.weigh(*x)
            if mask.any():
                exact = clear(alpha).clamp_min(REST)
                rows.append([-10 * np.log10(float(squared(push_pull_fill(x[0], w).clamp(-1, 1), truth, mask)) / 4 + 1e-9) for w in (x[4], ours, exact)])
            where = torch.from_numpy(told(sample))[None].to(device)
            if where.sum() > 50:
                errors.append([float(((w - clear(alpha)).abs() * where).sum() / where.sum()) for w in (x[4], ours)])
        text = f'{name}: weights err {np.mean(errors, 0)[0]:.3f} -> {np.mean(errors, 0)[1]:.3f}'
        if rows:
            rows = np.array(rows)
            gain = rows[:, 1] - rows[:, 0]
            text += f', {rows[:, 0].mean():.2f} -> {rows[:, 1].mean():.2f} dB (exact {rows[:, 2].mean():.2f}), better in {100 * (gain > 0).mean():.0f}%, worst {gain.min():+.2f}'
        lines.append(text)
    return '; '.join(lines)


def main():
    a = arguments(2e-3, size=dict(type=int, default=160), composites=dict(type=int, default=6, help='in a batch'),
                  photos=dict(type=int, default=2, help='in a batch'))
    saved, seed = resume(a)
    held = InpaintData(a.cache, 99, 160, held=True)
    tests = {'composites': [held.sample() for _ in range(60)]}
    tests.update({name: samples for name, samples in np.load(a.cache + '/estimated_held.npy', allow_pickle=True).item().items()})
    net = InpaintNet().to(a.device, memory_format=torch.channels_last)
    if saved:
        net.load_state_dict(saved['net'])
    optimiser = torch.optim.AdamW(net.parameters(), lr=a.rate, betas=(.9, .99), weight_decay=1e-3)
    source = Batches(a.cache, seed + 2, a.size, a.composites, a.photos)
    batches = iter(torch.utils.data.DataLoader(source, batch_size=None, num_workers=1, prefetch_factor=4))

    def losses(_):
        scene, truth, d, alpha, hole, mask, _, where = (v.to(a.device) for v in next(batches))
        entropy, error = losses_of(net, scene, truth, d, alpha, hole, mask, where, a.composites)
        return entropy + GAIN * error, {'cross entropy': entropy, 'logarithm of the error': error}

    train(a, saved, net, optimiser, losses, lambda: evaluate(net, tests, a.device))


if __name__ == '__main__':
    main()
