#!/usr/bin/python3
"""Trains slide_depth.

  train_depth.py --cache CACHE --out depth.pt --minutes 100 [--start weights.safetensors] [--device cuda] [--bf16]

Goes on from depth.pt when it exists. Loss: MiDaS' scale- and shift-invariant trimmed error with multi-scale gradient
matching (Ranftl et al. 2020, eq. 5 to 8), more weight on gradients along edges, and, for rooms, the relative error of
depth after the best scale and shift of disparity.
"""
import cv2
import numpy as np
import torch
import torch.nn.functional as F

from common import Ragged, arguments, load_safetensors, resume, train
from depth_data import DepthData, jumps
from depth_net import DepthNet

# share of the schedule -> (probability, height, width, batch); larger crops late
EARLY = [(.5, 192, 256, 8), (.1, 256, 192, 8), (.3, 288, 384, 4), (.1, 384, 256, 4)]
LATE = [(.1, 192, 256, 8), (.7, 288, 384, 4), (.2, 384, 256, 4)]


def normalise(y):
    flat = y.flatten(1)
    t = flat.median(1, keepdim=True).values
    return ((flat - t) / (flat - t).abs().mean(1, keepdim=True).clamp_min(1e-3)).view_as(y)


def aligned(q, d):
    """q after the least-squares scale and shift onto d, per picture"""
    a, b = q.flatten(1), d.flatten(1)
    ma, mb = a.mean(1, keepdim=True), b.mean(1, keepdim=True)
    scale = ((a - ma) * (b - mb)).mean(1, keepdim=True) / ((a - ma) ** 2).mean(1, keepdim=True).clamp_min(1e-6)
    return (scale * (a - ma) + mb).view_as(q)


def loss_of(prediction, d, weight, edge, relative):
    difference = normalise(prediction) - normalise(d)
    error = difference.abs() * weight
    cut = torch.quantile(error.detach().flatten(1)[:, ::4], .9, dim=1).view(-1, 1, 1)
    total = torch.minimum(error, cut).mean()
    believed = weight + 2 * edge
    for k in range(4):
        g, b = difference[:, ::2 ** k, ::2 ** k], believed[:, ::2 ** k, ::2 ** k]
        dy, dx = (g[:, 1:] - g[:, :-1]).abs(), (g[:, :, 1:] - g[:, :, :-1]).abs()
        total = total + .5 * ((dy * torch.minimum(b[:, 1:], b[:, :-1])).mean() + (dx * torch.minimum(b[:, :, 1:], b[:, :, :-1])).mean())
    measured = (relative > 0).float()
    share = measured.mean(dim=(1, 2), keepdim=True)
    whole = (share == 1).float()  # a pasted cut-out spoils the fit
    return total + .7 * ((aligned(prediction, d) - d).abs() * relative * whole).mean()


@torch.no_grad()
def evaluate(net, cache, device, h=192, w=256):
    """Held-out rooms: fraction of pixels with depth ratio > 1.25, and AbsRel, after the best scale and shift in disparity."""
    over, relative = [], []
    for image, z in zip(np.load(cache + '/holdout_rgb.npy'), np.load(cache + '/holdout_depth.npy')):
        x = torch.from_numpy(cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA if h < 238 else cv2.INTER_LINEAR).transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1)
        z = np.maximum(z.astype(np.float64) / 25.5, .3)
        q = F.interpolate(net(x.to(device))[None].float(), size=z.shape, mode='bicubic', align_corners=False)[0, 0].cpu().double().numpy()
        s, t = np.linalg.lstsq(np.stack([q.ravel(), np.ones(q.size)], 1), 1 / z.ravel(), rcond=None)[0]
        depth = 1 / np.maximum(q * s + t, .1)
        over.append((np.maximum(depth / z, z / depth) > 1.25).mean())
        relative.append((np.abs(depth - z) / z).mean())
    return f'ratio > 1.25 on {100 * np.mean(over):.2f}%, AbsRel {np.mean(relative):.4f}'


@torch.no_grad()
def evaluate_wild(net, cache, device, side=384):
    """Held-out photos in the wild: RMSE after the best scale and shift, pairs of pixels in the wrong order, edges F1."""
    rng, scores = np.random.default_rng(7), []
    for image, d in zip(Ragged(cache + '/wild_holdout'), Ragged(cache + '/wild_holdout_disparity')):
        d = d / 255.
        h, w = (max(32, round(v * side / max(d.shape) / 32) * 32) for v in d.shape)
        x = torch.from_numpy(cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA).transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1)
        q = F.interpolate(net(x.to(device))[None].float(), size=d.shape, mode='bicubic', align_corners=False)[0, 0].cpu().double().numpy()
        s, t = np.linalg.lstsq(np.stack([q.ravel(), np.ones(q.size)], 1), d.ravel(), rcond=None)[0]
        q = q * s + t
        i, j = rng.integers(0, d.size, (2, 20000))
        gap = d.ravel()[i] - d.ravel()[j]
        far = np.abs(gap) > .05
        found, true = (jumps(v) for v in (q, d))
        near = lambda m: cv2.dilate(m.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        recall, precision = (true & near(found)).sum() / max(1, true.sum()), (found & near(true)).sum() / max(1, found.sum())
        scores.append((np.sqrt(((q - d) ** 2).mean()), (np.sign(gap) != np.sign(q.ravel()[i] - q.ravel()[j]))[far].mean(),
                       2 * recall * precision / max(1e-9, recall + precision)))
    rmse, order, f1 = np.mean(scores, 0)
    return f'wild RMSE {rmse:.4f}, wrong order {100 * order:.1f}%, edges F1 {f1:.3f}'


def main():
    a = arguments(4e-4, start=dict(help='safetensors: an ImageNet encoder or a whole network'),
                  batch_factor=dict(type=int, default=1, help='multiplies all batch sizes'),
                  bf16=dict(action='store_true', help='on a CPU, too: pays where the processor has AMX'),
                  freeze=dict(type=int, default=0, help='encoder blocks that are not trained'))
    saved, seed = resume(a)
    data = DepthData(a.cache, seed)
    net = DepthNet()
    net.encoder.frozen = a.freeze
    if saved:
        net.load_state_dict(saved['net'])
    elif a.start:
        assert not net.load_state_dict(load_safetensors(a.start), strict=False).unexpected_keys
    net = net.to(a.device, memory_format=torch.channels_last)
    decoder = [q for n, q in net.named_parameters() if not n.startswith('encoder')]
    optimiser = torch.optim.AdamW([{'params': net.encoder.parameters(), 'lr': a.rate / 4}, {'params': decoder, 'lr': a.rate}], weight_decay=1e-2)
    print(len(data.subjects), 'photos with a subject', flush=True)

    def losses(share):
        sizes = LATE if share > .6 else EARLY
        _, h, w, batch = sizes[data.rng.choice(len(sizes), p=[s[0] for s in sizes])]
        x, *maps = (torch.from_numpy(np.stack(t)).to(a.device) for t in zip(*[data.sample(h, w) for _ in range(batch * a.batch_factor)]))
        with torch.autocast(a.device, torch.bfloat16, enabled=a.device == 'cuda' or a.bf16):
            prediction = net(x.contiguous(memory_format=torch.channels_last))
        loss = loss_of(prediction.float(), *maps)
        return loss, {'loss': loss}

    train(a, saved, net, optimiser, losses, lambda: evaluate(net, a.cache, a.device) + '; ' + evaluate_wild(net, a.cache, a.device))


if __name__ == '__main__':
    main()
