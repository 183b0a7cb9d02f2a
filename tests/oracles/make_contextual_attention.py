#!/usr/bin/python3
"""Golden vectors of contextual attention in float64, from the authors' PyTorch module.

  make_contextual_attention.py CLONE OUT.safetensors      Debian: python3-torch

CLONE is a checkout of github.com/nipponjo/deepfillv2-pytorch; its ContextualAttention (model/networks.py) is run as it
is on random features. Each case CASE gives the tensors CASE.foreground, .background, .mask, .fuse_weight, .expected.
"""
import json
import struct
import sys

import torch


def save(path, tensors):
    header, blobs, at = {}, [], 0
    for name, tensor in tensors.items():
        data = tensor.contiguous().numpy().tobytes()
        header[name] = {'dtype': 'F64', 'shape': list(tensor.shape), 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as out:
        out.write(struct.pack('<Q', len(text)) + text + b''.join(blobs))


def hole(height, width, rows, columns):
    mask = torch.zeros(1, 1, height, width, dtype=torch.float64)
    mask[..., rows, columns] = 1
    return mask


def main():
    clone, out = sys.argv[1:]
    sys.path.insert(0, clone)
    from model.networks import ContextualAttention
    torch.manual_seed(1)

    def random(*shape):
        return torch.randn(*shape, dtype=torch.float64)

    identity = torch.eye(3, dtype=torch.float64).view(1, 1, 3, 3)
    same = random(1, 4, 12, 16)
    background = random(1, 3, 8, 12)
    background[..., :6, :6] = 0  # patches of zeros: the norm's lower limit
    cases = {
        'hole_inside': (same, same, hole(48, 64, slice(16, 32), slice(20, 40)), identity),
        'general_fuse': (random(1, 3, 8, 12), background, hole(32, 48, slice(20, 32), slice(30, 48)),
                         random(1, 1, 3, 3) / 3),
        'no_hole': (random(1, 2, 10, 6), random(1, 2, 10, 6), hole(40, 24, slice(0), slice(0)), identity),
    }
    tensors = {}
    for name, (f, b, mask, fuse_weight) in cases.items():
        module = ContextualAttention(ksize=3, stride=1, rate=2, fuse_k=3, softmax_scale=10, fuse=True, n_down=2).double()
        module.fuse_weight.copy_(fuse_weight)
        expected, _ = module(f, b, mask)
        tensors |= {f'{name}.foreground': f, f'{name}.background': b, f'{name}.mask': mask,
                    f'{name}.fuse_weight': fuse_weight, f'{name}.expected': expected}
    save(out, tensors)


main()
