#!/usr/bin/python3
"""Operator cases in float64 from PyTorch (Debian: python3-torch), for what ONNX's node tests do not cover.

  make_operator_cases.py OUT_DIR      writes OUT_DIR/<name>.safetensors; the format is that of docs/operators.md
"""
import json
import math
import os
import struct
import sys

import torch
import torch.nn.functional as F


def save(path, tensors, metadata):
    header, blobs, at = {'__metadata__': metadata}, [], 0
    for name, tensor in tensors.items():
        data = tensor.contiguous().numpy().tobytes()
        header[name] = {'dtype': 'F64', 'shape': list(tensor.shape), 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as out:
        out.write(struct.pack('<Q', len(text)) + text + b''.join(blobs))


class Writer:
    def __init__(self, folder):
        self.folder = folder
        os.makedirs(folder, exist_ok=True)

    def __call__(self, name, op, attributes, inputs, expected, source):
        tensors = dict(inputs)
        tensors['expected'] = expected.double()
        save(f'{self.folder}/{name}.safetensors', tensors,
             {'op': op, 'attributes': json.dumps(attributes), 'source': source + f', PyTorch {torch.__version__}'})


def rand(*shape):
    return torch.randn(*shape, dtype=torch.float64)


def pools(write):
    x = rand(1, 3, 13, 17)
    for size in (1, 2, 3, 6):  # the pyramid of FBA matting's decoder
        write(f'adaptive_avg_pool2d_{size}', 'adaptive_avg_pool2d', {'size': [size, size]}, {'x': x},
              F.adaptive_avg_pool2d(x, size), 'adaptive_avg_pool2d')
    x = rand(2, 2, 5, 7)
    write('adaptive_avg_pool2d_uneven', 'adaptive_avg_pool2d', {'size': [3, 4]}, {'x': x},
          F.adaptive_avg_pool2d(x, (3, 4)), 'adaptive_avg_pool2d')
    write('adaptive_avg_pool2d_larger', 'adaptive_avg_pool2d', {'size': [8, 9]}, {'x': x},
          F.adaptive_avg_pool2d(x, (8, 9)), 'adaptive_avg_pool2d')
    for h, w in ((7, 9), (8, 5), (3, 3), (1, 2)):
        x = rand(1, 2, h, w)
        write(f'max_pool2d_ceil_{h}x{w}', 'max_pool2d', {'kernel': [2, 2], 'stride': [2, 2], 'ceil_mode': True}, {'x': x},
              F.max_pool2d(x, 2, 2, ceil_mode=True), 'max_pool2d')
    for h, w in ((8, 11), (7, 10)):
        x = rand(1, 2, h, w)
        for ceil in (False, True):
            common = {'kernel': [3, 3], 'stride': [2, 2], 'padding': [1, 1, 1, 1], 'ceil_mode': ceil}
            tag = f'{h}x{w}_{"ceil" if ceil else "floor"}'
            write(f'max_pool2d_padded_{tag}', 'max_pool2d', common, {'x': x},
                  F.max_pool2d(x, 3, 2, 1, ceil_mode=ceil), 'max_pool2d')
            for include in (False, True):
                write(f'avg_pool2d_{"with" if include else "without"}_pad_{tag}', 'avg_pool2d',
                      dict(common, count_include_pad=include), {'x': x},
                      F.avg_pool2d(x, 3, 2, 1, ceil_mode=ceil, count_include_pad=include), 'avg_pool2d')
    x = rand(1, 2, 9, 20)
    write('max_pool2d_wide', 'max_pool2d', {'kernel': [5, 7], 'stride': [1, 3], 'padding': [2, 3, 2, 3]}, {'x': x},
          F.max_pool2d(x, (5, 7), (1, 3), (2, 3)), 'max_pool2d')


def resizes(write):
    x = rand(1, 2, 7, 10)
    for h, w in ((14, 20), (11, 23), (4, 6), (3, 33), (1, 1), (7, 10)):
        for align in (False, True):
            coordinates = 'align_corners' if align else 'half_pixel'
            for mode, torch_mode in (('linear', 'bilinear'), ('cubic', 'bicubic')):
                attributes = {'mode': mode, 'coordinates': coordinates, 'size': [h, w]}
                if mode == 'cubic':
                    attributes['cubic_a'] = -0.75
                write(f'resize_{mode}_{coordinates}_{h}x{w}', 'resize', attributes, {'x': x},
                      F.interpolate(x, (h, w), mode=torch_mode, align_corners=align), 'interpolate')
    write('resize_nearest_14x20', 'resize',
          {'mode': 'nearest', 'coordinates': 'asymmetric', 'nearest': 'floor', 'size': [14, 20]}, {'x': x},
          F.interpolate(x, (14, 20), mode='nearest'), 'interpolate')
    write('upsample_nearest_3', 'upsample_nearest', {'factor': 3}, {'x': x},
          F.interpolate(x, scale_factor=3, mode='nearest'), 'interpolate')
    # PyTorch's own export calls it pytorch_half_pixel: coordinate 0 where the output has one element.
    row = F.interpolate(x, (7, 15), mode='bilinear', align_corners=False)[:, :, :1]
    write('resize_linear_pytorch_half_pixel_1x15', 'resize',
          {'mode': 'linear', 'coordinates': 'pytorch_half_pixel', 'size': [1, 15]}, {'x': x}, row,
          'interpolate along rows, the first row')


def norms(write):
    x = rand(2, 12, 5, 7) * 3 + 1
    weight, bias = rand(12), rand(12)
    for groups in (1, 3, 12):
        write(f'group_norm_{groups}', 'group_norm', {'groups': groups, 'eps': 1e-5}, {'x': x, 'weight': weight, 'bias': bias},
              F.group_norm(x, groups, weight, bias, 1e-5), 'group_norm')
    flat = torch.ones(1, 4, 3, 3, dtype=torch.float64) * 2
    write('group_norm_constant', 'group_norm', {'groups': 2, 'eps': 1e-5}, {'x': flat, 'weight': weight[:4], 'bias': bias[:4]},
          F.group_norm(flat, 2, weight[:4], bias[:4], 1e-5), 'group_norm')
    w = rand(6, 3, 3, 3)
    var, mean = torch.var_mean(w, (1, 2, 3), unbiased=False, keepdim=True)
    write('weight_standardise', 'weight_standardise', {'eps': 1e-5}, {'weight': w}, (w - mean) / torch.sqrt(var + 1e-5), 'var_mean')
    mean, var = rand(12), rand(12).abs() + 0.1
    write('batch_norm', 'batch_norm', {'eps': 1e-3},
          {'x': x, 'weight': weight, 'bias': bias, 'running_mean': mean, 'running_var': var},
          F.batch_norm(x, mean, var, weight, bias, False, 0, 1e-3), 'batch_norm')
    write('min_max_normalise', 'min_max_normalise', {}, {'x': x}, (x - x.min()) / (x.max() - x.min()), 'min and max')


def pads(write):
    x = rand(1, 2, 5, 6)
    left, right, top, bottom = 5, 2, 1, 4
    for mode, torch_mode in (('reflect', 'reflect'), ('edge', 'replicate'), ('constant', 'constant')):
        attributes = {'padding': [top, left, bottom, right], 'mode': mode}
        if mode == 'constant':
            attributes['value'] = 0.5
        value = 0.5 if mode == 'constant' else 0.0
        write(f'pad_{mode}', 'pad', attributes, {'x': x}, F.pad(x, (left, right, top, bottom), torch_mode, value), 'pad')


def pointwise(write):
    x = torch.cat([rand(200) * 4, torch.tensor([0.0, 6.0, -0.0, 1e-9, -1e-9, 7.0, -30.0, 30.0], dtype=torch.float64)])
    for op, attributes, y in (
            ('relu', {}, F.relu(x)), ('relu6', {}, F.relu6(x)), ('leaky_relu', {'slope': 0.01}, F.leaky_relu(x, 0.01)),
            ('elu', {'alpha': 1.0}, F.elu(x)), ('elu', {'alpha': 0.3}, F.elu(x, 0.3)), ('sigmoid', {}, torch.sigmoid(x)),
            ('tanh', {}, torch.tanh(x)), ('exp', {}, torch.exp(x)), ('sqrt', {}, torch.sqrt(x.abs())), ('abs', {}, x.abs()),
            ('clip', {'min': -0.25, 'max': 1.5}, x.clamp(-0.25, 1.5)), ('affine', {'scale': 0.5, 'shift': -0.1}, 0.5 * x - 0.1),
            ('greater', {'threshold': 0.05}, (x > 0.05).double())):
        tag = '_'.join([op] + [str(v) for v in attributes.values()])
        write(tag, op, attributes, {'x': x.abs() if op == 'sqrt' else x}, y, op)
    a, b = rand(2, 3, 1, 5), rand(3, 4, 1)
    for op, f in (('add', torch.add), ('sub', torch.sub), ('mul', torch.mul), ('div', torch.div),
                  ('minimum', torch.minimum), ('maximum', torch.maximum)):
        write(f'{op}_broadcast', op, {}, {'x': a, 'other': b}, f(a, b), op)


def others(write):
    x = rand(2, 3, 4, 5)
    for axis in (0, 1, 2, -1):
        write(f'softmax_axis_{axis}', 'softmax', {'axis': axis}, {'x': x * 10}, torch.softmax(x * 10, axis), 'softmax')
    for axes in ([0], [1], [2, 3], [0, 2], [1, 3], [0, 1, 2, 3]):
        tag = ''.join(map(str, axes))
        write(f'reduce_min_{tag}', 'reduce_min', {'axes': axes}, {'x': x}, torch.amin(x, axes, True), 'amin')
        write(f'reduce_max_{tag}', 'reduce_max', {'axes': axes}, {'x': x}, torch.amax(x, axes, True), 'amax')
        write(f'reduce_mean_{tag}', 'reduce_mean', {'axes': axes}, {'x': x}, torch.mean(x, axes, True), 'mean')
    write('slice', 'slice', {'axis': 2, 'start': 1, 'end': 3}, {'x': x}, x[:, :, 1:3], 'slice')
    write('concat', 'concat', {'axis': 1}, {'x0': x, 'x1': x[:, :1], 'x2': x * 2}, torch.cat([x, x[:, :1], x * 2], 1), 'cat')
    write('reshape', 'reshape', {'shape': [6, 20]}, {'x': x}, x.reshape(6, 20), 'reshape')


def transformers(write):
    x = torch.cat([rand(200) * 3, torch.tensor([0.0, -0.0, 1e-9, -1e-9, -5.5, -9.0, -12.5, 9.0, -30.0, 60.0], dtype=torch.float64)])
    write('gelu', 'gelu', {}, {'x': x}, F.gelu(x), 'gelu')
    write('silu', 'silu', {}, {'x': x}, F.silu(x), 'silu')
    x = rand(2, 3, 4, 5)
    write('permute_0231', 'permute', {'axes': [0, 2, 3, 1]}, {'x': x}, x.permute(0, 2, 3, 1), 'permute')
    write('permute_3120', 'permute', {'axes': [3, 1, 2, 0]}, {'x': x}, x.permute(3, 1, 2, 0), 'permute')
    for channels, tag, x in ((24, 'tokens', rand(2, 35, 24) * 3 + 1), (7, 'far', rand(1, 9, 7) + 1000)):
        weight, bias = rand(channels), rand(channels)
        y = F.layer_norm(x, (channels,), weight, bias, 1e-6)
        write(f'layer_norm_{tag}', 'layer_norm', {'axis': -1, 'eps': 1e-6}, {'x': x, 'weight': weight, 'bias': bias}, y, 'layer_norm')
        write(f'layer_norm_{tag}_columns', 'layer_norm', {'axis': 1, 'eps': 1e-6},
              {'x': x.permute(0, 2, 1), 'weight': weight, 'bias': bias}, y.permute(0, 2, 1), 'layer_norm')
    # A head's scores of a few thousand overflow an exponential without the largest subtracted; 150 keys are
    # more than a block of most kernels.
    for tag, heads, q, k, size in (('self', 3, 37, 37, 1), ('cross', 2, 5, 150, 1), ('large', 1, 33, 130, 30)):
        depth, values = 8, 6
        query, key, value = rand(2, heads, q, depth) * size, rand(2, heads, k, depth) * size, rand(2, heads, k, values)
        scale = 1 / math.sqrt(depth)
        y = torch.softmax(query @ key.transpose(-2, -1) * scale, -1) @ value
        columns = lambda t: t.transpose(-2, -1).reshape(2, -1, 1, t.shape[2])
        write(f'attention_{tag}', 'attention', {'heads': heads, 'scale': scale},
              {'query': columns(query), 'key': columns(key), 'value': columns(value)}, columns(y), 'softmax and matmul')
    x = rand(1, 2, 7, 7)
    scale = [(5 + 0.1) / 7, (9 + 0.1) / 7]
    write('resize_cubic_scale', 'resize', {'mode': 'cubic', 'coordinates': 'half_pixel', 'size': [5, 9], 'scale': scale, 'cubic_a': -0.75},
          {'x': x}, F.interpolate(x, scale_factor=scale, mode='bicubic'), 'interpolate with scale_factor')


def foreground_colours(image, alpha):
    """Germer et al. 2020, each pixel's two unknowns by solving its normal equations."""
    def near(x, h, w):
        rows, columns = torch.arange(h) * x.shape[-2] // h, torch.arange(w) * x.shape[-1] // w
        return x[..., rows, :][..., columns]
    channels, h0, w0 = image.shape
    mean = lambda where: torch.stack([p[where].mean() for p in image]) if where.any() else torch.zeros(channels, dtype=torch.float64)
    colours = torch.stack([mean(alpha > 0.9), mean(alpha < 0.1)])[:, :, None, None]
    last = math.ceil(math.log2(max(h0, w0)))
    for level in range(last + 1):
        part = level / last if last else 1
        h, w = round(h0 ** part), round(w0 ** part)
        i, a, colours = near(image, h, w), near(alpha, h, w), near(colours, h, w)
        mixture = torch.stack([a, 1 - a], -1)
        for _ in range(10 if max(h, w) <= 32 else 2):
            matrix = mixture[..., :, None] * mixture[..., None, :]
            vector = mixture[:, :, None, :] * i.permute(1, 2, 0)[..., None]
            padded_a, padded = F.pad(a[None, None], [1] * 4, 'replicate')[0, 0], F.pad(colours, [1] * 4, 'replicate')
            for y, x in ((0, 1), (2, 1), (1, 0), (1, 2)):
                weight = 1e-5 + (a - padded_a[y:y + h, x:x + w]).abs()
                matrix = matrix + weight[..., None, None] * torch.eye(2, dtype=torch.float64)
                vector = vector + weight[..., None, None] * padded[..., y:y + h, x:x + w].permute(2, 3, 1, 0)
            solved = torch.linalg.solve(matrix[:, :, None].expand(-1, -1, channels, -1, -1), vector)
            colours = solved.permute(3, 2, 0, 1).clamp(0, 1)
    return colours.reshape(2 * channels, h0, w0)


def matting(write):
    for name, h, w in (('', 18, 40), ('_thin', 1, 37)):
        y, x = torch.meshgrid(torch.arange(h), torch.arange(w), indexing='ij')
        alpha = ((0.35 * w - ((x - 0.5 * w) ** 2 + (y - 0.5 * h) ** 2).sqrt()) / 6 + 0.3 * rand(h, w) + 0.5).clamp(0, 1)
        image = torch.rand(3, h, w, dtype=torch.float64)
        write('foreground_colours' + name, 'foreground_colours', {}, {'image': image[None], 'alpha': alpha[None, None]},
              foreground_colours(image, alpha)[None], 'pixel by pixel 2x2 systems')


def layering(write):
    x = rand(1, 2, 9, 14)
    for sigma in (0.0, 1.0, 2.5):
        radius = math.ceil(3 * sigma)
        taps = torch.arange(-radius, radius + 1, dtype=torch.float64)
        taps = torch.exp(-taps ** 2 / (2 * sigma ** 2)) if sigma > 0 else torch.ones(1, dtype=torch.float64)
        taps = taps / taps.sum()
        kernel = (taps[:, None] * taps[None, :])[None, None]
        padded = F.pad(x, [radius] * 4, 'replicate')
        y = torch.cat([F.conv2d(padded[:, c:c + 1], kernel) for c in range(2)], 1)
        write(f'gaussian_blur_{sigma}', 'gaussian_blur', {'sigma': sigma}, {'x': x}, y, 'conv2d with a two-dimensional Gaussian')
    x = rand(2, 1, 7, 11)
    gx = torch.tensor([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], dtype=torch.float64) / 8
    write('sobel', 'sobel', {}, {'x': x}, F.conv2d(F.pad(x, [1] * 4, 'replicate'), torch.stack([gx, gx.T])[:, None]), 'conv2d')
    x = torch.rand(1, 2, 9, 14, dtype=torch.float64)
    h, w = x.shape[2:]
    for rho, radius in ((0.1, 4), (0.03, 100), (0.0, 3)):
        y = torch.full_like(x, -math.inf)
        for i in range(h):
            for j in range(w):
                for k in range(h):
                    if abs(k - i) <= radius:
                        y[..., i, j] = torch.maximum(y[..., i, j], x[..., k, j] - rho * abs(k - i))
                for k in range(w):
                    if abs(k - j) <= radius:
                        y[..., i, j] = torch.maximum(y[..., i, j], x[..., i, k] - rho * abs(k - j))
        write(f'cone_dilation_{rho}_{radius}', 'cone_dilation', {'rho': rho, 'radius': radius}, {'x': x}, y, 'pixel by pixel')


def main():
    torch.manual_seed(7)
    write = Writer(sys.argv[1])
    for family in (pools, resizes, norms, pads, pointwise, others, layering, transformers, matting):
        family(write)


if __name__ == '__main__':
    main()
