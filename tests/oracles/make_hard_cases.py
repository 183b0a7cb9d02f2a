#!/usr/bin/python3
"""Operator cases at the limits of float32, with exact answers rounded once to float64, without a library.

  make_hard_cases.py OUT_DIR      writes OUT_DIR/<name>.safetensors; the format is that of docs/operators.md

Sums by math.fsum or in fractions, functions in 60 decimal digits.
"""
import decimal
import itertools
import math
import sys
from decimal import Decimal
from fractions import Fraction

from make_exact_cases import Maker, Tensor, convolve, rounded

decimal.getcontext().prec = 60
decimal.getcontext().Emin, decimal.getcontext().Emax = -10000, 10000
LARGEST = float.fromhex('0x1.fffffep127')


def root(x):
    """Of a Fraction."""
    return (Decimal(x.numerator) / Decimal(x.denominator)).sqrt()


def decimal_of(x):
    return Decimal(x.numerator) / Decimal(x.denominator)


def statistics(values):
    exact = [Fraction(v) for v in values]
    mean = sum(exact) / len(exact)
    return mean, sum((v - mean) ** 2 for v in exact) / len(exact)


def planted(t, *pairs):
    for at, value in pairs:
        t.values[at] = value
    return t


class Hard(Maker):
    def convolve(self, name, x, weight, bias=None, padding=0, groups=1):
        inputs = {'x': x, 'weight': weight} | ({'bias': bias} if bias else {})
        attributes = {'padding': [padding] * 4, 'groups': groups}
        self.write(name, 'conv2d', attributes, inputs,
                   *convolve(x, weight, bias, [1, 1], [padding] * 4, [1, 1], groups))

    def group_norm(self, name, x, groups, eps=1e-5):
        _, channels, h, w = x.shape
        weight, bias = self.normal(channels), self.normal(channels)
        size = channels // groups * h * w
        out = []
        for g in range(groups):
            values = x.values[g * size:(g + 1) * size]
            mean, variance = statistics(values)
            deviation = root(variance + Fraction(eps))
            for i, v in enumerate(values):
                c = g * channels // groups + i // (h * w)
                out.append(float(decimal_of(Fraction(v) - mean) / deviation * Decimal(weight.values[c])
                                 + Decimal(bias.values[c])))
        self.write(name, 'group_norm', {'groups': groups, 'eps': eps}, {'x': x, 'weight': weight, 'bias': bias},
                   x.shape, out)

    def layer_norm(self, name, x, eps=1e-6):
        """Along axis 1, of 1 x channels x 1 x tokens."""
        _, channels, _, tokens = x.shape
        weight, bias = self.normal(channels), self.normal(channels)
        out = [0.0] * len(x.values)
        for t in range(tokens):
            mean, variance = statistics(x.values[t::tokens])
            deviation = root(variance + Fraction(eps))
            for c in range(channels):
                at = c * tokens + t
                out[at] = float(decimal_of(Fraction(x.values[at]) - mean) / deviation * Decimal(weight.values[c])
                                + Decimal(bias.values[c]))
        self.write(name, 'layer_norm', {'axis': 1, 'eps': eps}, {'x': x, 'weight': weight, 'bias': bias}, x.shape, out)

    def attention(self, name, query, key, value, scale=0.25):
        """One head, 1 x channels x 1 x tokens."""
        depth, queries, keys, channels = query.shape[1], query.shape[3], key.shape[3], value.shape[1]
        out = [0.0] * (channels * queries)
        for i in range(queries):
            scores = [decimal_of(sum(Fraction(query.values[c * queries + i]) * Fraction(key.values[c * keys + j])
                                     for c in range(depth)) * Fraction(scale)) for j in range(keys)]
            weights = [(s - max(scores)).exp() for s in scores]
            for c in range(channels):
                row = value.values[c * keys:(c + 1) * keys]
                out[c * queries + i] = float(sum(w * Decimal(v) for w, v in zip(weights, row)) / sum(weights))
        self.write(name, 'attention', {'heads': 1, 'scale': scale}, {'query': query, 'key': key, 'value': value},
                   [1, channels, 1, queries], out)

    def unary(self, name, values, function):
        x = Tensor([len(values)], (rounded(v) for v in values))
        self.write(f'{name}_ends', name, {}, {'x': x}, x.shape, (function(v) for v in x.values))


