"""The networks of graphs/ as PyTorch modules whose parameters have the names that graphs/ looks for."""
import os
import sys

import torch
import torch.nn as nn
import torch.nn.functional as F

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../weights_tools/train'))
from depth_net import DepthNet, Pointwise  # noqa: E402
from inpaint_net import InpaintNet  # noqa: E402, F401 (a case names it)


def named(**children):
    """A module that only holds others."""
    module = nn.Module()
    for name, child in children.items():
        setattr(module, name, child)
    return module


def enlarge(x, factor=2, aligned=False):
    return F.interpolate(x, scale_factor=factor, mode='bilinear', align_corners=aligned)


def enlarge_like(x, other):
    return F.interpolate(x, size=[int(n) for n in other.shape[2:]], mode='bilinear', align_corners=False)


# MiDaS v2.1 (Ranftl et al., TPAMI 2020): see graphs/midas_v21.cpp, midas_v21_small.cpp and midas_blocks.cpp.

class GroupedBottleneck(nn.Module):
    """ResNeXt-101 32x8d's block."""

    def __init__(self, ic, planes, stride):
        super().__init__()
        c = 4 * planes
        self.conv1, self.bn1 = nn.Conv2d(ic, c, 1, bias=False), nn.BatchNorm2d(c)
        self.conv2, self.bn2 = nn.Conv2d(c, c, 3, stride, 1, groups=32, bias=False), nn.BatchNorm2d(c)
        self.conv3, self.bn3 = nn.Conv2d(c, c, 1, bias=False), nn.BatchNorm2d(c)
        self.downsample = None
        if stride != 1 or ic != c:
            self.downsample = nn.Sequential(nn.Conv2d(ic, c, 1, stride, bias=False), nn.BatchNorm2d(c))

    def forward(self, x):
        y = F.relu(self.bn1(self.conv1(x)))
        y = F.relu(self.bn2(self.conv2(y)))
        return F.relu(self.bn3(self.conv3(y)) + (x if self.downsample is None else self.downsample(x)))


def grouped_stage(ic, planes, blocks, stride):
    return nn.Sequential(*[GroupedBottleneck(4 * planes if i else ic, planes, 1 if i else stride) for i in range(blocks)])


class ResidualUnit(nn.Module):
    def __init__(self, channels, rectified):
        super().__init__()
        self.conv1, self.conv2 = nn.Conv2d(channels, channels, 3, 1, 1), nn.Conv2d(channels, channels, 3, 1, 1)
        self.rectified = rectified  # the skip connection carries relu(x)

    def forward(self, x):
        y = F.relu(x)
        return (y if self.rectified else x) + self.conv2(F.relu(self.conv1(y)))


class Fusion(nn.Module):
    def __init__(self, channels, rectified, has_level, oc=0):
        super().__init__()
        if has_level:
            self.resConfUnit1 = ResidualUnit(channels, rectified)
        self.resConfUnit2 = ResidualUnit(channels, rectified)
        if oc:
            self.out_conv = nn.Conv2d(channels, oc, 1)
        self.oc = oc

    def forward(self, x, level=None):
        if level is not None:
            x = x + self.resConfUnit1(level)
        x = enlarge(self.resConfUnit2(x), aligned=True)
        return self.out_conv(x) if self.oc else x


class Enlarge(nn.Module):
    def forward(self, x):
        return enlarge(x)


def depth_head(ic, channels):
    return nn.Sequential(nn.Conv2d(ic, channels, 3, 1, 1), Enlarge(), nn.Conv2d(channels, 32, 3, 1, 1), nn.ReLU(),
                         nn.Conv2d(32, 1, 1), nn.ReLU())


class Midas(nn.Module):
    def forward(self, x):
        p, s, levels = self.pretrained, self.scratch, []
        for layer in (p.layer1, p.layer2, p.layer3, p.layer4):
            x = layer(x)
            levels.append(x)
        y = s.refinenet4(s.layer4_rn(levels[3]))
        y = s.refinenet3(y, s.layer3_rn(levels[2]))
        y = s.refinenet2(y, s.layer2_rn(levels[1]))
        return s.output_conv(s.refinenet1(y, s.layer1_rn(levels[0])))

    @staticmethod
    def decoder(levels, features, outs, rectified, head):
        parts = {}
        for i in range(4):
            parts[f'layer{i + 1}_rn'] = nn.Conv2d(levels[i], features[i], 3, 1, 1, bias=False)
            parts[f'refinenet{i + 1}'] = Fusion(features[i], rectified, i < 3, outs[i])
        return named(**parts, output_conv=depth_head(outs[0] or features[0], head))


