"""What the three training programs share: options, the loop, the schedule, averaged weights, checkpoints, the weight file.

A schedule here is a share of wall-clock time, not a number of steps: the same command makes sense on two slow cores and on
a GPU, and a run that was stopped goes on from its checkpoint where it was in its own schedule.
"""
import argparse
import json
import math
import os
import struct
import time

import cv2
import numpy as np
import torch

KINDS = {'F16': np.float16, 'F32': np.float32, 'F64': np.float64}


def load_safetensors(path):
    """-> {name: float32 tensor}"""
    with open(path, 'rb') as f:
        raw = f.read()
    n, = struct.unpack('<Q', raw[:8])
    header = json.loads(raw[8:8 + n])
    header.pop('__metadata__', None)
    out = {}
    for name, entry in header.items():
        begin, end = entry['data_offsets']
        values = np.frombuffer(raw[8 + n + begin:8 + n + end], KINDS[entry['dtype']])
        out[name] = torch.from_numpy(values.astype(np.float32).reshape(entry['shape']))
    return out


def save_safetensors(path, tensors, metadata):
    """Writes float16 tensors, sorted by name, the data section aligned to 64 bytes."""
    header, data, offset = {'__metadata__': metadata}, [], 0
    for name in sorted(tensors):
        values = tensors[name].detach().cpu().numpy().astype(np.float16)
        if not np.isfinite(values).all():
            raise ValueError(f'{name} does not fit into float16')
        data.append(values.tobytes())
        header[name] = {'dtype': 'F16', 'shape': list(values.shape), 'data_offsets': [offset, offset + len(data[-1])]}
        offset += len(data[-1])
    text = json.dumps(header, separators=(',', ':')).encode()
    text += b' ' * (-(8 + len(text)) % 64)
    with open(path + '.part', 'wb') as f:
        f.write(struct.pack('<Q', len(text)) + text + b''.join(data))
    os.replace(path + '.part', path)


class Schedule:
    """Cosine over `minutes` of wall clock after a short warm-up; `share` runs from 0 to 1."""

    def __init__(self, optimiser, minutes, warmup_steps=100, elapsed=0., step=0):
        self.optimiser, self.seconds, self.warmup = optimiser, 60 * minutes, warmup_steps
        self.base = [g['lr'] for g in optimiser.param_groups]
        self.start, self.step, self.first = time.time() - elapsed, step, step

    @property
    def elapsed(self):
        return time.time() - self.start

    @property
    def share(self):
        return self.elapsed / self.seconds

    def advance(self):
        """Sets the rates for the next step; false when the time is over."""
        share = self.share
        if share >= 1:
            return False
        self.step += 1
        factor = min(1, (self.step - self.first) / self.warmup) * (.5 * (1 + math.cos(math.pi * share)) + .01)
        for group, lr in zip(self.optimiser.param_groups, self.base):
            group['lr'] = lr * factor
        return True


class Average:
    """Exponential moving average of the weights: what is evaluated and exported."""

    def __init__(self, net, decay=.998):
        self.decay, self.values = decay, {k: v.detach().clone() for k, v in net.state_dict().items()}

    @torch.no_grad()
    def update(self, net, step):
        keep = min(self.decay, step / (step + 20))
        for k, v in net.state_dict().items():
            if v.dtype.is_floating_point:
                self.values[k].mul_(keep).add_(v, alpha=1 - keep)
            else:
                self.values[k].copy_(v)

    def inside(self, net):
        """with average.inside(net): the network holds the averaged weights."""
        return _Swapped(net, self.values)


class _Swapped:
    def __init__(self, net, values):
        self.net, self.values = net, values

    def __enter__(self):
        self.own = {k: v.clone() for k, v in self.net.state_dict().items()}
        self.net.load_state_dict(self.values)
        self.net.eval()

    def __exit__(self, *_):
        self.net.load_state_dict(self.own)
        self.net.train()


def arguments(rate, **more):
    """Of a training program; more: further options and their keywords of add_argument()."""
    p = argparse.ArgumentParser()
    p.add_argument('--cache', required=True)
    p.add_argument('--out', required=True, help='the checkpoint, which a run goes on from')
    p.add_argument('--minutes', type=float, required=True)
    p.add_argument('--device', default='cuda' if torch.cuda.is_available() else 'cpu')
    p.add_argument('--threads', type=int, default=1)
    p.add_argument('--rate', type=float, default=rate)
    for name, options in more.items():
        p.add_argument('--' + name.replace('_', '-'), **options)
    return p.parse_args()


def resume(a):
    """-> what the checkpoint holds, or nothing; its step, the seed of what follows"""
    torch.set_num_threads(a.threads)
    cv2.setNumThreads(1)
    saved = torch.load(a.out, map_location=a.device) if os.path.exists(a.out) else {}
    seed = saved.get('step', 0)
    torch.manual_seed(seed)
    return saved, seed


def train(a, saved, net, optimiser, losses, test):
    """losses(share of the schedule) -> the loss, {name: number to print}; test() -> text about the averaged weights, which net then holds."""
    average = Average(net)
    schedule = Schedule(optimiser, a.minutes, elapsed=saved.get('elapsed', 0.), step=saved.get('step', 0))
    if saved:
        average.values = saved['average']
        optimiser.load_state_dict(saved['optimiser'])

    def save():
        state = {'net': net.state_dict(), 'average': average.values, 'optimiser': optimiser.state_dict(), 'elapsed': schedule.elapsed, 'step': schedule.step}
        torch.save(state, a.out + '.part')
        os.replace(a.out + '.part', a.out)

    def tell(when):
        with average.inside(net):
            print(when, test(), flush=True)

    tell('start')
    running, mark, scored = {}, schedule.elapsed, schedule.elapsed
    while schedule.advance():
        loss, parts = losses(schedule.share)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.)
        optimiser.step()
        average.update(net, schedule.step)
        running = {name: .98 * running.get(name, float(v)) + .02 * float(v) for name, v in parts.items()}
        if schedule.step % 100 == 0:
            print(f'{schedule.step} {schedule.elapsed / 60:.1f} min,', ', '.join(f'{name} {v:.4f}' for name, v in running.items()), flush=True)
        if schedule.elapsed - mark > 150:
            mark = schedule.elapsed
            save()
        if schedule.elapsed - scored > 480:
            scored = schedule.elapsed
            tell('test')
    save()
    tell('final')


class Ragged:
    """Images of different sizes in one file that is mapped, not read: NAME.npy (bytes) and NAME_index.npy (h, w, c, offset)."""

    def __init__(self, path):
        self.data, self.index = np.load(path + '.npy', mmap_mode='r'), np.load(path + '_index.npy')

    def __len__(self):
        return len(self.index)

    def __getitem__(self, i):  # raises IndexError past the end, which ends a for loop
        h, w, c, offset = self.index[i]
        flat = self.data[offset:offset + h * w * c]
        return flat.reshape(h, w, c) if c > 1 else flat.reshape(h, w)

    @staticmethod
    def write(path, images):
        index, offset = [], 0
        for x in images:
            h, w = x.shape[:2]
            c = 1 if x.ndim == 2 else x.shape[2]
            index.append((h, w, c, offset))
            offset += h * w * c
        data = np.lib.format.open_memmap(path + '.npy', 'w+', np.uint8, (offset,))
        for x, (h, w, c, at) in zip(images, index):
            data[at:at + h * w * c] = x.ravel()
        data.flush()
        np.save(path + '_index.npy', np.array(index, np.int64))
