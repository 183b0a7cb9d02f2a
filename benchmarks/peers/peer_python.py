#!/usr/bin/python3
"""PyTorch and OpenCV by the line protocol of README.md:

  peer_python.py torch-fp32|torch-bf16|opencv CASE OUT THREADS
"""
import json
import os
import sys
import time
import warnings

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cases  # noqa: E402
import tensors  # noqa: E402


def status(key):
    with open('/proc/self/status') as f:
        return next((int(line.split()[1]) for line in f if line.startswith(key + ':')), 0)


class Torch:
    """Traced and frozen, batch norm folded by optimize_for_inference, which also puts weights into oneDNN's layouts."""

    def __init__(self, case, out, threads, kind):
        import torch
        from export_onnx import load
        self.torch = torch
        torch.set_num_threads(threads)
        torch.set_grad_enabled(False)
        warnings.simplefilter('ignore')  # of tracing
        self.dtype = torch.bfloat16 if kind == 'torch-bf16' else torch.float32
        self.base = status('VmHWM')
        x = tensors.load(f'{out}/{case.name}.case.safetensors', 'input.')
        self.x = [torch.from_numpy(v).to(self.dtype) for v in x.values()]
        start = time.perf_counter()
        module = load(case, out).to(self.dtype)
        if self.dtype == torch.bfloat16:
            module = module.to(memory_format=torch.channels_last)
            self.x = [v.to(memory_format=torch.channels_last) for v in self.x]
        self.run_module = self.optimised(module)
        self.load_ms = 1e3 * (time.perf_counter() - start)
        self.version = f'PyTorch {torch.__version__}'

    def optimised(self, module):
        if self.dtype != self.torch.float32:
            return self.torch.jit.freeze(self.torch.jit.trace(module, self.x, check_trace=False))
        traced = self.torch.jit.trace(module, self.x, check_trace=False)
        return self.torch.jit.optimize_for_inference(self.torch.jit.freeze(traced))

    def run(self):
        y = self.run_module(*self.x)
        return y if isinstance(y, (tuple, list)) else (y,)

    def arrays(self, y):
        return [v.float().numpy() for v in y]


class OpenCv:
    def __init__(self, case, out, threads, _kind):
        import cv2
        cv2.setNumThreads(threads)
        self.base = status('VmHWM')
        self.x = tensors.load(f'{out}/{case.name}.case.safetensors', 'input.')
        count = len(tensors.load(f'{out}/{case.name}.case.safetensors', 'output.'))
        start = time.perf_counter()
        self.net = cv2.dnn.readNetFromONNX(f'{out}/{case.name}.opencv.onnx')
        self.load_ms = 1e3 * (time.perf_counter() - start)
        self.names = [f'output.{i}' for i in range(count)]
        self.version = f'OpenCV {cv2.__version__}'

    def run(self):
        for name, values in self.x.items():
            self.net.setInput(values, name)
        return self.net.forward(self.names)

    def arrays(self, y):
        return [np.asarray(v, np.float32) for v in y]


def main():
    kind, name, out, threads = sys.argv[1:]
    # Libraries talk on standard output: the protocol gets its own copy of it.
    channel = os.fdopen(os.dup(1), 'w')
    os.dup2(2, 1)

    def say(message):
        channel.write(json.dumps(message) + '\n')
        channel.flush()

    try:
        peer = (OpenCv if kind == 'opencv' else Torch)(cases.find(name), out, int(threads), kind)
        facts = {'load_ms': peer.load_ms, 'base_kib': peer.base, 'threads': int(threads), 'version': peer.version}
        say(facts | {'peak_kib': status('VmHWM')})
        y = None
        for line in map(str.strip, sys.stdin):
            if line == 'run':
                start = time.perf_counter()
                y = peer.run()
                say({'ms': 1e3 * (time.perf_counter() - start)})
            elif line == 'facts':
                say(facts | {'peak_kib': status('VmHWM')})
            elif line.startswith('output '):
                with open(line[7:], 'wb') as f:
                    for v in peer.arrays(y):
                        f.write(np.ascontiguousarray(v).tobytes())
                say({})
            elif line == 'quit':
                break
    except Exception as error:  # what a peer cannot run is a result
        say({'error': f'{type(error).__name__}: {error}'.splitlines()[0][:300]})
        sys.exit(1)


if __name__ == '__main__':
    main()
