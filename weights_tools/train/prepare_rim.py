#!/usr/bin/python3
"""Makes the scenes that slide_rim learns from: photos with alpha, and slide_matte's matte of them, enlarged.

  prepare_rim.py --data DATA --cache CACHE --weights slide_matte.safetensors --out SCENES [--count 700] [--seed 0]

A scene is SCENES/SEED_NNNN.npy, bytes, H x W x 5: RGB, alpha, coarse matte. Four kinds: cut-outs with true alpha and
their estimated colours before a photo or room without a subject; the photos with true alpha as they are; photos with
mattes by IS-Net; cut-outs of these. The last two are small, so their coarse matte is first reduced by as much as a
large photo's would be.
"""
import argparse
import glob
import os

import cv2
import numpy as np
import torch
from PIL import Image

from common import load_safetensors
from depth_data import jitter, resize
from guided import MATTE_RADIUS, guided_upsample
from matte_data import MatteData
from matte_net import MatteNet
from train_matte import coarse_matte

KINDS = {'true composite': .5, 'true photo': .1, 'photo': .25, 'composite': .15}
UNDECIDED = .12  # of a matte's solid part, more soft pixels than that are IS-Net's doubt, not hair
LARGEST = 1200  # pixels of a scene's longer side


def beside(v, axis, step):
    """The neighbours' values along an axis, the border replicated."""
    v = np.moveaxis(v, axis, 0)
    v = np.concatenate([v[1:], v[-1:]]) if step < 0 else np.concatenate([v[:1], v[:-1]])
    return np.moveaxis(v, 0, axis)


