#!/usr/bin/python3
"""Trains slide_matte: distils the mattes given, with exact composites among them.

  train_matte.py --cache CACHE --out matte.pt --minutes 40 [--net mobile|u2netp] [--start depth.safetensors] [--device cuda]
  train_matte.py ... --start matte.safetensors --logits 2      mattes as export.py --logits 2 wrote them

Goes on from matte.pt when it exists. Loss: cross entropy on every output, and on the first the absolute error of alpha and
of its gradient, with more weight where alpha is neither 0 nor 1.
"""
import cv2
import numpy as np
import torch
import torch.nn.functional as F

from common import Ragged, arguments, load_safetensors, resume, train
from matte_data import MatteData
from matte_net import NETS

WHOLE = 288  # pixels of the longer side at which subjects are seen whole
SMALL, LARGE = .25, .4  # parts of the photo that a matte covers there: up to the one it is taken from 384 pixels, from the other on from 288
EARLY = [(.6, 192, 256, 8), (.25, 256, 192, 8), (.15, 256, 352, 4)]
LATE = [(.35, 192, 256, 8), (.15, 256, 192, 8), (.5, 288, 384, 4)]


def loss_of(logits, alpha):
    total = sum(F.binary_cross_entropy_with_logits(s, alpha[:, None]) for s in logits) / len(logits)
    error = torch.sigmoid(logits[0][:, 0]) - alpha
    rim = 1 + 2 * (F.max_pool2d(alpha[:, None], 5, 1, 2) + F.max_pool2d(-alpha[:, None], 5, 1, 2))[:, 0]
    total = total + (error.abs() * rim).mean()
    for k in range(3):
        g, b = error[:, ::2 ** k, ::2 ** k], rim[:, ::2 ** k, ::2 ** k]
        total = total + ((g[:, 1:] - g[:, :-1]).abs() * b[:, 1:]).mean() + ((g[:, :, 1:] - g[:, :, :-1]).abs() * b[:, :, 1:]).mean()
    return total


@torch.no_grad()
def calm(net, data):
    """A depth network's features have any scale: brings the last ones to deviation 1, and the logits to zero."""
    seen = []
    hook = net.out2.register_forward_hook(lambda module, inputs, output: seen.append(output.std()))
    net(torch.from_numpy(np.stack([data.sample(192, 256)[0] for _ in range(4)])))
    hook.remove()
    for q in net.out2.parameters():
        q /= seen[0]
    for q in net.out3.parameters():
        q.zero_()


def input_size(h, w, side=384):
    """As the runtime: the aspect ratio kept, the longer side `side`, both multiples of 32."""
    s = side / max(h, w)
    return max(32, round(h * s / 32) * 32), max(32, round(w * s / 32) * 32)


@torch.no_grad()
def coarse_matte(net, image, device='cpu'):
    """-> the matte as the runtime finds it, 1 x 1 x h x w, and the photo at that size, bytes; image: bytes"""
    def found(side):
        h, w = input_size(*image.shape[:2], side)
        small = cv2.resize(image, (w, h), interpolation=cv2.INTER_CUBIC)
        return torch.sigmoid(net(torch.from_numpy(small.transpose(2, 0, 1)[None].astype(np.float32) / 255).to(device))[0].float()), small

    (fine, small), (whole, _) = found(384), found(WHOLE)
    return blended(fine, whole), small


def blended(fine, whole):
    """A subject that fills the photo is found whole at the size of the crops that the network has learnt from; small ones need more pixels."""
    t = ((whole.mean() - SMALL) / (LARGE - SMALL)).clamp(0, 1)
    return fine + t * t * (3 - 2 * t) * (F.interpolate(whole, size=fine.shape[2:], mode='bilinear', align_corners=False) - fine)


def predict(net, image, device):
    alpha, _ = coarse_matte(net, image, device)
    return F.interpolate(alpha, size=image.shape[:2], mode='bilinear', align_corners=False)[0, 0].cpu().numpy()


def evaluate(net, cache, device, limit=None):
    """Held-out photos: mean absolute error, mean gradient error, intersection over union at one half."""
    photos, mattes, held = Ragged(cache + '/photos'), Ragged(cache + '/mattes'), np.load(cache + '/held.npy')
    error, gradient, iou = [], [], []
    for i in held[:limit]:
        a, m = predict(net, photos[i], device), mattes[i].astype(np.float32) / 255
        error.append(np.abs(a - m).mean())
        gradient.append(np.mean([np.abs(np.diff(a - m, axis=k)).mean() for k in (0, 1)]))
        if (m > .5).mean() > .02:
            iou.append(((a > .5) & (m > .5)).sum() / ((a > .5) | (m > .5)).sum())
    return f'held-out mattes: error {np.mean(error):.4f}, gradient error {np.mean(gradient):.4f}, IoU {np.mean(iou):.3f}'


def main():
    a = arguments(6e-4, net=dict(choices=NETS, default='mobile'), start=dict(help='safetensors to start from; mobile only'),
                  logits=dict(type=float, help='those are mattes, exported with this factor; default: disparity, the last layer starts anew'),
                  seed=dict(type=int, default=0, help='another one: other samples'),
                  batch_factor=dict(type=int, default=1, help='multiplies all batch sizes'),
                  freeze=dict(type=int, default=0, help='encoder blocks that are not trained'),
                  side_factor=dict(type=float, default=1., help='of all sides, rounded to multiples of 32'))
    saved, seed = resume(a)
    data = MatteData(a.cache, seed + a.seed + 1)
    net = NETS[a.net]()
    if a.freeze:
        net.encoder.frozen = a.freeze
    if saved:
        net.load_state_dict(saved['net'])
    elif a.start:
        given = load_safetensors(a.start)
        if a.logits:
            net.load_state_dict({k: v / a.logits if k.startswith('out3') else v for k, v in given.items()})
        else:
            given = {k: v for k, v in given.items() if not k.startswith('out3')}
            assert not net.load_state_dict(given, strict=False).unexpected_keys
            calm(net, data)
    net = net.to(a.device, memory_format=torch.channels_last)
    encoder = [q for n, q in net.named_parameters() if n.startswith('encoder')]
    others = [q for n, q in net.named_parameters() if not n.startswith('encoder')]
    groups = [{'params': others, 'lr': a.rate}] + ([{'params': encoder, 'lr': a.rate / 4}] if encoder else [])
    optimiser = torch.optim.AdamW(groups, weight_decay=1e-2)
    print(len(data.known), 'mattes,', len(data.empty), 'of them empty', flush=True)

    def losses(share):
        sizes = LATE if share > .65 else EARLY
        _, h, w, batch = sizes[data.rng.choice(len(sizes), p=[s[0] for s in sizes])]
        h, w = (max(32, round(side * a.side_factor / 32) * 32) for side in (h, w))
        x, alpha = (torch.from_numpy(np.stack(t)).to(a.device) for t in zip(*[data.sample(h, w) for _ in range(batch * a.batch_factor)]))
        with torch.autocast(a.device, torch.bfloat16, enabled=a.device == 'cuda'):
            logits = net(x.contiguous(memory_format=torch.channels_last))
        loss = loss_of([s.float() for s in logits], alpha)
        return loss, {'loss': loss}

    train(a, saved, net, optimiser, losses, lambda: evaluate(net, a.cache, a.device))


if __name__ == '__main__':
    main()
