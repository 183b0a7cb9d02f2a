#!/usr/bin/python3
"""Operator cases whose float64 answers are rounded once: every sum by math.fsum, without a library.

  make_exact_cases.py OUT_DIR      writes OUT_DIR/<name>.safetensors; the format is that of docs/operators.md

Convolutions reach every method and precision: Winograd of 2x2 and 4x4 outputs, direct, matrix product, depthwise with
joined and padded rows, few filters, gates, groups, and the plain spatial operators. Inputs are float32 numbers.
"""
import array
import itertools
import json
import math
import os
import random
import struct
import sys


def count(shape):
    return math.prod(shape)


class Tensor:
    """Row-major numbers of a shape."""

    def __init__(self, shape, values, dtype='F32'):
        self.shape, self.values, self.dtype = list(shape), list(values), dtype
        assert len(self.values) == count(shape)


def save(path, tensors, metadata):
    header, blobs, at = {'__metadata__': metadata}, [], 0
    for name, t in tensors.items():
        data = array.array('d' if t.dtype == 'F64' else 'f', t.values).tobytes()
        header[name] = {'dtype': t.dtype, 'shape': t.shape, 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as out:
        out.write(struct.pack('<Q', len(text)) + text + b''.join(blobs))


def rounded(x):
    return struct.unpack('<f', struct.pack('<f', x))[0]


class Maker:
    def __init__(self, folder):
        self.folder, self.random = folder, random.Random(20)
        os.makedirs(folder, exist_ok=True)

    def normal(self, *shape, sigma=1.0, mean=0.0):
        return Tensor(shape, (rounded(self.random.gauss(mean, sigma)) for _ in range(count(shape))))

    def write(self, name, op, attributes, inputs, shape, expected):
        tensors = dict(inputs, expected=Tensor(shape, expected, 'F64'))
        save(f'{self.folder}/{name}.safetensors', tensors,
             {'op': op, 'attributes': json.dumps(attributes), 'source': 'exact sums, tests/oracles/make_exact_cases.py'})


def convolve(x, weight, bias, stride, padding, dilation, groups):
    n, _, h, w = x.shape
    oc, ic, kh, kw = weight.shape
    top, left, bottom, right = padding
    oh = (h + top + bottom - dilation[0] * (kh - 1) - 1) // stride[0] + 1
    ow = (w + left + right - dilation[1] * (kw - 1) - 1) // stride[1] + 1
    channels, out = ic * groups, []
    for image, o, i, j in itertools.product(range(n), range(oc), range(oh), range(ow)):
        terms = [bias.values[o]] if bias else []
        first = o // (oc // groups) * ic
        for u, v in itertools.product(range(kh), range(kw)):
            y, z = i * stride[0] + u * dilation[0] - top, j * stride[1] + v * dilation[1] - left
            if not (0 <= y < h and 0 <= z < w):
                continue
            for c in range(ic):  # a product of two float32 numbers is exact in float64
                terms.append(weight.values[((o * ic + c) * kh + u) * kw + v]
                             * x.values[((image * channels + first + c) * h + y) * w + z])
        out.append(math.fsum(terms))
    return [n, oc, oh, ow], out


def gate(shape, sums):
    n, oc, h, w = shape
    half, out = oc // 2, []
    for image, o, p in itertools.product(range(n), range(half), range(h * w)):
        a = sums[(image * oc + o) * h * w + p]
        g = sums[(image * oc + half + o) * h * w + p]
        out.append((math.expm1(a) if a < 0 else a) / (1 + math.exp(-g)))
    return [n, half, h, w], out


def convolution(m, name, x_shape, oc, kernel, stride=1, padding=0, dilation=1, groups=1, gated=False, mean=0.0,
                bias=True):
    attributes = {'stride': [stride] * 2, 'padding': padding if isinstance(padding, list) else [padding] * 4,
                  'dilation': [dilation] * 2, 'groups': groups}
    x = m.normal(*x_shape, mean=mean)
    ic = x_shape[1] // groups
    weight = m.normal(oc, ic, kernel, kernel, sigma=1 / math.sqrt(ic * kernel * kernel))
    inputs = {'x': x, 'weight': weight}
    if bias:
        inputs['bias'] = m.normal(oc)
    shape, expected = convolve(x, weight, inputs.get('bias'), *attributes.values())
    if gated:
        shape, expected = gate(shape, expected)
    m.write(name, 'gated_conv2d' if gated else 'conv2d', attributes, inputs, shape, expected)


def convolutions(m):
    convolution(m, 'conv2d_3x3', [1, 24, 21, 27], 26, 3, padding=1)
    convolution(m, 'conv2d_3x3_large', [1, 16, 32, 38], 16, 3, padding=1)
    convolution(m, 'conv2d_3x3_images', [2, 16, 9, 19], 17, 3, padding=1)
    convolution(m, 'conv2d_3x3_mean', [1, 24, 16, 24], 24, 3, padding=1, mean=2.5)
    convolution(m, 'conv2d_3x3_uneven', [1, 16, 14, 18], 16, 3, padding=[2, 0, 1, 1])
    convolution(m, 'conv2d_3x3_no_bias', [1, 16, 13, 15], 33, 3, padding=1, bias=False)
    convolution(m, 'conv2d_3x3_stride2', [1, 12, 17, 22], 18, 3, stride=2, padding=1)
    convolution(m, 'conv2d_3x3_dilation2', [1, 24, 20, 23], 24, 3, padding=2, dilation=2)
    convolution(m, 'conv2d_3x3_dilation4', [1, 16, 18, 18], 16, 3, padding=4, dilation=4)
    convolution(m, 'conv2d_1x1', [1, 67, 9, 13], 21, 1)
    convolution(m, 'conv2d_1x1_stride2', [2, 19, 8, 11], 9, 1, stride=2)
    convolution(m, 'conv2d_5x5', [1, 9, 11, 21], 7, 5, padding=2)
    convolution(m, 'conv2d_7x7_stride2', [1, 3, 23, 30], 10, 7, stride=2, padding=3)
    convolution(m, 'conv2d_groups', [1, 32, 11, 13], 24, 3, padding=1, groups=2)
    convolution(m, 'conv2d_deep', [1, 300, 4, 5], 9, 3, padding=1)
    convolution(m, 'conv2d_depthwise', [2, 7, 12, 19], 7, 3, padding=1, groups=7)
    convolution(m, 'conv2d_depthwise_stride2', [1, 6, 14, 22], 6, 5, stride=2, padding=[1, 1, 2, 2], groups=6)
    convolution(m, 'conv2d_depthwise_dilation', [1, 5, 13, 70], 5, 3, padding=2, dilation=2, groups=5)
    convolution(m, 'conv2d_depthwise_twice', [1, 4, 9, 17], 8, 3, padding=1, groups=4)
    convolution(m, 'conv2d_few_filters', [1, 24, 13, 21], 1, 3, padding=1)
    convolution(m, 'conv2d_few_filters_1x1', [1, 16, 9, 17], 3, 1)
    convolution(m, 'conv2d_few_filters_5x5', [1, 10, 9, 18], 2, 5, padding=2)
    convolution(m, 'gated_conv2d_3x3', [1, 24, 16, 21], 48, 3, padding=1, gated=True)
    convolution(m, 'gated_conv2d_5x5', [1, 5, 12, 17], 12, 5, padding=2, gated=True)
    convolution(m, 'gated_conv2d_dilation2', [1, 16, 14, 15], 32, 3, padding=2, dilation=2, gated=True)
    convolution(m, 'gated_conv2d_groups', [1, 16, 9, 13], 16, 3, padding=1, groups=2, gated=True)


def planes(m):
    shape = [1, 2, 13, 19]
    x = m.normal(*shape)

    def at(c, i, j):
        return x.values[(c * 13 + min(max(i, 0), 12)) * 19 + min(max(j, 0), 18)]

    places = list(itertools.product(range(2), range(13), range(19)))
    for radius in (1, 3):
        around = range(-radius, radius + 1)
        out = [sorted(at(c, i + u, j + v) for u in around for v in around)[(2 * radius + 1) ** 2 // 2]
               for c, i, j in places]
        m.write(f'median_{radius}', 'median', {'radius': radius}, {'x': x}, shape, out)
    points = Tensor(shape, (1.0 if m.random.random() < 0.05 else 0.0 for _ in range(count(shape))))
    out = []
    for c, i, j in places:
        out.append(min((i - p) ** 2 + (j - q) ** 2 for p in range(13) for q in range(19)
                       if points.values[(c * 13 + p) * 19 + q] > 0.5))
    m.write('distance_transform', 'distance_transform', {}, {'x': points}, shape, out)


def open_tensors(path):
    with open(path, 'rb') as file:
        data = file.read()
    size = struct.unpack('<Q', data[:8])[0]
    header = json.loads(data[8:8 + size])
    tensors = {}
    for name, entry in header.items():
        if name != '__metadata__':
            first, last = entry['data_offsets']
            values = array.array('d')
            values.frombytes(data[8 + size + first:8 + size + last])
            tensors[name] = Tensor(entry['shape'], values, 'F64')
    return tensors


def golden(m, folder):
    """Runs of the authors' code that the doctests read, too (tests/data/ops)."""
    def case(tensors, group, name, op, attributes, inputs, result):
        inputs = {i: tensors[f'{group}.{i}'] for i in inputs}
        expected = tensors[f'{group}.{result}']
        m.write(name, op, attributes, inputs, expected.shape, expected.values)

    tensors = open_tensors(f'{folder}/contextual_attention.safetensors')
    for group in ('hole_inside', 'general_fuse', 'no_hole'):
        case(tensors, group, f'contextual_attention_{group}', 'contextual_attention', {},
             ('foreground', 'background', 'mask', 'fuse_weight'), 'expected')
    tensors = open_tensors(f'{folder}/fill.safetensors')
    for group, sweeps in (('odd', 4), ('row', 2), ('even', 0)):
        case(tensors, group, f'push_pull_fill_{group}', 'push_pull_fill', {'sweeps': sweeps}, ('x', 'weight'), 'y')
        case(tensors, group, f'mirror_known_{group}', 'mirror_known', {}, ('x', 'weight'), 'mirrored')
    tensors = open_tensors(f'{folder}/guided.safetensors')
    for group, radius, eps in (('colour', 4, 1e-3), ('grey', 2, 1e-2), ('wide', 9, 1)):
        case(tensors, group, f'guided_coefficients_{group}', 'guided_coefficients', {'radius': radius, 'eps': eps},
             ('guide', 'x'), 'y')


def ends_of_8_bits(m):
    """All but one value at the lower end of the range, all weights at the end of theirs: what is cut off there,
    or a zero point that is not the nearest, is wrong in every term alike."""
    x = Tensor([1, 32, 8, 12], [1.0] + [-1.0] * (32 * 8 * 12 - 1))
    weight = Tensor([32, 32, 1, 1], (1.0 if o % 2 else -1.0 for o in range(32) for _ in range(32)))
    attributes = {'stride': [1, 1], 'padding': [0, 0, 0, 0], 'dilation': [1, 1], 'groups': 1}
    shape, expected = convolve(x, weight, None, *attributes.values())
    m.write('conv2d_8_bit_ends', 'conv2d', attributes, {'x': x, 'weight': weight}, shape, expected)


def rising_attention(m):
    """Scores that rise along 300 keys, so that what was summed of earlier keys is lowered again and again."""
    depth, queries, keys = 16, 40, 300
    q, k, v = m.normal(1, depth, 1, queries), m.normal(1, depth, 1, keys, sigma=0.25), m.normal(1, depth, 1, keys)
    for i in range(queries):
        q.values[i] = 1.0
    for j in range(keys):
        k.values[j] = rounded(12 * j / keys)
    out = [[0.0] * queries for _ in range(depth)]
    for i in range(queries):
        scores = [math.fsum(q.values[c * queries + i] * k.values[c * keys + j] for c in range(depth))
                  for j in range(keys)]
        weights = [math.exp(score - max(scores)) for score in scores]
        for c in range(depth):
            terms = (w * v.values[c * keys + j] for j, w in enumerate(weights))
            out[c][i] = math.fsum(terms) / math.fsum(weights)
    m.write('attention_rising', 'attention', {'heads': 1, 'scale': 1.0}, {'query': q, 'key': k, 'value': v},
            [1, depth, 1, queries], itertools.chain(*out))


def main():
    maker = Maker(sys.argv[1])
    convolutions(maker)
    planes(maker)
    ends_of_8_bits(maker)
    rising_attention(maker)
    golden(maker, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'data', 'ops'))


if __name__ == '__main__':
    main()
