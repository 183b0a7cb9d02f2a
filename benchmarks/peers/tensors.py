"""safetensors files: eight bytes of header length, JSON, data."""
import json
import struct

import numpy as np

KINDS = {'F16': np.float16, 'F32': np.float32, 'F64': np.float64}
NAMES = {np.dtype(kind): name for name, kind in KINDS.items()}


def save(path, tensors, metadata=None):
    header, blobs, at = {'__metadata__': metadata or {}}, [], 0
    for name, values in tensors.items():
        data = np.ascontiguousarray(values).tobytes()
        header[name] = {'dtype': NAMES[values.dtype], 'shape': list(values.shape), 'data_offsets': [at, at + len(data)]}
        blobs.append(data)
        at += len(data)
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path, 'wb') as f:
        f.write(struct.pack('<Q', len(text)) + text)
        for data in blobs:
            f.write(data)


def load(path, prefix=''):
    """-> {name without the prefix: array}, of the tensors whose names start so."""
    with open(path, 'rb') as f:
        length, = struct.unpack('<Q', f.read(8))
        header = json.loads(f.read(length))
    data = np.memmap(path, np.uint8, 'r', 8 + length)
    out = {}
    for name, entry in header.items():
        if name == '__metadata__' or not name.startswith(prefix):
            continue
        begin, end = entry['data_offsets']
        out[name[len(prefix):]] = np.array(data[begin:end]).view(KINDS[entry['dtype']]).reshape(entry['shape'])
    return out
