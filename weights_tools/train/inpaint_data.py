"""Composites whose hidden background is known, and photos with a matte, with holes as the project's own layering makes them.

A cut-out is pasted before a photo or a room. The scene's disparity is as soft and as badly aligned as a network's; D1 and the
soft disocclusion S follow section 2 of the specification for a random parallax P; the hole is S > 0.05, grown by a pixel.
Where the background photo uncovers parts of its own the truth is not known: those pixels carry no loss. Some of the cut-outs are
free-form strokes, for holes of shapes that no subject has; they are nearer than the scene too, so all that follows is the same.
"""
import glob

import cv2
import numpy as np

from common import Ragged
from depth_data import DepthData, resize
from pseudo_depth import SCALE

ESTIMATED_SIZE = 256  # pixels: sides of the composites whose disparity is estimated


def estimated_subjects(cache):
    """Photos with a subject, none of them held out."""
    held, subject = set(np.load(cache + '/held.npy')), np.load(cache + '/subject.npy')
    return np.array([i for i in np.nonzero(subject == 2)[0] if i not in held])


def condition(d):
    """Section 2.1: Gauss of deviation 1, then 3x3 maximum, the border replicated."""
    return cv2.dilate(cv2.GaussianBlur(d, (7, 7), 1, borderType=cv2.BORDER_REPLICATE), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)


def floor_of(d, rho):
    """Cone erosion along rows and columns; the radius of section 2.3 loses nothing and is left out."""
    def along(v):
        v = v.copy()
        for i in range(1, len(v)):
            np.minimum(v[i], v[i - 1] + rho, out=v[i])
        for i in range(len(v) - 2, -1, -1):
            np.minimum(v[i], v[i + 1] + rho, out=v[i])
        return v
    return np.minimum(along(d), along(np.ascontiguousarray(d.T)).T)


def layering(d, parallax):
    """D in [0, 1] -> D1, its floor, the hole"""
    d1 = condition(d)
    low = floor_of(d1, 1 / parallax)
    s = np.tanh(parallax * (d1 - low))
    return d1, low, cv2.dilate((s > .05).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)


def brush(n, rng):
    """Free-form strokes (Yu et al. 2019, algorithm 1) over n x n pixels: uint8, 255 inside"""
    out = np.zeros((n, n), np.uint8)
    for _ in range(rng.integers(1, 4)):
        width, angle, at = int(n * rng.uniform(.05, .16)), rng.uniform(0, 2 * np.pi), rng.uniform(0, n, 2)
        for _ in range(rng.integers(2, 7)):
            angle += rng.normal(0, .8)
            to = at + n * rng.uniform(.08, .3) * np.array([np.cos(angle), np.sin(angle)])
            cv2.line(out, tuple(int(v) for v in at), tuple(int(v) for v in to), 255, width, cv2.LINE_AA)
            at = to
    return out


