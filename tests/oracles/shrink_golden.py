#!/usr/bin/env python3
"""Makes a golden file of a network small enough for the repository.

usage: shrink_golden.py GOLDEN.safetensors SMALL.safetensors

Inputs, parameters and the first output stay as they are. Of every intermediate tensor and every further output only
each N-th element is kept, in row-major order, N the smallest number prime to the tensor's extents that leaves at
most 2000 of them (so that all rows, columns and channels are sampled); metadata "strides" says which N. Needs NumPy.
"""
import json
import math
import struct
import sys

import numpy as np

MOST = 2000
TYPES = {'F32': np.float32, 'F64': np.float64, 'I64': np.int64, 'U8': np.uint8}


def read(path):
    data = open(path, 'rb').read()
    length = struct.unpack('<Q', data[:8])[0]
    header = json.loads(data[8:8 + length])
    metadata = header.pop('__metadata__')
    tensors = {}
    for name, entry in header.items():
        begin, end = entry['data_offsets']
        raw = np.frombuffer(data[8 + length + begin:8 + length + end], TYPES[entry['dtype']])
        tensors[name] = raw.reshape(entry['shape'])
    return metadata, tensors


def write(path, metadata, tensors):
    names = {np.dtype(t): name for name, t in TYPES.items()}
    header, offset = {'__metadata__': metadata}, 0
    ordered = sorted(tensors.items(), key=lambda item: -item[1].itemsize)  # float64 first: all stay aligned
    for name, t in ordered:
        header[name] = {'dtype': names[t.dtype], 'shape': list(t.shape), 'data_offsets': [offset, offset + t.nbytes]}
        offset += t.nbytes
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-len(text) % 64)
    with open(path, 'wb') as f:
        f.write(struct.pack('<Q', len(text)) + text)
        for _, t in ordered:
            f.write(np.ascontiguousarray(t).tobytes())


def stride_of(t):
    stride = -(-t.size // MOST)
    while any(math.gcd(stride, extent) > 1 for extent in t.shape):
        stride += 1
    return stride


def main(source, target):
    metadata, tensors = read(source)
    strides = {}
    for name, t in tensors.items():
        if t.size > MOST and (name.startswith('tap.') or name.startswith('output.') and name != 'output.0'):
            strides[name] = stride_of(t)
            tensors[name] = t.reshape(-1)[::strides[name]]
    metadata['strides'] = json.dumps(strides, separators=(',', ':'))
    write(target, metadata, tensors)


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
