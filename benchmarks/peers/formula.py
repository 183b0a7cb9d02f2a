"""Weights that are a formula of their names: the same numbers as graphs/formula_weights.cpp makes up."""
import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def fnv1a(text):
    h = 0xcbf29ce484222325
    for byte in text.encode():
        h = (h ^ byte) * 0x100000001b3 & (1 << 64) - 1
    return np.uint64(h)


def unit(text, count):
    """float32 numbers in [-1, 1): SplitMix64 started at the text's FNV-1a hash, top 24 bits."""
    with np.errstate(over='ignore'):
        z = fnv1a(text) + np.arange(1, count + 1, dtype=np.uint64) * GOLDEN
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return ((z >> np.uint64(40)).astype(np.float64) * 2.**-23 - 1).astype(np.float32)


def tensor(name, shape):
    """The float32 array that belongs to a parameter."""
    count = int(np.prod(shape))
    if name.endswith('fuse_weight') and len(shape) >= 2:
        return np.eye(shape[-1], dtype=np.float32).reshape(shape)
    if len(shape) == 4 or len(shape) == 2 and name.endswith('weight'):
        scale = np.float32(np.sqrt(6 / (count / shape[0])))
        return (unit(name, count) * scale).reshape(shape)
    if name.endswith('running_mean'):
        return np.zeros(shape, np.float32)
    if name.endswith('running_var'):
        return np.ones(shape, np.float32)
    offset = np.float32(1 if name.endswith('weight') else 0)
    return (offset + unit(name, count) * np.float32(.1)).reshape(shape)
