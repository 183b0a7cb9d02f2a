#!/usr/bin/python3
"""Trains slide_inpaint on composites whose hidden background is known.

  train_inpaint.py --cache CACHE --out inpaint.pt --minutes 60 [--adversarial .01] [--device cuda]

Goes on from inpaint.pt when it exists. Loss in the hole, where the truth is known: L1 and multi-scale gradients of the
smooth fill and its correction, without the mirrored detail. With --adversarial, for texture, the critic of patch_gan.py joins
when the rest has settled. A network whose last gates have shut learns nothing any more: the correction's size is printed.
"""
import argparse
import os

import cv2
import numpy as np
import torch

from common import Average, Schedule, save_checkpoint
from fill import background_fill
from inpaint_data import InpaintData
from inpaint_net import InpaintNet
from patch_gan import Adversary

ADVERSARIAL_FROM = .4  # share of the schedule
CHANNELS = torch.tensor([1., 1., 1., .5]).view(1, 4, 1, 1)  # disparity is smooth, half its error is enough


def squared(y, truth, mask):
    return ((y[:, :3] - truth[:, :3]) ** 2 * mask).sum(dim=(1, 2, 3)) / (3 * mask.sum(dim=(1, 2, 3))).clamp_min(1)


def loss_of(y, truth, mask):
    area = mask.mean(dim=(1, 2, 3)).clamp_min(.005).view(-1, 1, 1, 1)
    error = (y - truth) * CHANNELS.to(y.device) * mask
    total = (error.abs() / area).mean()
    for k in range(3):
        g = error[..., ::2 ** k, ::2 ** k] / area
        total = total + .25 * ((g[..., 1:] - g[..., :-1]).abs().mean() + (g[..., 1:, :] - g[..., :-1, :]).abs().mean())
    return total


@torch.no_grad()
def evaluate(net, tests, device):
    ours, fill, size = [], [], []
    for scene, truth, d, _, hole, mask, _ in tests:
        scene, truth, d, hole, mask = (torch.from_numpy(v)[None].to(device) for v in (scene, truth, d, hole, mask))
        filled, _, weight = background_fill(scene, d, hole)
        correction = net.correction(filled, weight, hole)
        size.append(float(squared(correction, 0 * truth, mask)))
        for y, out in ((filled + correction, ours), (filled, fill)):
            out.append(-10 * np.log10(float(squared(y.clamp(-1, 1), truth, mask)) / 4 + 1e-9))
    gain = np.array(ours) - np.array(fill)
    return f'hidden background: {np.mean(ours):.2f} dB, the fill alone {np.mean(fill):.2f} dB, gain {gain.mean():.2f}, better in {100 * (gain > 0).mean():.0f}%, correction of {np.sqrt(np.mean(size)):.4f} (RMS)'


def main():
    p = argparse.ArgumentParser()
    p.add_argument('--cache', required=True)
    p.add_argument('--out', required=True)
    p.add_argument('--minutes', type=float, required=True)
    p.add_argument('--device', default='cuda' if torch.cuda.is_available() else 'cpu')
    p.add_argument('--threads', type=int, default=1)
    p.add_argument('--size', type=int, default=128)
    p.add_argument('--batch', type=int, default=8)
    p.add_argument('--rate', type=float, default=6e-4)
    p.add_argument('--adversarial', type=float, default=0, help='weight of the adversarial term')
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    cv2.setNumThreads(1)
    saved = torch.load(a.out, map_location=a.device) if os.path.exists(a.out) else {}
    seed = saved.get('step', 0)
    torch.manual_seed(seed)
    data, held = InpaintData(a.cache, seed + 2, a.size), InpaintData(a.cache, 99, 160, held=True)
    tests = [held.sample() for _ in range(60)]
    net = InpaintNet()
    if saved:
        net.load_state_dict(saved['net'])
    else:
        scene, _, d, _, hole, _, _ = (torch.from_numpy(np.stack(t)) for t in zip(*[data.sample() for _ in range(8)]))
        filled, _, weight = background_fill(scene, d, hole)
        net.calibrate(torch.cat([filled, weight, hole], 1))
    net = net.to(a.device, memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(net.parameters(), lr=a.rate, betas=(.9, .99), weight_decay=1e-3)
    average = Average(net)
    if saved:
        average.values = saved['average']
    schedule = Schedule(optimiser, a.minutes, elapsed=saved.get('elapsed', 0.), step=seed)
    if saved:
        optimiser.load_state_dict(saved['optimiser'])
    adversary = Adversary(a.device, a.rate, saved.get('adversary')) if a.adversarial else None
    checkpoint = lambda: save_checkpoint(a.out, net, average, optimiser, schedule, **({'adversary': adversary.state()} if adversary else {}))
    with average.inside(net):
        print(evaluate(net, tests, a.device), flush=True)
    running, mark, scored = None, schedule.elapsed, schedule.elapsed
    while schedule.advance():
        scene, truth, d, _, hole, mask, cover = (torch.from_numpy(np.stack(t)).to(a.device) for t in zip(*[data.sample() for _ in range(a.batch)]))
        with torch.no_grad():
            filled, _, weight = background_fill(scene, d, hole)
        with torch.autocast(a.device, torch.bfloat16, enabled=a.device == 'cuda'):
            correction = net.correction(filled.contiguous(memory_format=torch.channels_last), weight, hole)
        y = filled + correction.float()
        loss = loss_of(y, truth, mask)
        if adversary and schedule.share > ADVERSARIAL_FROM:
            loss = loss + a.adversarial * adversary.loss(y, truth, mask, cover)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.)
        optimiser.step()
        average.update(net, schedule.step)
        running = loss.item() if running is None else .98 * running + .02 * loss.item()
        if schedule.step % 100 == 0:
            print(f'{schedule.step} {schedule.elapsed / 60:.1f} min, loss {running:.4f}', flush=True)
        if schedule.elapsed - mark > 150:
            mark = schedule.elapsed
            checkpoint()
        if schedule.elapsed - scored > 480:
            scored = schedule.elapsed
            with average.inside(net):
                print(evaluate(net, tests, a.device), flush=True)
    checkpoint()
    with average.inside(net):
        print('final', evaluate(net, tests, a.device), flush=True)


if __name__ == '__main__':
    main()
