#!/usr/bin/python3
"""Trains slide_rim on the scenes of prepare_rim.py.

  train_rim.py --cache CACHE --scenes SCENES --weights slide_matte.safetensors --out rim.pt --minutes 50 [--bf16]
               [--test FOLDER] [--start earlier.pt]

FOLDER holds NAME_image.jpg and NAME_alpha.png with true alpha, none of it among the scenes. Loss: absolute error of
alpha and of its gradients at three scales, with more weight where alpha is soft, as parts of the coarse matte's, and a
little cross entropy.
"""
import glob

import cv2
import numpy as np
import torch
import torch.nn.functional as F

from common import arguments, load_safetensors, resume, train
from depth_data import jitter
from evaluate import gradient_error, matte_of
from matte_net import MatteNet
from rim_net import DOUBT, RimNet, refined

BATCHES = [(.7, 128, 6), (.3, 224, 2)]  # part of them, pixels, windows: many small steps learn faster

HOPELESS = .2  # mean error of the coarse matte in a window: what is missing there cannot be told from nearby


class Crops(torch.utils.data.IterableDataset):
    """Windows about the rim, a batch at a time; scenes made meanwhile are found as they come."""

    def __init__(self, scenes, seed):
        self.arguments = scenes, seed

    def __iter__(self):
        cv2.setNumThreads(1)
        folder, seed = self.arguments
        rng = np.random.default_rng(seed)
        paths, held = [], []
        while True:
            if not held or rng.random() < .05:
                paths = [p for p in glob.glob(folder + '/*.npy') if 'part' not in p]
            while len(held) < 24:
                held.append(np.load(paths[rng.integers(len(paths))]))
            held[rng.integers(len(held))] = np.load(paths[rng.integers(len(paths))])
            held[rng.integers(len(held))] = np.load(paths[rng.integers(len(paths))])
            _, size, batch = BATCHES[rng.choice(len(BATCHES), p=[b[0] for b in BATCHES])]
            out = []
            while len(out) < batch:
                sample = self.window(held[rng.integers(len(held))], rng, size)
                if np.abs(sample[1] - sample[2]).mean() < HOPELESS:
                    out.append(sample)
            yield [torch.from_numpy(np.stack(v)) for v in zip(*out)]

    @staticmethod
    def window(scene, rng, size):
        """-> RGB, alpha, coarse matte in [0, 1], channels first"""
        h, w = scene.shape[:2]
        if min(h, w) < size:
            scene = np.pad(scene, ((0, max(0, size - h)), (0, max(0, size - w)), (0, 0)), mode='edge')
            h, w = scene.shape[:2]
        y, x = rng.integers(0, h - size + 1), rng.integers(0, w - size + 1)
        if rng.random() < .85:
            alpha, coarse = (scene[::4, ::4, c].astype(np.int16) for c in (3, 4))
            rim = np.flatnonzero((np.abs(alpha - coarse) > 26) | (np.abs(alpha - 128) < 115))
            if len(rim):
                at = np.array(divmod(rim[rng.integers(len(rim))], alpha.shape[1])) * 4
                at += rng.integers(-size // 3, size // 3, 2) - size // 2
                y, x = (int(np.clip(c, 0, n - size)) for c, n in zip(at, (h, w)))
        crop = scene[y:y + size, x:x + size]
        for axis in (0, 1):
            if rng.random() < .5:
                crop = np.flip(crop, axis)
        if rng.random() < .5:
            crop = crop.transpose(1, 0, 2)
        rgb = jitter(crop[..., :3], rng)
        planes = lambda v: np.ascontiguousarray(v, np.float32)
        return planes(rgb.transpose(2, 0, 1)), planes(crop[..., 3])[None] / 255, planes(crop[..., 4])[None] / 255


def errors(y, alpha, weight):
    """Of every window: the absolute errors of alpha and of its gradients at three scales, N x 4."""
    mean = lambda v, b: (v.abs() * b).mean(dim=(1, 2, 3)) / b.mean(dim=(1, 2, 3))
    out = [mean(y - alpha, weight)]
    for k in range(3):
        g, b = F.avg_pool2d(y - alpha, 2 ** k), F.avg_pool2d(weight, 2 ** k)
        down = mean(g[..., 1:, :] - g[..., :-1, :], b[..., 1:, :])
        out.append(.5 * down + .5 * mean(g[..., 1:] - g[..., :-1], b[..., 1:]))
    return torch.stack(out, 1)


def loss_of(odds, alpha, coarse):
    """Errors as parts of the coarse matte's, so that a window with a large one does not count for ten others."""
    weight = .3 + 2 * (F.max_pool2d(alpha, 5, 1, 2) + F.max_pool2d(-alpha, 5, 1, 2))
    before, after = errors(coarse, alpha, weight), errors(RimNet.matte_of(odds), alpha, weight)
    part = (after / (before + torch.tensor([.01, .004, .004, .004], device=odds.device))).mean(0)
    entropy = F.binary_cross_entropy_with_logits(odds, DOUBT + (1 - 2 * DOUBT) * alpha)
    return part[0] + .3 * part[1:].mean() + .2 * entropy


def tests_of(folder, weights):
    """Name, photo, its alpha and its coarse matte."""
    net = MatteNet()
    net.load_state_dict(load_safetensors(weights))
    net.eval().to(memory_format=torch.channels_last)
    out = []
    for path in sorted(glob.glob(folder + '/*_image.jpg')):
        image, alpha = cv2.imread(path)[..., ::-1].copy(), cv2.imread(path.replace('_image.jpg', '_alpha.png'), 0) / 255
        out.append((path.split('/')[-1][:-len('_image.jpg')], image, alpha, matte_of(net, image)))
    return out


def figures(y, alpha):
    """Mean error, that within 24 pixels of where alpha is soft or jumps, gradient error."""
    steep = cv2.dilate(alpha, np.ones((3, 3))) - cv2.erode(alpha, np.ones((3, 3))) > .05
    rim = cv2.dilate(steep.astype(np.uint8), np.ones((49, 49))) > 0
    return np.abs(y - alpha).mean(), np.abs(y - alpha)[rim].mean(), gradient_error(y, alpha)


def evaluate(net, tests, bf16):
    if not tests:
        return ''
    lines, rows = [], []
    for name, image, alpha, coarse in tests:
        rows.append([figures(y, alpha) for y in (alpha * 0, coarse, refined(net, image, coarse, bf16))])
        lines.append(f'  {name}: ' + ', '.join(f'{v:.4f} -> {u:.4f}' for v, u in zip(rows[-1][1], rows[-1][2])))
    flat, before, after = np.mean(rows, 0)
    names = ('error', 'at the rim', 'gradient')
    lines.append(', '.join(f'{name} {v:.4f} -> {u:.4f}' for name, v, u in zip(names, before, after)))
    return '\n'.join(lines) + f'; a constant: {flat[2]:.4f}'


def main():
    a = arguments(3e-3, scenes=dict(required=True), weights=dict(required=True, help="slide_matte's"), test=dict(),
                  bf16=dict(action='store_true'),
                  start=dict(help='checkpoint to start from, with a new schedule'))
    saved, seed = resume(a)
    net = RimNet(normed=True)
    if saved:
        net.load_state_dict(saved['net'])
    elif a.start:
        net.load_state_dict(torch.load(a.start)['average'])
    net = net.to(a.device, memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(net.parameters(), lr=a.rate, betas=(.9, .99), weight_decay=1e-3)
    tests = tests_of(a.test, a.weights) if a.test else []
    crops = torch.utils.data.DataLoader(Crops(a.scenes, seed + 5), batch_size=None, num_workers=1, prefetch_factor=4)
    batches = iter(crops)

    def losses(_):
        rgb, alpha, coarse = (v.to(a.device) for v in next(batches))
        with torch.autocast(a.device, torch.bfloat16, enabled=a.bf16 or a.device == 'cuda'):
            odds = net.odds(rgb, coarse).float()
        loss = loss_of(odds, alpha, coarse)
        error = lambda y: (y - alpha).abs().mean()
        return loss, {'loss': loss, 'error': error(RimNet.matte_of(odds.detach())), 'coarse': error(coarse)}

    train(a, saved, net, optimiser, losses, lambda: evaluate(net, tests, a.bf16))


if __name__ == '__main__':
    main()
