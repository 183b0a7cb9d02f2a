#!/usr/bin/python3
"""Writes what the peers need: weights (safetensors), inputs and float64 outputs (safetensors), ONNX models.

  export_onnx.py OUT [CASE ...]      Debian: python3-torch python3-opencv python3-onnx libopenblas0-pthread;
Node with onnxruntime-node in OUT/node

What is there already is not made again.
"""
import os
import subprocess
import sys
import time
import warnings

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cases  # noqa: E402
import formula  # noqa: E402
import networks  # noqa: E402
import tensors  # noqa: E402


def standardise(w):
    """FBA's weight standardisation."""
    wide = w.astype(np.float64)
    mean, var = wide.mean((1, 2, 3), keepdims=True), wide.var((1, 2, 3), keepdims=True)
    return ((wide - mean) / np.sqrt(var + 1e-5)).astype(np.float32)


def weights(case, module):
    """{name: float32 array} for the module's parameters."""
    if case.weights:
        found = tensors.load(os.path.join(cases.ROOT, case.weights))
        return {name: values.astype(np.float32) for name, values in found.items()}
    made = {}
    for name, value in module.state_dict().items():
        if name.endswith('num_batches_tracked'):
            continue
        made[name] = formula.tensor(name, tuple(value.shape))
        if case.network == 'fba' and value.dim() == 4 and networks.Fba.standardised(name):
            made[name] = standardise(made[name])
    return made


def module_of(case):
    kind = getattr(networks, case.module)
    return (kind(case.width) if case.width else kind()).eval()


def load(case, out):
    """The module with its weights, from the files that were exported."""
    module = module_of(case)
    values = tensors.load(f'{out}/{case.weight_name}.weights.safetensors')
    module.load_state_dict({name: torch.from_numpy(v) for name, v in values.items()}, strict=False)
    return module


def as_tuple(y):
    return y if isinstance(y, tuple) else (y,)


def write_new(path, write):
    if not os.path.exists(path):
        start = time.time()
        write(path + '.part')
        os.replace(path + '.part', path)
        print(f'{os.path.basename(path)}: {os.path.getsize(path) / 2**20:.1f} MiB, {time.time() - start:.1f} s', flush=True)


@torch.no_grad()
def write_case(path, case, out):
    x = cases.inputs(case)
    y = as_tuple(load(case, out).double()(*[torch.from_numpy(v).double() for v in x.values()]))
    found = {f'input.{name}': v for name, v in x.items()}
    found |= {f'output.{i}': v.numpy() for i, v in enumerate(y)}
    for i, v in enumerate(y):
        if float(v.std()) < 1e-3 * float(v.abs().max()):
            print(f'{case.name}: output {i} is nearly constant', file=sys.stderr)
    tensors.save(path, found)


@torch.no_grad()
def write_onnx(path, case, out):
    x = cases.inputs(case)
    module = load(case, out)
    count = len(as_tuple(module(*[torch.from_numpy(v) for v in x.values()])))
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        torch.onnx.export(module, tuple(torch.from_numpy(v) for v in x.values()), path, opset_version=13, input_names=list(x),
                          output_names=[f'output.{i}' for i in range(count)])
    fold(path)
    merge_padding(path)


def fold(path):
    """Computes constants once, which all peers gain by: ONNX Runtime's "basic" pass."""
    folded = path + '.folded'
    subprocess.run(['node', os.path.join(cases.HERE, 'peer_ort.js'), '--fold', path, folded], check=True, stdout=subprocess.DEVNULL)
    os.replace(folded, path)


def merge_padding(path):
    """Zeros added before a convolution become part of it: OpenCV runs no other form of them."""
    model = onnx.load(path)
    nodes = model.graph.node
    values = {t.name: numpy_helper.to_array(t) for t in model.graph.initializer}
    pads = {n.output[0]: n for n in nodes if n.op_type == 'Pad' and n.input[1] in values}
    for conv in [n for n in nodes if n.op_type == 'Conv' and n.input[0] in pads]:
        pad = pads[conv.input[0]]
        top, left, bottom, right = values[pad.input[1]][[2, 3, 6, 7]]
        attribute = next(a for a in conv.attribute if a.name == 'pads')
        attribute.ints[:] = [int(v) for v in np.add(attribute.ints, [top, left, bottom, right])]
        conv.input[0] = pad.input[0]
    read = {name for n in nodes for name in n.input}
    for pad in [p for p in pads.values() if p.output[0] not in read]:
        nodes.remove(pad)
    onnx.save(model, path)


def for_opencv(source, path):
    """OpenCV 4.6 knows Clip with its limits as attributes only, as old models have it."""
    model = onnx.load(source)
    values = {t.name: numpy_helper.to_array(t) for t in model.graph.initializer}
    for node in [n for n in model.graph.node if n.op_type == 'Clip']:
        limits = [(name, values[i]) for name, i in zip(('min', 'max'), node.input[1:]) if i]
        del node.input[1:]
        node.attribute.extend(helper.make_attribute(name, float(v)) for name, v in limits)
    onnx.save(model, path)


def main():
    out, wanted = sys.argv[1], sys.argv[2:]
    os.makedirs(out, exist_ok=True)
    for case in [c for c in cases.CASES if not wanted or c.name in wanted]:
        write_new(f'{out}/{case.weight_name}.weights.safetensors',
                  lambda path: tensors.save(path, weights(case, module_of(case)), {'model': case.network}))
        write_new(f'{out}/{case.name}.case.safetensors', lambda path: write_case(path, case, out))
        if case.onnx:
            write_new(f'{out}/{case.name}.onnx', lambda path: write_onnx(path, case, out))
            write_new(f'{out}/{case.name}.opencv.onnx', lambda path: for_opencv(f'{out}/{case.name}.onnx', path))


if __name__ == '__main__':
    main()
