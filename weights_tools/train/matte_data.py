"""Training samples for mattes: photos with the mattes given, and cut-outs pasted on photos and rooms, where alpha is exact."""
import cv2
import numpy as np

from depth_data import DepthData, jitter, resize


class MatteData(DepthData):
    def __init__(self, cache, seed):
        super().__init__(cache, seed)
        self.known = np.array([i for i in self.usable if self.subject[i] > 0])
        self.empty = np.array([i for i in self.usable if self.subject[i] == 1])

    def background(self, h, w):
        if self.rng.random() < .5:
            image = self.photos[self.empty[self.rng.integers(len(self.empty))]]
        else:
            image = self.rooms[self.rng.integers(len(self.rooms))]
        return resize(image[self.window(*image.shape[:2], w / h)], h, w)

    def composite(self, h, w):
        rng = self.rng
        rgb, alpha = jitter(self.background(h, w), rng), np.zeros((h, w), np.float32)
        for _ in range(1 if rng.random() < .7 else 2):
            i = self.subjects[rng.integers(len(self.subjects))]
            image, matte = self.photos[i], self.mattes[i]
            size = rng.uniform(.45, 1.15) * min(h / matte.shape[0], w / matte.shape[1])
            move = np.float32([[size, 0, rng.uniform(-.1, 1.1) * (w - size * matte.shape[1])], [0, size, rng.uniform(-.1, 1.1) * (h - size * matte.shape[0])]])
            if rng.random() < .5:
                image, matte = image[:, ::-1], matte[:, ::-1]
            image, matte = np.ascontiguousarray(image), np.ascontiguousarray(matte)
            m = cv2.warpAffine(matte, move, (w, h), flags=cv2.INTER_LINEAR).astype(np.float32) / 255
            c = jitter(cv2.warpAffine(image, move, (w, h), flags=cv2.INTER_LINEAR), rng)
            rgb = m[..., None] * c + (1 - m[..., None]) * rgb
            alpha = np.maximum(alpha, m)
        return rgb, alpha

    def sample(self, h, w):
        if self.rng.random() < .3:
            rgb, alpha = self.composite(h, w)
        else:
            i = self.known[self.rng.integers(len(self.known))]
            s = self.window(*self.mattes[i].shape, w / h)
            rgb, alpha = jitter(resize(self.photos[i][s], h, w), self.rng), resize(self.mattes[i][s], h, w).astype(np.float32) / 255
        if self.rng.random() < .5:
            rgb, alpha = rgb[:, ::-1], alpha[:, ::-1]
        return np.ascontiguousarray(rgb.transpose(2, 0, 1), np.float32), np.ascontiguousarray(alpha, np.float32)
