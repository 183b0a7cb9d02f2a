"""slide_inpaint: the depth-aware fill, and the paper's coarse network (supplement, table T1) for what it misses.

The network sees the picture with all that is not background filled in, the weight of its colours and the hole, and gives a
correction of the fill. Its last layer starts at zero: training starts from the fill.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F

from fill import background_fill

WIDTH = 12  # channels after the first gate; the paper has 24


class GatedConv(nn.Module):
    def __init__(self, ic, oc, kernel=3, stride=1, dilation=1):
        super().__init__()
        self.conv = nn.Conv2d(ic, 2 * oc, kernel, stride, dilation * (kernel // 2), dilation)
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity='relu')
        nn.init.zeros_(self.conv.bias)
        nn.init.constant_(self.conv.bias[oc:], 2)  # gates start open: shut ones pass no gradient

    def forward(self, x):
        a, g = self.conv(x).chunk(2, 1)
        return F.elu(a) * torch.sigmoid(g)


class Plain(nn.Module):
    def __init__(self, ic, oc):
        super().__init__()
        self.conv = nn.Conv2d(ic, oc, 3, 1, 1)
        nn.init.zeros_(self.conv.weight)
        nn.init.zeros_(self.conv.bias)

    def forward(self, x):
        return self.conv(x)


class InpaintNet(nn.Module):
    def __init__(self, c=WIDTH):
        super().__init__()
        spec = [(6, c, 5, 2), (c, c), (c, 2 * c, 3, 2), (2 * c, 2 * c), (2 * c, 4 * c)]
        spec += [(4 * c, 4 * c, 3, 1, d) for d in (2, 4, 8, 16, 1, 1)]
        spec += [(4 * c, 2 * c), (2 * c, 2 * c), (2 * c, c), (c, c // 2)]
        for i, s in enumerate(spec):
            setattr(self, f'conv{i + 1}', GatedConv(*s))
        self.conv16 = Plain(c // 2, 4)

    def correction(self, filled, weight, hole):
        x = torch.cat([filled, weight, hole], 1)
        for i in range(1, 16):
            x = getattr(self, f'conv{i}')(self.enlarge(x, i))
        return self.conv16(x)

    @staticmethod
    def enlarge(x, i):
        return F.interpolate(x, scale_factor=2, mode='nearest') if i in (12, 14) else x

    @torch.no_grad()
    def calibrate(self, x):
        """Scales the layers so that their outputs have deviation 1 (Mishkin and Matas 2016). Every gate halves: without this
        nothing is left of the picture after fifteen layers, and nothing is learnt."""
        for i in range(1, 16):
            layer, x = getattr(self, f'conv{i}'), self.enlarge(x, i)
            for _ in range(5):
                layer.conv.weight /= layer(x).std()
            x = layer(x)

    def forward(self, rgbd, d, hole):
        """rgbd: N x 4 x H x W in [-1, 1], d: D1 in [0, 1], hole: zeros and ones; sides multiples of 4 -> RGBD of the background"""
        smooth, textured, weight = background_fill(rgbd, d, hole)
        return textured + self.correction(smooth, weight, hole)