def foreground(image, alpha):
    """The subject's colours (Germer et al. 2020: ops/matting/foreground.h); image: H x W x 3, alpha: H x W, all bytes"""
    image, alpha = (v.astype(np.float32) / 255 for v in (image, alpha))
    h, w = alpha.shape
    n = int(np.ceil(np.log2(max(h, w))))
    shifts = ((0, 1), (0, -1), (1, 1), (1, -1))
    front = np.full((1, 1, 3), image[alpha > .9].mean(0) if (alpha > .9).any() else 0, np.float32)
    back = np.full((1, 1, 3), image[alpha < .1].mean(0) if (alpha < .1).any() else 0, np.float32)
    for level in range(n + 1):
        lh, lw = round(h ** (level / n)), round(w ** (level / n))
        small = lambda v: v[np.arange(lh) * v.shape[0] // lh][:, np.arange(lw) * v.shape[1] // lw]
        i, a, front, back = small(image), small(alpha)[..., None], small(front), small(back)
        weights = [1e-5 + np.abs(a - beside(a, *s)) for s in shifts]
        total = sum(weights)
        q = a ** 2 + (1 - a) ** 2 + total
        for _ in range(10 if max(lh, lw) <= 32 else 2):
            f = sum(x * beside(front, *s) for x, s in zip(weights, shifts)) / total
            b = sum(x * beside(back, *s) for x, s in zip(weights, shifts)) / total
            r = i - a * f - (1 - a) * b
            front, back = np.clip(f + a * r / q, 0, 1), np.clip(b + (1 - a) * r / q, 0, 1)
    return (front * 255).round().astype(np.uint8)


class RimScenes(MatteData):
    def __init__(self, data, cache, weights, seed):
        super().__init__(cache, seed)
        self.net = MatteNet()
        self.net.load_state_dict(load_safetensors(weights))
        self.net.eval().to(memory_format=torch.channels_last)
        self.true = []
        for path in sorted(glob.glob(f'{data}/mattes_true/*_image.jpg')):
            image = np.asarray(Image.open(path).convert('RGB'))
            alpha = np.asarray(Image.open(path.replace('_image.jpg', '_alpha.png')).convert('L'))
            self.true.append((image, alpha, None))

    def coarse(self, image, reduction=1.):
        """slide_matte's, enlarged as the runtime does it, of a photo `reduction` times as large; image: bytes"""
        y, small = coarse_matte(self.net, image)
        y = y[0, 0].numpy()
        if reduction > 1:
            y, small = (resize(v, *(round(n / reduction) for n in y.shape)) for v in (y, small))
        return guided_upsample(y.astype(np.float64), small / 255, image / 255, MATTE_RADIUS).clip(0, 1)

    def behind(self, h, w):
        """A photo or room without a subject, enlarged or (which keeps it sharp) tiled with mirrors; some out of focus."""
        rng = self.rng
        if rng.random() < .7:
            source = self.photos[self.empty[rng.integers(len(self.empty))]]
        else:
            source = self.rooms[rng.integers(len(self.rooms))]
        if rng.random() < .45:
            out = resize(source[self.window(*source.shape[:2], w / h)], h, w, cv2.INTER_CUBIC)
        else:
            scale = rng.uniform(.8, 2)
            tile = resize(source, *(int(v * scale) for v in source.shape[:2]), cv2.INTER_CUBIC)
            out = np.pad(tile, ((0, max(0, h - tile.shape[0])), (0, max(0, w - tile.shape[1])), (0, 0)), mode='reflect')
            y, x = rng.integers(0, out.shape[0] - h + 1), rng.integers(0, out.shape[1] - w + 1)
            out = out[y:y + h, x:x + w]
        out = jitter(np.ascontiguousarray(out), rng)
        return cv2.GaussianBlur(out, (0, 0), np.exp(rng.uniform(0, 1.8))) if rng.random() < .3 else out

    def pasted(self, front, alpha, scale):
        """front: bytes, alpha: bytes -> scene, alpha, both in [0, 1]"""
        rng = self.rng
        if rng.random() < .12:
            front = front[..., rng.permutation(3)]
        if rng.random() < .5:
            front, alpha = front[:, ::-1], alpha[:, ::-1]
        ch, cw = (round(v * scale) for v in alpha.shape)
        front, alpha = resize(front, ch, cw), resize(alpha, ch, cw).astype(np.float32) / 255
        h, w = (min(LARGEST, max(256, round(v * rng.uniform(.75, 1.2)))) for v in (ch, cw))
        y, x = rng.uniform(-.3, 1.3) * (h - ch), rng.uniform(-.3, 1.3) * (w - cw)
        turn = cv2.getRotationMatrix2D((cw / 2, ch / 2), rng.uniform(-12, 12) if rng.random() < .5 else 0, 1)
        turn[:, 2] += (x, y)
        a = cv2.warpAffine(alpha, turn, (w, h), flags=cv2.INTER_CUBIC).clip(0, 1)
        c = cv2.warpAffine(front, turn, (w, h), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        return a[..., None] * jitter(c, rng) + (1 - a[..., None]) * self.behind(h, w), a

    def scene(self):
        """-> bytes, H x W x 5, or nothing where slide_matte finds another subject"""
        rng, kind = self.rng, self.rng.choice(list(KINDS), p=list(KINDS.values()))
        reduction = 1.
        if kind.startswith('true'):
            i = rng.integers(len(self.true))
            image, alpha, front = self.true[i]
            scale = rng.uniform(.5, 1.1) * min(1, 1150 / max(alpha.shape))
            if kind == 'true composite':
                if front is None:
                    front = foreground(image, alpha)
                    self.true[i] = image, alpha, front
                rgb, a = self.pasted(front, alpha, scale)
            else:
                h, w = (round(v * scale) for v in alpha.shape)
                rgb, a = jitter(resize(image, h, w), rng), resize(alpha, h, w).astype(np.float32) / 255
        else:
            reduction = rng.uniform(1, 3.2)
            i = self.subjects[rng.integers(len(self.subjects))]
            image, alpha = self.photos[i], self.mattes[i]
            if np.mean((alpha > 25) & (alpha < 230)) > UNDECIDED * np.mean(alpha >= 230):
                return None
            if kind == 'composite':
                rgb, a = self.pasted(foreground(image, alpha), alpha, rng.uniform(.7, 1.3))
            else:
                rgb, a = jitter(image, rng), alpha.astype(np.float32) / 255
        rgb = (rgb.clip(0, 1) * 255).round().astype(np.uint8)
        if rng.random() < .5:
            quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(60, 97))]
            rgb = cv2.imdecode(cv2.imencode('.jpg', rgb, quality)[1], cv2.IMREAD_COLOR)
        y = self.coarse(rgb, reduction)
        union = ((y > .5) | (a > .5)).sum()
        if union < 2000 or ((y > .5) & (a > .5)).sum() < .55 * union:
            return None
        return np.dstack([rgb, (a * 255).round().astype(np.uint8), (y * 255).round().astype(np.uint8)])


def main():
    p = argparse.ArgumentParser()
    for name in ('--data', '--cache', '--weights', '--out'):
        p.add_argument(name, required=True)
    p.add_argument('--count', type=int, default=700)
    p.add_argument('--seed', type=int, default=0)
    a = p.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    os.makedirs(a.out, exist_ok=True)
    scenes, k = RimScenes(a.data, a.cache, a.weights, 1000 + a.seed), 0
    while k < a.count:
        s = scenes.scene()
        if s is not None:
            path = f'{a.out}/{a.seed}_{k:04d}.npy'
            np.save(path + '.part.npy', s)
            os.replace(path + '.part.npy', path)
            k += 1


if __name__ == '__main__':
    main()
