#!/usr/bin/python3
"""Golden outputs of the project's own networks: PyTorch in float64 on the exported (float16) weights.

  make_slide_networks.py WEIGHTS OUT.safetensors      WEIGHTS: the folder of slide_*.safetensors. Debian: python3-torch, python3-opencv
"""
import os
import sys

import numpy as np
import torch
import torch.nn.functional as F

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, '../../weights_tools/train')]
from common import load_safetensors  # noqa: E402
from depth_net import DepthNet  # noqa: E402
from guided import MATTE_RADIUS, guided_upsample  # noqa: E402
from inpaint_net import InpaintNet  # noqa: E402
from make_fill import save  # noqa: E402
from matte_net import MatteNet  # noqa: E402
from rim_net import RimNet  # noqa: E402
from train_matte import LARGE, SMALL, WHOLE, blended, input_size  # noqa: E402

H, W = 64, 96


def net(kind, name):
    n = kind()
    n.load_state_dict(load_safetensors(f'{sys.argv[1]}/{name}.safetensors'))
    return n.double().eval()


def single(v):
    """What float32 holds exactly, so that both executors start from the same numbers."""
    return torch.from_numpy(np.asarray(v, np.float32).astype(np.float64))


def matte_stage(photo):
    """graphs/stages' matte of a photo in [0, 1]: at 384 and 288 pixels on the longer side, enlarged with the photo as guide."""
    sized = lambda *size: F.interpolate(photo, size=size, mode='bicubic', align_corners=False)
    small, network = sized(*input_size(*photo.shape[2:])), net(MatteNet, 'slide_matte')
    fine, whole = (torch.sigmoid(network(v)[0]) for v in (small, sized(*input_size(*photo.shape[2:], WHOLE))))
    assert SMALL + .02 < whole.mean() < LARGE - .02  # a bit of both
    matte = blended(fine, whole)
    picture = lambda v: v[0].permute(1, 2, 0).numpy()
    return torch.from_numpy(guided_upsample(matte[0, 0].numpy(), picture(small), picture(photo), MATTE_RADIUS).clip(0, 1))[None, None]


@torch.no_grad()
def main():
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:H, :W] / H
    disc = (x - .8) ** 2 + (y - .55) ** 2 < .08
    photo = np.stack([.3 + .4 * y, .5 + .2 * np.sin(9 * x), .6 - .3 * y]) * ~disc + np.array([.8, .4, .2])[:, None, None] * disc
    photo = single((photo + rng.normal(0, .03, photo.shape)).clip(0, 1))[None]
    d = single(.1 + .3 * y + .5 * disc)[None, None]
    hole = single(disc & ((x - .8) ** 2 + (y - .55) ** 2 > .04))[None, None]
    rgbd = torch.cat([photo, d], 1) * 2 - 1
    rgbd = single(rgbd)
    out = {k: v.float() for k, v in {'photo': rgbd[:, :3], 'disparity': d, 'hole': hole, 'rgbd': rgbd}.items()}
    out['slide_depth'] = net(DepthNet, 'slide_depth')(rgbd[:, :3])[:, None]
    out['slide_matte'] = torch.sigmoid(net(MatteNet, 'slide_matte')(rgbd[:, :3] / 2 + .5)[0])
    out['matte_stage'] = matte_stage(rgbd[:, :3, 12:60, 20:84] / 2 + .5)
    out['slide_inpaint'] = net(InpaintNet, 'slide_inpaint')(rgbd, d, hole)
    coarse = single(np.clip((.4 - np.hypot(x - .78, y - .52)) / .2, 0, 1))[None, None]
    out['coarse'] = coarse.float()
    out['slide_rim'] = net(RimNet, 'slide_rim')(rgbd[:, :3] / 2 + .5, coarse)
    save(sys.argv[2], out)
    print({k: float(v.abs().max()) for k, v in out.items()})


if __name__ == '__main__':
    main()