class MidasV21(Midas):
    def __init__(self):
        super().__init__()
        stem = [nn.Conv2d(3, 64, 7, 2, 3, bias=False), nn.BatchNorm2d(64), nn.ReLU(), nn.MaxPool2d(3, 2, 1)]
        self.pretrained = named(layer1=nn.Sequential(*stem, grouped_stage(64, 64, 3, 1)), layer2=grouped_stage(256, 128, 4, 2),
                                layer3=grouped_stage(512, 256, 23, 2), layer4=grouped_stage(1024, 512, 3, 2))
        self.scratch = self.decoder((256, 512, 1024, 2048), (256,) * 4, (0,) * 4, True, 128)


class SameConv(nn.Conv2d):
    """TensorFlow's "same" padding: the odd zero at the bottom and right."""

    def forward(self, x):
        pads = []
        for size in (int(x.shape[3]), int(x.shape[2])):  # numbers, where tracing has tensors
            total = max((-(-size // self.stride[0]) - 1) * self.stride[0] + self.kernel_size[0] - size, 0)
            pads += [total // 2, total - total // 2]
        if pads[0] == pads[1] == pads[2] == pads[3]:
            return F.conv2d(x, self.weight, self.bias, self.stride, pads[0], 1, self.groups)
        return super().forward(F.pad(x, pads))


def tf_norm(channels):
    return nn.BatchNorm2d(channels, 1e-3)


class Separable(nn.Module):
    def __init__(self, ic, oc):
        super().__init__()
        self.conv_dw, self.bn1 = SameConv(ic, ic, 3, groups=ic, bias=False), tf_norm(ic)
        self.conv_pw, self.bn2 = nn.Conv2d(ic, oc, 1, bias=False), tf_norm(oc)

    def forward(self, x):
        return self.bn2(self.conv_pw(F.relu6(self.bn1(self.conv_dw(x)))))


class Inverted(nn.Module):
    def __init__(self, ic, oc, kernel, stride):
        super().__init__()
        hidden = 6 * ic
        self.conv_pw, self.bn1 = nn.Conv2d(ic, hidden, 1, bias=False), tf_norm(hidden)
        self.conv_dw, self.bn2 = SameConv(hidden, hidden, kernel, stride, groups=hidden, bias=False), tf_norm(hidden)
        self.conv_pwl, self.bn3 = nn.Conv2d(hidden, oc, 1, bias=False), tf_norm(oc)
        self.residual = stride == 1 and ic == oc

    def forward(self, x):
        y = F.relu6(self.bn1(self.conv_pw(x)))
        y = F.relu6(self.bn2(self.conv_dw(y)))
        y = self.bn3(self.conv_pwl(y))
        return x + y if self.residual else y


def inverted_stage(ic, oc, blocks, kernel, stride):
    return nn.Sequential(*[Inverted(oc if i else ic, oc, kernel, 1 if i else stride) for i in range(blocks)])


class MidasV21Small(Midas):
    def __init__(self):
        super().__init__()
        stem = [SameConv(3, 32, 3, 2, bias=False), tf_norm(32), nn.ReLU6()]
        self.pretrained = named(
            layer1=nn.Sequential(*stem, nn.Sequential(Separable(32, 24)), inverted_stage(24, 32, 3, 3, 2)),
            layer2=nn.Sequential(inverted_stage(32, 48, 3, 5, 2)),
            layer3=nn.Sequential(inverted_stage(48, 96, 5, 3, 2), inverted_stage(96, 136, 5, 5, 1)),
            layer4=nn.Sequential(inverted_stage(136, 232, 6, 5, 2), inverted_stage(232, 384, 1, 3, 1)))
        self.scratch = self.decoder((32, 48, 136, 384), (64, 128, 256, 512), (64, 64, 128, 256), False, 32)


# Depth Anything V2 Small (Yang et al., NeurIPS 2024): see graphs/depth_anything_v2.cpp.

class LayerScale(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.gamma = nn.Parameter(torch.ones(channels))

    def forward(self, x):
        return x * self.gamma


class Attention(nn.Module):
    def __init__(self, channels, heads):
        super().__init__()
        self.qkv, self.proj, self.heads = nn.Linear(channels, 3 * channels), nn.Linear(channels, channels), heads

    def forward(self, x):
        n, tokens, channels = x.shape
        q, k, v = self.qkv(x).reshape(n, tokens, 3, self.heads, channels // self.heads).permute(2, 0, 3, 1, 4)
        weights = torch.softmax(q * (channels // self.heads) ** -.5 @ k.transpose(-2, -1), -1)
        return self.proj((weights @ v).transpose(1, 2).reshape(n, tokens, channels))


class Block(nn.Module):
    def __init__(self, channels, heads):
        super().__init__()
        self.norm1, self.attn, self.ls1 = nn.LayerNorm(channels, 1e-6), Attention(channels, heads), LayerScale(channels)
        self.norm2, self.ls2 = nn.LayerNorm(channels, 1e-6), LayerScale(channels)
        self.mlp = named(fc1=nn.Linear(channels, 4 * channels), fc2=nn.Linear(4 * channels, channels))

    def forward(self, x):
        x = x + self.ls1(self.attn(self.norm1(x)))
        return x + self.ls2(self.mlp.fc2(F.gelu(self.mlp.fc1(self.norm2(x)))))


class VitFusion(Fusion):
    def __init__(self, channels, has_level):
        super().__init__(channels, False, has_level, channels)

    def forward(self, x, level=None, size=None):
        if level is not None:
            x = x + self.resConfUnit1(level)
        x = self.resConfUnit2(x)
        size = size or [2 * int(n) for n in x.shape[2:]]
        return self.out_conv(F.interpolate(x, size=size, mode='bilinear', align_corners=True))


class DepthAnythingV2(nn.Module):
    """For 518x518 pixels, at which its position embedding was trained."""

    def __init__(self, channels=384, depth=12, heads=6, features=64, levels=(48, 96, 192, 384)):
        super().__init__()
        self.pretrained = named(patch_embed=named(proj=nn.Conv2d(3, channels, 14, 14)), norm=nn.LayerNorm(channels, 1e-6),
                                blocks=nn.ModuleList(Block(channels, heads) for _ in range(depth)))
        self.pretrained.cls_token = nn.Parameter(torch.zeros(1, 1, channels))
        self.pretrained.pos_embed = nn.Parameter(torch.zeros(1, 1 + 37 * 37, channels))
        resized = [nn.ConvTranspose2d(levels[0], levels[0], 4, 4), nn.ConvTranspose2d(levels[1], levels[1], 2, 2), nn.Identity(),
                   nn.Conv2d(levels[3], levels[3], 3, 2, 1)]
        scratch = {f'layer{i + 1}_rn': nn.Conv2d(levels[i], features, 3, 1, 1, bias=False) for i in range(4)}
        scratch |= {f'refinenet{i + 1}': VitFusion(features, i < 3) for i in range(4)}
        output = nn.Sequential(nn.Conv2d(features // 2, 32, 3, 1, 1), nn.ReLU(), nn.Conv2d(32, 1, 1), nn.ReLU())
        self.depth_head = named(projects=nn.ModuleList(nn.Conv2d(channels, n, 1) for n in levels),
                                resize_layers=nn.ModuleList(resized),
                                scratch=named(**scratch, output_conv1=nn.Conv2d(features, features // 2, 3, 1, 1), output_conv2=output))

    def encode(self, x):
        p, (h, w) = self.pretrained, [int(n) // 14 for n in x.shape[2:]]
        x = torch.cat([p.cls_token, p.patch_embed.proj(x).flatten(2).transpose(1, 2)], 1) + p.pos_embed
        levels = []
        for i, block in enumerate(p.blocks):
            x = block(x)
            if i in (2, 5, 8, 11):
                levels.append(p.norm(x)[:, 1:].transpose(1, 2).reshape(1, -1, h, w))
        return levels

    def forward(self, x):
        head, levels = self.depth_head, self.encode(x)
        levels = [resize(project(y)) for y, project, resize in zip(levels, head.projects, head.resize_layers)]
        s = head.scratch
        levels = [getattr(s, f'layer{i + 1}_rn')(y) for i, y in enumerate(levels)]
        y = s.refinenet4(levels[3], size=[int(n) for n in levels[2].shape[2:]])
        y = s.refinenet3(y, levels[2], [int(n) for n in levels[1].shape[2:]])
        y = s.refinenet2(y, levels[1], [int(n) for n in levels[0].shape[2:]])
        y = s.output_conv1(s.refinenet1(y, levels[0]))
        return s.output_conv2(F.interpolate(y, size=[int(n) for n in x.shape[2:]], mode='bilinear', align_corners=True))


# Gated inpainting (Jampani et al., ICCV 2021; Yu et al., ICCV 2019): see graphs/inpaint_coarse.cpp, inpaint_deepfill.cpp.

class Gated(nn.Module):
    def __init__(self, ic, oc, kernel=3, stride=1, dilation=1, activation=F.elu):
        super().__init__()
        self.conv = nn.Conv2d(ic, 2 * oc, kernel, stride, dilation * (kernel // 2), dilation)
        self.activation = activation

    def forward(self, x):
        features, gate = self.conv(x).split(self.conv.out_channels // 2, 1)
        return self.activation(features) * torch.sigmoid(gate)


def plain(ic, oc):
    return named(conv=nn.Conv2d(ic, oc, 3, 1, 1))


def nearest(x):
    return F.interpolate(x, scale_factor=2, mode='nearest')


def with_mask(masked, mask):
    return torch.cat([masked, torch.ones_like(mask), mask], 1)


class InpaintCoarse(nn.Module):
    def __init__(self, c=24):
        super().__init__()
        layers = [(6, c, 5, 2), (c, c), (c, 2 * c, 3, 2), (2 * c, 2 * c), (2 * c, 4 * c)]
        layers += [(4 * c, 4 * c, 3, 1, d) for d in (2, 4, 8, 16, 1, 1)]
        layers += [(4 * c, 2 * c), (2 * c, 2 * c), (2 * c, c), (c, c // 2)]
        for i, layer in enumerate(layers):
            setattr(self, f'conv{i + 1}', Gated(*layer))
        self.conv16 = plain(c // 2, 4)

    def forward(self, rgbd, mask):
        x = with_mask(rgbd * (1 - mask), mask)
        for i in range(1, 16):
            x = getattr(self, f'conv{i}')(nearest(x) if i in (12, 14) else x)
        return torch.tanh(self.conv16.conv(x))


class Down(nn.Module):
    def __init__(self, ic, hidden, oc):
        super().__init__()
        self.conv1_downsample, self.conv2 = Gated(ic, hidden, stride=2), Gated(hidden, oc)

    def forward(self, x):
        return self.conv2(self.conv1_downsample(x))


class Up(nn.Module):
    def __init__(self, ic, hidden, oc):
        super().__init__()
        self.conv1_upsample, self.conv2 = named(conv=Gated(ic, hidden)), Gated(hidden, oc)

    def forward(self, x):
        return self.conv2(self.conv1_upsample.conv(nearest(x)))


class ContextualAttention(nn.Module):
    """Yu et al., CVPR 2018, section 4: 3x3 patches of features halved, softmax scale 10; see ops/attention.

    Scores are an n x n matrix S[background, foreground]; the fuse kernel slides along both, positions first in row-major
    and then in column-major order.
    """

    def __init__(self):
        super().__init__()
        self.register_buffer('fuse_weight', torch.eye(3).view(1, 1, 3, 3))

    def fuse(self, s):
        return F.conv2d(s[None, None], self.fuse_weight, padding=1)[0, 0]

    def forward(self, x, mask):
        h, w = x.shape[2] // 2, x.shape[3] // 2
        n = h * w
        small = x[:, :, ::2, ::2]
        patches = F.unfold(small, 3, padding=1)[0]
        norms = patches.square().sum(0).sqrt().clamp_min(1e-4)
        s = (patches / norms).t() @ patches
        s = self.fuse(s)
        s = s.view(h, w, h, w).permute(1, 0, 3, 2).reshape(n, n)
        s = self.fuse(s)
        s = s.view(w, h, w, h).permute(1, 0, 3, 2).reshape(n, n)
        reduced = mask[:, :, ::mask.shape[2] // h, ::mask.shape[3] // w]
        usable = (F.unfold(reduced, 3, padding=1)[0].sum(0) == 0).to(x.dtype)[:, None]
        s = torch.softmax(s * usable * 10, 0) * usable
        large = F.unfold(x, 4, stride=2, padding=1)[0]
        return F.fold((large @ s)[None], x.shape[2:], 4, stride=2, padding=1) / 4


class Stage1(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.conv1 = Gated(6, c // 2, 5)
        self.down_block1, self.down_block2 = Down(c // 2, c, c), Down(c, 2 * c, 2 * c)
        for i, dilation in enumerate((1, 2, 4, 8, 16, 1, 1)):
            setattr(self, f'conv_bn{i + 1}', Gated(2 * c, 2 * c, dilation=dilation))
        self.up_block1, self.up_block2 = Up(2 * c, c, c), Up(c, c // 2, c // 4)
        self.conv_to_rgb = plain(c // 4, 4)

    def forward(self, x):
        x = self.down_block2(self.down_block1(self.conv1(x)))
        for i in range(7):
            x = getattr(self, f'conv_bn{i + 1}')(x)
        return torch.tanh(self.conv_to_rgb.conv(self.up_block2(self.up_block1(x))))


class Stage2(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.conv_conv1, self.ca_conv1 = Gated(4, c // 2, 5), Gated(4, c // 2, 5)
        self.conv_down_block1, self.conv_down_block2 = Down(c // 2, c // 2, c), Down(c, c, 2 * c)
        for i, dilation in enumerate((1, 2, 4, 8, 16)):
            setattr(self, f'conv_conv_bn{i + 1}', Gated(2 * c, 2 * c, dilation=dilation))
        self.ca_down_block1, self.ca_down_block2 = Down(c // 2, c // 2, c), Down(c, 2 * c, 2 * c)
        self.ca_conv_bn1 = Gated(2 * c, 2 * c, activation=F.relu)
        self.contextual_attention = ContextualAttention()
        self.ca_conv_bn4, self.ca_conv_bn5 = Gated(2 * c, 2 * c), Gated(2 * c, 2 * c)
        self.conv_bn6, self.conv_bn7 = Gated(4 * c, 2 * c), Gated(2 * c, 2 * c)
        self.up_block1, self.up_block2 = Up(2 * c, c, c), Up(c, c // 2, c // 4)
        self.conv_to_rgb = plain(c // 4, 4)

    def forward(self, x, mask):
        y = self.conv_down_block2(self.conv_down_block1(self.conv_conv1(x)))
        for i in range(5):
            y = getattr(self, f'conv_conv_bn{i + 1}')(y)
        z = self.ca_conv_bn1(self.ca_down_block2(self.ca_down_block1(self.ca_conv1(x))))
        z = self.ca_conv_bn5(self.ca_conv_bn4(self.contextual_attention(z, mask)))
        x = self.conv_bn7(self.conv_bn6(torch.cat([y, z], 1)))
        return torch.tanh(self.conv_to_rgb.conv(self.up_block2(self.up_block1(x))))


class InpaintDeepfill(nn.Module):
    def __init__(self, c=48):
        super().__init__()
        self.stage1, self.stage2 = Stage1(c), Stage2(c)

    def forward(self, rgbd, mask):
        masked = rgbd * (1 - mask)
        coarse = self.stage1(with_mask(masked, mask))
        return coarse, self.stage2(coarse * mask + masked * (1 - mask), mask)


# U2-Net (Qin et al., 2020): see graphs/u2net.cpp.

class ConvNorm(nn.Module):
    def __init__(self, ic, oc, dilation=1):
        super().__init__()
        self.conv_s1, self.bn_s1 = nn.Conv2d(ic, oc, 3, 1, dilation, dilation), nn.BatchNorm2d(oc)

    def forward(self, x):
        return F.relu(self.bn_s1(self.conv_s1(x)))


def halve(x):
    return F.max_pool2d(x, 2, 2, ceil_mode=True)


class NestedBlock(nn.Module):
    """RSU of a height, or with height 0 RSU-4F, which dilates in place of pooling."""

    def __init__(self, height, ic, middle, oc):
        super().__init__()
        self.pooled, self.height = height > 0, height or 4
        dilations = [1] * self.height if self.pooled else [1, 2, 4, 8]
        dilations[-1] = 2 if self.pooled else 8
        self.rebnconvin = ConvNorm(ic, oc)
        for i, dilation in enumerate(dilations, 1):
            setattr(self, f'rebnconv{i}', ConvNorm(oc if i == 1 else middle, middle, dilation))
        for i in range(self.height - 1, 0, -1):
            setattr(self, f'rebnconv{i}d', ConvNorm(2 * middle, oc if i == 1 else middle, dilations[i - 1]))

    def forward(self, x):
        x = start = self.rebnconvin(x)
        levels = []
        for i in range(1, self.height):
            x = getattr(self, f'rebnconv{i}')(halve(x) if self.pooled and i > 1 else x)
            levels.append(x)
        x = getattr(self, f'rebnconv{self.height}')(x)
        for i in range(self.height - 1, 0, -1):
            if self.pooled and i < self.height - 1:
                x = enlarge_like(x, levels[i - 1])
            x = getattr(self, f'rebnconv{i}d')(torch.cat([x, levels[i - 1]], 1))
        return x + start


class U2Net(nn.Module):
    MIDDLE = {'1': 32, '2': 32, '3': 64, '4': 128, '5': 256, '6': 256, '5d': 256, '4d': 128, '3d': 64, '2d': 32, '1d': 16}
    OUT = {'1': 64, '2': 128, '3': 256, '4': 512, '5': 512, '6': 512, '5d': 512, '4d': 256, '3d': 128, '2d': 64, '1d': 64}

    def __init__(self):
        super().__init__()
        heights = {1: 7, 2: 6, 3: 5, 4: 4, 5: 0, 6: 0}
        out = self.OUT
        for i, height in heights.items():
            ic = 3 if i == 1 else out[str(i - 1)]
            setattr(self, f'stage{i}', NestedBlock(height, ic, self.MIDDLE[str(i)], out[str(i)]))
            if i < 6:
                ic = out[str(i)] + out['6' if i == 5 else f'{i + 1}d']
                setattr(self, f'stage{i}d', NestedBlock(height, ic, self.MIDDLE[f'{i}d'], out[f'{i}d']))
            setattr(self, f'side{i}', nn.Conv2d(out['6' if i == 6 else f'{i}d'], 1, 3, 1, 1))
        self.outconv = nn.Conv2d(6, 1, 1)

    def forward(self, x):
        levels = []
        for i in range(1, 7):
            x = getattr(self, f'stage{i}')(halve(x) if i > 1 else x)
            levels.append(x)
        sides = [self.side6(x)]
        for i in range(5, 0, -1):
            skip = levels[i - 1]
            x = getattr(self, f'stage{i}d')(torch.cat([enlarge_like(x, skip), skip], 1))
            sides.insert(0, getattr(self, f'side{i}')(x))
        sides = sides[:1] + [enlarge_like(side, sides[0]) for side in sides[1:]]
        return tuple(torch.sigmoid(side) for side in [self.outconv(torch.cat(sides, 1)), *sides])


class U2NetP(U2Net):
    MIDDLE = dict.fromkeys(U2Net.MIDDLE, 16)
    OUT = dict.fromkeys(U2Net.OUT, 64)


# FBA matting (Forte and Pitie, 2020): see graphs/fba.cpp. Its weights are standardised before they come here.

def group_norm(channels):
    return nn.GroupNorm(32, channels)


class AdaptivePool(nn.Module):
    """nn.AdaptiveAvgPool2d as means of slices, since ONNX has no such operator for sizes that do not divide."""

    def __init__(self, size):
        super().__init__()
        self.size = size

    def forward(self, x):
        spans = [[(i * n // self.size, -(-(i + 1) * n // self.size)) for i in range(self.size)] for n in map(int, x.shape[2:])]
        rows = [[x[:, :, a:b, c:d].mean((2, 3), True) for c, d in spans[1]] for a, b in spans[0]]
        return torch.cat([torch.cat(row, 3) for row in rows], 2)


class NormedBottleneck(nn.Module):
    def __init__(self, ic, planes, stride, dilation, first):
        super().__init__()
        c = 4 * planes
        self.conv1, self.bn1 = nn.Conv2d(ic, planes, 1, bias=False), group_norm(planes)
        self.conv2, self.bn2 = nn.Conv2d(planes, planes, 3, stride, dilation, dilation, bias=False), group_norm(planes)
        self.conv3, self.bn3 = nn.Conv2d(planes, c, 1, bias=False), group_norm(c)
        self.downsample = nn.Sequential(nn.Conv2d(ic, c, 1, stride, bias=False), group_norm(c)) if first else None

    def forward(self, x):
        y = F.relu(self.bn1(self.conv1(x)))
        y = F.relu(self.bn2(self.conv2(y)))
        return F.relu(self.bn3(self.conv3(y)) + (x if self.downsample is None else self.downsample(x)))


def normed_stage(ic, planes, blocks, stride=1, first_dilation=1, dilation=1):
    parts = [NormedBottleneck(ic, planes, stride, first_dilation, True)]
    parts += [NormedBottleneck(4 * planes, planes, 1, dilation, False) for _ in range(blocks - 1)]
    return nn.Sequential(*parts)


def conv_norm(ic, oc, kernel=3):
    return [nn.Conv2d(ic, oc, kernel, 1, kernel // 2), group_norm(oc), nn.LeakyReLU(.01)]


class Fba(nn.Module):
    def __init__(self):
        super().__init__()
        self.encoder = named(conv1=nn.Conv2d(11, 64, 7, 2, 3, bias=False), bn1=group_norm(64), layer1=normed_stage(64, 64, 3),
                             layer2=normed_stage(256, 128, 4, 2), layer3=normed_stage(512, 256, 6, 1, 1, 2),
                             layer4=normed_stage(1024, 512, 3, 1, 2, 4))
        pools = [nn.Sequential(AdaptivePool(size), *conv_norm(2048, 256, 1)) for size in (1, 2, 3, 6)]
        last = [nn.Conv2d(72, 32, 3, 1, 1), nn.LeakyReLU(.01), nn.Conv2d(32, 16, 3, 1, 1), nn.LeakyReLU(.01), nn.Conv2d(16, 7, 1)]
        self.decoder = named(ppm=nn.ModuleList(pools), conv_up1=nn.Sequential(*conv_norm(3072, 256), *conv_norm(256, 256)),
                             conv_up2=nn.Sequential(*conv_norm(512, 256)), conv_up3=nn.Sequential(*conv_norm(320, 64)),
                             conv_up4=nn.Sequential(*last))

    def forward(self, image, two_chan_trimap, image_n, trimap_transformed):
        e, d = self.encoder, self.decoder
        conv1 = F.relu(e.bn1(e.conv1(torch.cat([image_n, trimap_transformed, two_chan_trimap], 1))))
        layer1 = e.layer1(F.max_pool2d(conv1, 3, 2, 1))
        x = e.layer4(e.layer3(e.layer2(layer1)))
        x = d.conv_up1(torch.cat([x, *[enlarge_like(pool(x), x) for pool in d.ppm]], 1))
        x = d.conv_up2(torch.cat([enlarge(x), layer1], 1))
        x = d.conv_up3(torch.cat([enlarge(x), conv1], 1))
        x = d.conv_up4(torch.cat([enlarge(x), image_n, image, two_chan_trimap], 1))
        return self.fuse(x[:, :1].clamp(0, 1), image, torch.sigmoid(x[:, 1:4]), torch.sigmoid(x[:, 4:]))

    @staticmethod
    def fuse(alpha, image, f, b):
        f = alpha * image + (1 - alpha * alpha) * f - alpha * (1 - alpha) * b
        b = (1 - alpha) * image + (2 * alpha - alpha * alpha) * b - alpha * (1 - alpha) * f
        f, b = f.clamp(0, 1), b.clamp(0, 1)
        along = ((image - b) * (f - b)).sum(1, keepdim=True)
        length = ((f - b) * (f - b)).sum(1, keepdim=True)
        alpha = ((alpha * .1 + along) / (length + .1)).clamp(0, 1)
        return torch.cat([alpha, f, b], 1)

    @staticmethod
    def standardised(name):
        """Whether the authors' network standardises this filter bank."""
        return not name.startswith('decoder.conv_up4.')


# The project's own networks, whose modules are in weights_tools/train.

def without_products(module):
    """1x1 convolutions written as matrix products, which are faster in training, become convolutions again."""
    for name, child in module.named_children():
        if isinstance(child, Pointwise):
            conv = nn.Conv2d(child.in_channels, child.out_channels, 1)
            setattr(module, name, conv)
        else:
            without_products(child)
    return module


class SlideDepth(DepthNet):
    def __init__(self):
        super().__init__()
        without_products(self)

    def forward(self, x):
        return super().forward(x)[:, None]
