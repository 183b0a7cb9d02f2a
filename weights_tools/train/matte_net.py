"""slide_matte: the depth network's architecture with a sigmoid at its end; input as slide_depth, output a matte in [0, 1]."""
import torch

from depth_net import DepthNet
from u2netp import MEAN, STD, U2NetP


class MatteNet(DepthNet):
    """Takes RGB in [0, 1]; gives a list of logits (one)."""

    def forward(self, x):
        return [super().forward(x * 2 - 1)[:, None]]


class MatteU2NetP(U2NetP):
    """Takes RGB in [0, 1]; gives seven logits, the fused one first."""

    def forward(self, x):
        shape = (1, 3, 1, 1)
        return super().forward((x - torch.tensor(MEAN, device=x.device).view(shape)) / torch.tensor(STD, device=x.device).view(shape))


NETS = {'mobile': MatteNet, 'u2netp': MatteU2NetP}