def convolutions(m):
    sigma = 1 / math.sqrt(24 * 9)
    weight = m.normal(24, 24, 3, 3, sigma=sigma)
    m.convolve('conv2d_large_mean', m.normal(1, 24, 12, 20, mean=1e4), weight, m.normal(24), 1)
    laplacian = Tensor([2, 16, 3, 3], [v / 16 for v in (0, 1, 0, 1, -4, 1, 0, 1, 0)] * 32)
    m.convolve('conv2d_laplacian_on_1e4', m.normal(1, 16, 10, 18, mean=1e4), laplacian)
    half = m.normal(1, 8, 8, 8, sigma=1e3)
    x = Tensor([1, 16, 8, 8], half.values + [-v for v in half.values])
    row = m.normal(9, 8, 3, 3, sigma=0.1)
    weight = Tensor([9, 16, 3, 3], [v for f in range(9) for v in row.values[f * 72:(f + 1) * 72] * 2])
    m.convolve('conv2d_cancels_exactly', x, weight, m.normal(9), 1)
    m.convolve('conv2d_1x1_deep', m.normal(1, 4096, 1, 3, sigma=1e3), m.normal(3, 4096, 1, 1), m.normal(3))
    for name, size in (('conv2d_ends_1e38', 1e38), ('conv2d_past_1e35', 1e35)):
        x = m.normal(1, 16, 8, 12)
        x.values = [rounded(max(-3, min(3, v)) * size) for v in x.values]
        m.convolve(name, x, m.normal(16, 16, 3, 3, sigma=1e-3), None, 1)
    m.convolve('conv2d_denormal', m.normal(1, 16, 8, 12, sigma=1e-37), m.normal(16, 16, 3, 3, sigma=0.05), None, 1)
    m.convolve('conv2d_weights_1e-30', m.normal(1, 16, 8, 12, sigma=1e30), m.normal(16, 16, 3, 3, sigma=1e-30), None, 1)
    spread = m.normal(1, 16, 8, 12)
    spread.values = [rounded(v * 10.0 ** (i % 13 - 6)) for i, v in enumerate(spread.values)]
    m.convolve('conv2d_range_1e12', spread, m.normal(16, 16, 3, 3, sigma=0.1), None, 1)
    m.convolve('conv2d_depthwise_mean', m.normal(1, 4, 9, 17, mean=1e4), m.normal(4, 1, 3, 3), m.normal(4), 1, 4)


def normalisations(m):
    m.group_norm('group_norm_mean_1e6', m.normal(1, 4, 5, 7, mean=1e6), 2)
    m.group_norm('group_norm_mean_1e8', m.normal(1, 4, 5, 7, mean=1e8, sigma=8), 2)
    m.group_norm('group_norm_ends', m.normal(1, 4, 5, 7, sigma=5e37), 2)
    m.group_norm('group_norm_denormal', m.normal(1, 4, 5, 7, sigma=1e-36), 2, 0)
    m.group_norm('group_norm_constant', Tensor([1, 4, 5, 7], [3.25] * 140), 2)
    weight = m.normal(5, 4, 3, 3, mean=1e4)
    out = []
    for f in range(5):
        values = weight.values[f * 36:(f + 1) * 36]
        mean, variance = statistics(values)
        out += [float(decimal_of(Fraction(v) - mean) / root(variance + Fraction(1e-5))) for v in values]
    m.write('weight_standardise_mean_1e4', 'weight_standardise', {'eps': 1e-5}, {'weight': weight}, weight.shape, out)
    x = m.normal(1, 3, 4, 5, mean=2)
    p = {'weight': Tensor([3], [rounded(1e-38), 1, rounded(1e30)]), 'bias': m.normal(3),
         'running_mean': m.normal(3, mean=2), 'running_var': Tensor([3], [rounded(1e30), rounded(1e-12), 1])}
    out = []
    for i, v in enumerate(x.values):
        c = i // 20
        deviation = root(Fraction(p['running_var'].values[c]) + Fraction(1e-5))
        out.append(float((Decimal(v) - Decimal(p['running_mean'].values[c])) / deviation
                         * Decimal(p['weight'].values[c]) + Decimal(p['bias'].values[c])))
    m.write('batch_norm_scales', 'batch_norm', {'eps': 1e-5}, dict(x=x, **p), x.shape, out)
    x = planted(m.normal(1, 1, 6, 7, sigma=1e37), (3, -LARGEST), (17, LARGEST))
    low, high = Fraction(-LARGEST), Fraction(LARGEST)
    m.write('min_max_normalise_ends', 'min_max_normalise', {}, {'x': x}, x.shape,
            (float((Fraction(v) - low) / (high - low)) for v in x.values))


