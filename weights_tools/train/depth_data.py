"""Training samples for depth: rooms with measured depth, photos in the wild with disparity by strong networks, cut-outs pasted
before either.

A sample is (rgb, disparity, weight, edge, relative): disparity of any scale and shift; weight, how far each pixel is to be
believed; edge, where a matte or the disparity itself says that it jumps; relative, the factor that turns an error of the (scaled) disparity
into a relative error of depth, zero where depth was never measured.
"""
import cv2
import numpy as np

from common import Ragged

MIXTURE = {'room': .38, 'wild': .37, 'room composite': .12, 'wild composite': .13}
JUMP = .06  # where disparity differs by more within 3x3 pixels, there is an edge: of the range


def resize(x, h, w, mode=cv2.INTER_LINEAR):
    if h < x.shape[0] and mode == cv2.INTER_LINEAR:
        mode = cv2.INTER_AREA
    return cv2.resize(np.ascontiguousarray(x), (w, h), interpolation=mode)


def jitter(x, rng):
    """uint8 -> float32 in [0, 1]: gamma, gain, saturation, colour cast, now and then blur or noise"""
    ramp = (np.arange(256, dtype=np.float32) / 255) ** rng.uniform(.7, 1.4) * rng.uniform(.75, 1.25)
    x = ramp[x]
    grey = x.mean(2, keepdims=True)
    x = (grey + (x - grey) * rng.uniform(.3, 1.4)) * rng.uniform(.88, 1.12, (1, 1, 3)).astype(np.float32)
    t = rng.random()
    if t < .1:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(.4, 1.2))
    elif t < .2:
        x = x + rng.normal(0, rng.uniform(.005, .03), x.shape).astype(np.float32)
    return np.clip(x, 0, 1)


def jumps(d):
    """Where a disparity map has an edge."""
    kernel = np.ones((3, 3), np.uint8)
    return cv2.dilate(d, kernel) - cv2.erode(d, kernel) > JUMP


class DepthData:
    def __init__(self, cache, seed):
        self.rooms, self.depth = np.load(cache + '/rooms_rgb.npy', mmap_mode='r'), np.load(cache + '/rooms_depth.npy', mmap_mode='r')
        self.photos, self.mattes = (Ragged(f'{cache}/{n}') for n in ('photos', 'mattes'))
        self.subject = np.load(cache + '/subject.npy')
        held = set(np.load(cache + '/held.npy'))
        self.usable = np.array([i for i in range(len(self.photos)) if i not in held])
        self.subjects = np.array([i for i in self.usable if self.subject[i] == 2])
        self.wild, self.wild_disparity = Ragged(cache + '/wild_train'), Ragged(cache + '/wild_train_disparity')
        share = np.load(cache + '/wild_train_share.npy')
        self.wild_share = share / share.sum()
        self.cuts, self.cut_alphas = Ragged(cache + '/cuts'), Ragged(cache + '/cuts_alpha')
        self.rng = np.random.default_rng(seed)

    def window(self, h, w, aspect):
        """A crop of 60 to 100 % of the largest window of (nearly) the aspect ratio asked for."""
        aspect *= self.rng.uniform(.87, 1.15)
        ch = min(h, w / aspect) * self.rng.uniform(.6, 1)
        ch, cw = int(ch), min(w, int(ch * aspect))
        y, x = self.rng.integers(0, h - ch + 1), self.rng.integers(0, w - cw + 1)
        return slice(y, y + ch), slice(x, x + cw)

    def room(self, h, w):
        i = self.rng.integers(len(self.rooms))
        s = self.window(*self.depth[i].shape, w / h)
        z = resize(self.depth[i][s], h, w, cv2.INTER_LINEAR).astype(np.float32) / 25.5
        d = 1 / np.maximum(z, .3)
        low, span = d.min(), np.ptp(d) + 1e-6
        return resize(self.rooms[i][s], h, w), (d - low) / span, np.ones_like(d), np.zeros_like(d), span / d

    def wild_photo(self, h, w):
        i = self.rng.choice(len(self.wild), p=self.wild_share)
        s = self.window(*self.wild_disparity[i].shape, w / h)
        d = resize(self.wild_disparity[i][s], h, w).astype(np.float32) / 255
        return resize(self.wild[i][s], h, w), d, np.ones_like(d), jumps(d).astype(np.float32), np.zeros_like(d)

    @staticmethod
    def band(inside):
        kernel = np.ones((5, 5), np.uint8)
        return (cv2.dilate(inside, kernel) - cv2.erode(inside, kernel)).astype(np.float32)

    def paste(self, rgb, d, weight, edge, relative):
        """A cut-out before the scene, nearer than nearly all that it covers."""
        rng, (h, w) = self.rng, d.shape
        if rng.random() < .25:
            i = rng.integers(len(self.cuts))
            image, matte = self.cuts[i], self.cut_alphas[i]
        else:
            i = self.subjects[rng.integers(len(self.subjects))]
            image, matte = self.photos[i], self.mattes[i]
        if not .04 < (matte[::4, ::4] > 127).mean() < .6:
            return rgb, d, weight, edge, relative
        ch = int(h * rng.uniform(.35, 1.1))
        cw = max(2, int(ch * matte.shape[1] / matte.shape[0]))
        cut, alpha = jitter(resize(image, ch, cw), rng), resize(matte, ch, cw).astype(np.float32) / 255
        if rng.random() < .5:
            cut, alpha = cut[:, ::-1], alpha[:, ::-1]
        y0 = h - ch if rng.random() < .6 else rng.integers(-ch // 3, max(1, h - ch // 2))
        x0 = rng.integers(-cw // 3, max(1, w - cw // 2))
        ya, yb, xa, xb = max(0, y0), min(h, y0 + ch), max(0, x0), min(w, x0 + cw)
        if yb <= ya or xb <= xa:
            return rgb, d, weight, edge, relative
        A, X = np.zeros((h, w), np.float32), np.zeros((h, w, 3), np.float32)
        A[ya:yb, xa:xb], X[ya:yb, xa:xb] = alpha[ya - y0:yb - y0, xa - x0:xb - x0], cut[ya - y0:yb - y0, xa - x0:xb - x0]
        solid = A > .5
        if solid.mean() < .02:
            return rgb, d, weight, edge, relative
        near = min(1.2, np.percentile(d[solid][::3], 90) + rng.uniform(.12, .5))
        bulge = .06 * np.minimum(1, cv2.distanceTransform(solid.astype(np.uint8), cv2.DIST_L2, 3) / (.12 * w))
        rgb = A[..., None] * X + (1 - A[..., None]) * rgb
        return (rgb, np.where(solid, np.maximum(d, near + bulge), d), np.where(solid, 1, weight),
                np.maximum(edge * ~solid, self.band(solid.astype(np.uint8))), relative * ~solid)

    def sample(self, h, w):
        kind = self.rng.choice(list(MIXTURE), p=list(MIXTURE.values()))
        rgb, *maps = (self.wild_photo if kind.startswith('wild') else self.room)(h, w)
        rgb = jitter(rgb, self.rng)
        if kind.endswith('composite'):
            for _ in range(self.rng.integers(1, 3)):
                rgb, *maps = self.paste(rgb, *maps)
        if self.rng.random() < .5:
            rgb, maps = rgb[:, ::-1], [m[:, ::-1] for m in maps]
        return [np.ascontiguousarray(v, np.float32) for v in (rgb.transpose(2, 0, 1) * 2 - 1, *maps)]
