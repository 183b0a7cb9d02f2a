#!/usr/bin/python3
"""An 8-bit ONNX model for ONNX Runtime: Q/DQ nodes from the ranges that photos give.

  quantise.py OUT [CASE ...]      Debian: python3-onnx; Node with onnxruntime-node in OUT/node

Weights: int8, symmetric, a scale for each output channel. Activations: uint8, a scale and a zero point for each tensor, from
the least and the largest number that it has on the calibration photos. Biases: int32. That is what ONNX Runtime's own
quantiser does by default (quantize_static, QuantFormat.QDQ, MinMax, per_channel).
"""
import json
import os
import subprocess
import sys

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import cases  # noqa: E402
import tensors  # noqa: E402

QUANTISED = {'Conv', 'Add', 'Concat', 'MaxPool', 'Resize', 'AveragePool', 'GlobalAveragePool'}
KEEPS_RANGE = {'MaxPool'}
ACTIVATIONS = {'Relu', 'Clip'}


class Graph:
    def __init__(self, model):
        self.graph = model.graph
        self.constants = {t.name for t in self.graph.initializer}
        self.constants |= {n.output[0] for n in self.graph.node if n.op_type == 'Constant'}
        self.outputs = {o.name for o in self.graph.output}
        self.readers = {}
        for node in self.graph.node:
            for name in node.input:
                self.readers.setdefault(name, []).append(node)

    def data_inputs(self, node):
        names = node.input[:1] if node.op_type in ('Conv', 'Resize') else node.input
        return [n for n in names if n and n not in self.constants]

    def merges_activation(self, node):
        readers = self.readers.get(node.output[0], [])
        return len(readers) == 1 and readers[0].op_type in ACTIVATIONS

    def quantised(self):
        """Names of the tensors that are rounded to 8 bits, in the graph's order."""
        names = {}
        for node in self.graph.node:
            if node.op_type not in QUANTISED:
                continue
            for name in self.data_inputs(node):
                names[name] = True
            if not self.merges_activation(node):
                names[node.output[0]] = True
            else:
                names[self.readers[node.output[0]][0].output[0]] = True
        # Where an activation follows, it is merged, and only its result is rounded.
        merged = {n.output[0] for n in self.graph.node if n.op_type in ('Conv', 'Add') and self.merges_activation(n)}
        return [n for n in names if n not in self.outputs and n not in merged]


def ranges(model, names, case, out):
    """{name: (least, largest)} over the calibration photos."""
    probe = onnx.ModelProto()
    probe.CopyFrom(model)
    del probe.graph.output[:]
    for i, name in enumerate(names):
        for kind in ('Min', 'Max'):
            probe.graph.node.append(helper.make_node('Reduce' + kind, [name], [f'{kind}.{i}'], keepdims=0))
            probe.graph.output.append(helper.make_tensor_value_info(f'{kind}.{i}', TensorProto.FLOAT, []))
    path, photo = f'{out}/calibrate.onnx', f'{out}/calibrate.safetensors'
    onnx.save(probe, path)
    found = {name: (0., 0.) for name in names}
    for number in range(cases.CALIBRATION_PHOTOS):
        tensors.save(photo, {f'input.{k}': v for k, v in cases.inputs(case, number).items()})
        done = subprocess.run(['node', f'{HERE}/peer_ort.js', path, photo, '2'], input='run\nscalars\nquit\n', text=True, stdout=subprocess.PIPE, check=True)
        values = json.loads(done.stdout.splitlines()[2])
        for i, name in enumerate(names):
            least, largest = found[name]
            found[name] = (min(least, values[f'Min.{i}']), max(largest, values[f'Max.{i}']))
    os.remove(path)
    os.remove(photo)
    return found


class Quantiser:
    def __init__(self, model, found):
        self.graph, self.found = model.graph, found
        self.weights = {t.name: numpy_helper.to_array(t) for t in self.graph.initializer}
        self.scales = {}

    def constant(self, name, values):
        self.graph.initializer.append(numpy_helper.from_array(np.asarray(values), name))
        return name

    def pair(self, name):
        """Quantise and dequantise an activation -> nodes."""
        least, largest = self.found[name]
        scale = np.float32(max(largest - least, 1e-8) / 255)
        self.scales[name] = scale
        s = self.constant(name + '.scale', scale)
        z = self.constant(name + '.zero', np.uint8(np.clip(np.round(-least / scale), 0, 255)))
        return [helper.make_node('QuantizeLinear', [name, s, z], [name + '.q']),
                helper.make_node('DequantizeLinear', [name + '.q', s, z], [name + '.dq'])]

    def conv(self, node):
        """Its weight and bias become int8 and int32 -> nodes."""
        w = self.weights[node.input[1]]
        scale = np.maximum(np.abs(w).max((1, 2, 3)) / 127, 1e-12).astype(np.float32)
        q = np.clip(np.round(w / scale[:, None, None, None]), -127, 127).astype(np.int8)
        base = node.output[0]
        made = [helper.make_node('DequantizeLinear', [self.constant(base + '.w', q), self.constant(base + '.ws', scale),
                                                      self.constant(base + '.wz', np.zeros(len(scale), np.int8))], [base + '.wdq'], axis=0)]
        node.input[1] = base + '.wdq'
        if len(node.input) > 2:
            both = scale * self.scales[node.input[0].removesuffix('.dq')]
            bias = np.clip(np.round(self.weights[node.input[2]] / both.astype(np.float64)), -2**31 + 1, 2**31 - 1).astype(np.int32)
            made.append(helper.make_node('DequantizeLinear', [self.constant(base + '.b', bias), self.constant(base + '.bs', both),
                                                              self.constant(base + '.bz', np.zeros(len(scale), np.int32))], [base + '.bdq'], axis=0))
            node.input[2] = base + '.bdq'
        return made


def quantise(path, case, out):
    model = onnx.load(f'{out}/{case.name}.onnx')
    graph = Graph(model)
    names = graph.quantised()
    found = ranges(model, names, case, out)
    for node in model.graph.node:
        if node.op_type in KEEPS_RANGE and node.output[0] in found:
            found[node.output[0]] = found[node.input[0]]
    q = Quantiser(model, found)
    nodes = []
    for value in model.graph.input:
        if value.name in found:
            nodes += q.pair(value.name)
    for node in list(model.graph.node):
        for i, name in enumerate(node.input):
            if name in found:
                node.input[i] = name + '.dq'
        if node.op_type == 'Conv':
            nodes += q.conv(node)
        nodes.append(node)
        for name in node.output:
            if name in found:
                nodes += q.pair(name)
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    used = {name for node in nodes for name in node.input}
    kept = [t for t in model.graph.initializer if t.name in used]
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)
    onnx.save(model, path)


def main():
    out, wanted = sys.argv[1], sys.argv[2:]
    for case in cases.CASES:
        path = f'{out}/{case.name}.int8.onnx'
        if case.quantise and (not wanted or case.name in wanted) and not os.path.exists(path):
            quantise(path + '.part', case, out)
            os.replace(path + '.part', path)
            print(f'{os.path.basename(path)}: {os.path.getsize(path) / 2**20:.1f} MiB', flush=True)


if __name__ == '__main__':
    main()