def others(m):
    x = Tensor([1, 1, 4, 19], (rounded(m.random.uniform(0.5, 1) * 3e38) for _ in range(76)))
    out = [float(sum(Fraction(x.values[(i + u) * 19 + j + v]) for u in (0, 1) for v in (0, 1)) / 4)
           for i, j in itertools.product(range(3), range(18))]
    m.write('avg_pool2d_ends', 'avg_pool2d', {'kernel': [2, 2]}, {'x': x}, [1, 1, 3, 18], out)
    for name, sigma in (('spread', 40.0), ('wide', 1e4)):
        x = m.normal(5, 37, sigma=sigma)
        out = []
        for r in range(5):
            row = [Decimal(v) for v in x.values[r * 37:(r + 1) * 37]]
            powers = [(v - max(row)).exp() for v in row]
            out += [float(p / sum(powers)) for p in powers]
        m.write(f'softmax_{name}', 'softmax', {'axis': 1}, {'x': x}, x.shape, out)
    ends = [s * v for s in (1, -1) for v in (0.0, 1e-38, 1e-20, 1e-4, 0.3, 1, 9, 17.4, 40, 87, 88.7, 95, 103, 1e4, 3e38)]
    m.unary('exp', [v for v in ends if v < 89], lambda v: float(Decimal(v).exp()))
    m.unary('sigmoid', ends, lambda v: float(1 / (1 + Decimal(-v).exp())) if abs(v) < 1e5 else float(v > 0))
    m.unary('tanh', ends, math.tanh)
    m.unary('silu', ends, lambda v: float(Decimal(v) / (1 + Decimal(-v).exp())) if abs(v) < 1e5 else max(v, -0.0))
    m.unary('gelu', ends, lambda v: v * math.erfc(-v / math.sqrt(2)) / 2 if v > -38 else -0.0)


def transformers(m):
    m.layer_norm('layer_norm_mean_1e6', m.normal(1, 24, 1, 19, mean=1e6))
    m.layer_norm('layer_norm_constant', Tensor([1, 24, 1, 19], [3.25] * 456))
    massive = m.normal(1, 48, 1, 19)  # a channel far larger than all others, as vision transformers have them
    m.layer_norm('layer_norm_massive_channel', planted(massive, *((19 * 7 + t, 1e4) for t in range(19))))
    # A score of 2,500 at every key, which no exponential survives, and the same key everywhere.
    depth, queries, keys = 16, 19, 141
    query, key = m.normal(1, depth, 1, queries), m.normal(1, depth, 1, keys)
    query.values[:queries], key.values[:keys] = [100.0] * queries, [100.0] * keys
    m.attention('attention_far_scores', query, key, m.normal(1, 6, 1, keys))
    same = Tensor([1, depth, 1, keys], (v for v in m.normal(depth).values for _ in range(keys)))
    m.attention('attention_equal_keys', m.normal(1, depth, 1, queries, sigma=30), same, m.normal(1, 6, 1, keys, mean=10))
    # One key has all the weight, the others' weights are denormal or zero.
    m.attention('attention_one_key', m.normal(1, depth, 1, queries, sigma=8), m.normal(1, depth, 1, keys, sigma=8),
                m.normal(1, 6, 1, keys))


def main():
    maker = Hard(sys.argv[1])
    convolutions(maker)
    normalisations(maker)
    others(maker)
    transformers(maker)


if __name__ == '__main__':
    main()
