"""slide_depth: MobileNetV2 encoder (Sandler et al. 2018, batch norm folded), MiDaS-style fusion decoder (Ranftl et al. 2020).

Input: RGB/127.5 - 1, N x 3 x H x W, sides multiples of 32. Output: N x H x W, relative inverse depth, larger is nearer,
of no particular scale or sign. Strided encoder layers pad one row below and one column at the right only, as the ImageNet
weights were trained. All interpolation is bilinear x2 with half-pixel centres.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F


def relu6(x):
    return x.clamp(0, 6)  # F.relu6 has no gradient in bfloat16


# expansion, channels, repeats, stride
STAGES = [(1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1)]
TAPS = {2: 24, 5: 32, 12: 96, 16: 320}  # block -> channels, at 1/4, 1/8, 1/16 and 1/32 of the input


class Pointwise(nn.Conv2d):
    """A 1x1 convolution as one matrix product over channels-last pixels: half again as fast on a CPU in training."""

    def __init__(self, ic, oc):
        super().__init__(ic, oc, 1)

    def forward(self, x):
        return F.linear(x.permute(0, 2, 3, 1), self.weight[:, :, 0, 0], self.bias).permute(0, 3, 1, 2)


class InvertedResidual(nn.Module):
    def __init__(self, ic, oc, expansion, stride):
        super().__init__()
        hidden = ic * expansion
        self.stride, self.residual = stride, stride == 1 and ic == oc
        self.expand = Pointwise(ic, hidden) if expansion != 1 else None
        self.depthwise = nn.Conv2d(hidden, hidden, 3, stride, 1 if stride == 1 else 0, groups=hidden)
        self.project = Pointwise(hidden, oc)

    def forward(self, x):
        y = x if self.expand is None else relu6(self.expand(x))
        if self.stride == 2:
            y = F.pad(y, (0, 1, 0, 1))
        y = self.project(relu6(self.depthwise(y)))
        return x + y if self.residual else y


class Encoder(nn.Module):
    def __init__(self):
        super().__init__()
        self.stem = nn.Conv2d(3, 32, 3, 2, 0)
        blocks, ic = [], 32
        for expansion, oc, repeats, stride in STAGES:
            for i in range(repeats):
                blocks.append(InvertedResidual(ic, oc, expansion, stride if i == 0 else 1))
                ic = oc
        self.blocks = nn.ModuleList(blocks)
        self.frozen = 0  # the stem and so many blocks are not trained, which saves their backward pass

    def forward(self, x):
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            x = relu6(self.stem(F.pad(x, (0, 1, 0, 1))))
        taps = []
        for i, block in enumerate(self.blocks):
            with torch.set_grad_enabled(torch.is_grad_enabled() and i >= self.frozen):
                x = block(x)
            if i in TAPS:
                taps.append(x)
        return taps


class ResidualConvUnit(nn.Module):
    def __init__(self, f):
        super().__init__()
        self.conv1, self.conv2 = nn.Conv2d(f, f, 3, 1, 1), nn.Conv2d(f, f, 3, 1, 1)

    def forward(self, x):
        return x + self.conv2(F.relu(self.conv1(F.relu(x))))


class Fusion(nn.Module):
    def __init__(self, f, deepest=False):
        super().__init__()
        self.resConfUnit1 = None if deepest else ResidualConvUnit(f)
        self.resConfUnit2 = ResidualConvUnit(f)
        self.out_conv = Pointwise(f, f)

    def forward(self, x, skip=None):
        if skip is not None:
            x = x + self.resConfUnit1(skip)
        x = self.out_conv(self.resConfUnit2(x))
        return F.interpolate(x, scale_factor=2, mode='bilinear', align_corners=False)


class DepthNet(nn.Module):
    def __init__(self, features=48):
        super().__init__()
        self.encoder = Encoder()
        self.layer_rn = nn.ModuleList([nn.Conv2d(c, features, 3, 1, 1) for c in TAPS.values()])
        self.refine = nn.ModuleList([Fusion(features), Fusion(features), Fusion(features), Fusion(features, True)])
        self.out1 = nn.Conv2d(features, 24, 3, 1, 1)
        self.out2 = nn.Conv2d(24, 16, 3, 1, 1)
        self.out3 = Pointwise(16, 1)

    def forward(self, x):
        e = [conv(t) for conv, t in zip(self.layer_rn, self.encoder(x))]
        y = self.refine[3](e[3])
        for i in (2, 1, 0):
            y = self.refine[i](y, e[i])
        y = F.relu(self.out1(y))
        y = F.interpolate(y, scale_factor=2, mode='bilinear', align_corners=False)
        with torch.autocast(y.device.type, enabled=False):  # not in bfloat16, where oneDNN's gradient of out2 is not finite
            return self.out3(F.relu(self.out2(y.to(self.out2.weight.dtype))))[:, 0]
