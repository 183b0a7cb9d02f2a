"""slide_matte: U2-NetP (Qin et al. 2020, "U2-Net: Going deeper with nested U-structure"), by the authors' parameter names.

Input: (RGB/255 - mean) / std of ImageNet. Output: seven logits, the fused one first; its sigmoid is the matte.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F

MEAN, STD = (.485, .456, .406), (.229, .224, .225)
MIDDLE, OUT = 16, 64


class REBNCONV(nn.Module):
    def __init__(self, ic, oc, dirate=1):
        super().__init__()
        self.conv_s1 = nn.Conv2d(ic, oc, 3, padding=dirate, dilation=dirate)
        self.bn_s1 = nn.BatchNorm2d(oc)

    def forward(self, x):
        return F.relu(self.bn_s1(self.conv_s1(x)))


def pool(x):
    return F.max_pool2d(x, 2, 2, ceil_mode=True)


def up(x, like):
    return F.interpolate(x, size=like.shape[2:], mode='bilinear', align_corners=False)


class RSU(nn.Module):
    """A U of the given height whose bottom layer is dilated; its input is added to its output."""

    def __init__(self, height, ic):
        super().__init__()
        self.height = height
        self.rebnconvin = REBNCONV(ic, OUT)
        self.rebnconv1 = REBNCONV(OUT, MIDDLE)
        for i in range(2, height):
            setattr(self, f'rebnconv{i}', REBNCONV(MIDDLE, MIDDLE))
        setattr(self, f'rebnconv{height}', REBNCONV(MIDDLE, MIDDLE, 2))
        for i in range(height - 1, 0, -1):
            setattr(self, f'rebnconv{i}d', REBNCONV(2 * MIDDLE, OUT if i == 1 else MIDDLE))

    def forward(self, x):
        start = self.rebnconvin(x)
        x, levels = start, []
        for i in range(1, self.height):
            x = getattr(self, f'rebnconv{i}')(x if i == 1 else pool(x))
            levels.append(x)
        x = getattr(self, f'rebnconv{self.height}')(x)
        for i in range(self.height - 1, 0, -1):
            skip = levels[i - 1]
            if x.shape[2:] != skip.shape[2:]:
                x = up(x, skip)
            x = getattr(self, f'rebnconv{i}d')(torch.cat([x, skip], 1))
        return x + start


class RSU4F(nn.Module):
    """The same with dilations 1, 2, 4, 8 in place of pooling."""

    def __init__(self, ic):
        super().__init__()
        self.rebnconvin = REBNCONV(ic, OUT)
        self.rebnconv1 = REBNCONV(OUT, MIDDLE, 1)
        self.rebnconv2 = REBNCONV(MIDDLE, MIDDLE, 2)
        self.rebnconv3 = REBNCONV(MIDDLE, MIDDLE, 4)
        self.rebnconv4 = REBNCONV(MIDDLE, MIDDLE, 8)
        self.rebnconv3d = REBNCONV(2 * MIDDLE, MIDDLE, 4)
        self.rebnconv2d = REBNCONV(2 * MIDDLE, MIDDLE, 2)
        self.rebnconv1d = REBNCONV(2 * MIDDLE, OUT, 1)

    def forward(self, x):
        x = self.rebnconvin(x)
        x1 = self.rebnconv1(x)
        x2 = self.rebnconv2(x1)
        x3 = self.rebnconv3(x2)
        y = self.rebnconv3d(torch.cat([self.rebnconv4(x3), x3], 1))
        y = self.rebnconv2d(torch.cat([y, x2], 1))
        return self.rebnconv1d(torch.cat([y, x1], 1)) + x


class U2NetP(nn.Module):
    def __init__(self):
        super().__init__()
        for i, height in enumerate((7, 6, 5, 4), 1):
            setattr(self, f'stage{i}', RSU(height, 3 if i == 1 else OUT))
            setattr(self, f'stage{i}d', RSU(height, 2 * OUT))
        self.stage5, self.stage6, self.stage5d = RSU4F(OUT), RSU4F(OUT), RSU4F(2 * OUT)
        for i in range(1, 7):
            setattr(self, f'side{i}', nn.Conv2d(OUT, 1, 3, padding=1))
        self.outconv = nn.Conv2d(6, 1, 1)

    def forward(self, x):
        levels = []
        for i in range(1, 7):
            x = getattr(self, f'stage{i}')(x if i == 1 else pool(x))
            levels.append(x)
        tops = [x]
        for i in range(5, 0, -1):
            x = getattr(self, f'stage{i}d')(torch.cat([up(x, levels[i - 1]), levels[i - 1]], 1))
            tops.append(x)
        sides = [getattr(self, f'side{i}')(top) for i, top in zip(range(6, 0, -1), tops)][::-1]
        sides = sides[:1] + [up(s, sides[0]) for s in sides[1:]]
        return [self.outconv(torch.cat(sides, 1)), *sides]