def finished(scene, truth, d, alpha, parallax):
    """RGB in [0, 1] (n x n x 3; truth: of what is behind, or None), disparity and alpha (n x n) -> scene and truth (RGB in [-1, 1], the scene
    with disparity in [-1, 1]), D1, alpha of what is in front, hole, where in it the truth is known, true outline"""
    low, span = d.min(), np.ptp(d) + 1e-6
    d1, _, hole = layering(((d - low) / span).astype(np.float32), parallax)
    cover = cv2.dilate((alpha > .02).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
    planes = lambda v: np.ascontiguousarray(v.transpose(2, 0, 1) * 2 - 1, np.float32)
    mask = hole * cover if truth is not None else 0 * hole
    return (planes(np.concatenate([scene, d1[..., None]], 2)), planes(scene if truth is None else truth),
            *(v[None].astype(np.float32) for v in (d1, alpha, hole, mask, cover)))


class InpaintData(DepthData):
    def __init__(self, cache, seed, size, held=False, strokes=.15):
        super().__init__(cache, seed)
        self.disparities = Ragged(cache + '/disparities')
        self.size, self.strokes = size, 0 if held else strokes
        if held:
            every = np.load(cache + '/held.npy')
            self.usable, self.subjects = every, np.array([i for i in every if self.subject[i] == 2])
            self.rooms, self.depth = np.load(cache + '/holdout_rgb.npy', mmap_mode='r'), np.load(cache + '/holdout_depth.npy', mmap_mode='r')

    def background(self):
        n, rng = self.size, self.rng
        if rng.random() < .2:
            i = rng.integers(len(self.rooms))
            image, d, scale = self.rooms[i], 1 / np.maximum(self.depth[i].astype(np.float32) / 25.5, .5), .45
        else:
            i = self.usable[rng.integers(len(self.usable))]
            image, d, scale = self.photos[i], self.disparities[i].astype(np.float32) / SCALE, 1.
        h, w = d.shape
        s = int(min(h, w) * rng.uniform(.55, 1))
        y, x = rng.integers(0, h - s + 1), rng.integers(0, w - s + 1)
        return resize(image[y:y + s, x:x + s], n, n).astype(np.float32) / 255, resize(d[y:y + s, x:x + s], n, n) * scale

    def composite(self):
        """-> scene, truth, disparity, alpha of the cut-out, parallax: as finished() takes them"""
        n, rng = self.size, self.rng
        while True:
            rgb, d = self.background()
            i = self.subjects[rng.integers(len(self.subjects))]
            image, matte = self.photos[i], self.mattes[i]
            scale = n * rng.uniform(.5, 1.4) / matte.shape[0]
            move = np.float32([[scale, 0, rng.uniform(-.4, .9) * n], [0, scale, rng.uniform(-.4, .8) * n]])
            if rng.random() < .5:
                image, matte = image[:, ::-1], matte[:, ::-1]
            alpha = cv2.warpAffine(np.ascontiguousarray(matte), move, (n, n), flags=cv2.INTER_AREA).astype(np.float32) / 255
            if self.strokes and rng.random() < self.strokes:
                alpha = brush(n, rng).astype(np.float32) / 255
            if .05 < (alpha > .5).mean() < .6:
                break
        cut = cv2.warpAffine(np.ascontiguousarray(image), move, (n, n), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT).astype(np.float32) / 255
        scene = alpha[..., None] * cut + (1 - alpha[..., None]) * rgb
        near = np.percentile(d[alpha > .5], 95) + rng.uniform(.1, .6)
        front = cv2.GaussianBlur(np.where(alpha > rng.uniform(.15, .6), 1, 0).astype(np.float32), (0, 0), np.exp(rng.uniform(np.log(.3), np.log(3))))
        return scene, rgb, front * np.maximum(near, d) + (1 - front) * d, alpha, np.exp(rng.uniform(np.log(5), np.log(n * .22)))

    def sample(self):
        """As finished()."""
        while True:
            s = finished(*self.composite())
            if s[5].sum() >= 40:
                return s


class Estimated:
    """Composites and photos with the disparity that slide_depth makes of them (prepare_inpaint.py), in n x n windows, scaled at random."""

    def __init__(self, cache, seed, size):
        self.size, self.rng = size, np.random.default_rng(seed)
        parts = range(len(glob.glob(cache + '/estimated_composites_*_disparity.npy')))
        read = lambda name: [np.load(f'{cache}/estimated_{name.format(k)}.npy', mmap_mode='r') for k in parts]
        self.pictures, self.disparities = read('composites_{}'), read('composites_{}_disparity')
        self.photos, self.mattes, self.flat, self.at = Ragged(cache + '/photos'), Ragged(cache + '/mattes'), read('photos_{}'), []
        for part, index in enumerate(read('photos_{}_index')):
            h, w = self.photos.index[index][:, :2].T
            begin = np.concatenate([[0], np.cumsum(h * w)])
            self.at += [(part, i, b, e) for i, b, e in zip(index, begin, begin[1:])]

    def window(self, planes):
        """planes: C x h x w, float32"""
        n, rng = self.size, self.rng
        h, w = planes.shape[1:]
        s = int(min(h, w, n / np.exp(rng.uniform(np.log(.6), np.log(2.5)))))
        y, x = rng.integers(0, h - s + 1), rng.integers(0, w - s + 1)
        cut = planes[:, y:y + s, x:x + s]
        if rng.random() < .5:
            cut = cut[..., ::-1]
        cut = np.stack([resize(plane, n, n) for plane in cut], 2)
        return cut, np.exp(rng.uniform(np.log(5), np.log(.22 * n)))

    def composite(self):
        while True:
            part = self.rng.integers(len(self.pictures))
            k = self.rng.integers(len(self.pictures[part]))
            v, parallax = self.window(np.concatenate([self.pictures[part][k] / np.float32(255), self.disparities[part][k][None].astype(np.float32)]))
            s = finished(v[..., :3], v[..., 3:6], v[..., 7], v[..., 6], parallax)
            if s[5].sum() >= 40:
                return s

    def photo(self):
        while True:
            part, i, begin, end = self.at[self.rng.integers(len(self.at))]
            matte = self.mattes[i]
            d = self.flat[part][begin:end].reshape(matte.shape).astype(np.float32)
            v, parallax = self.window(np.concatenate([self.photos[i].transpose(2, 0, 1) / np.float32(255), d[None], matte[None] / np.float32(255)]))
            s = finished(v[..., :3], None, v[..., 3], v[..., 4], parallax)
            if (s[4] * s[6]).sum() >= 40:
                return s
