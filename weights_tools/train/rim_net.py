"""slide_rim: corrects an enlarged matte at the photo's resolution, where it cannot be right: edges, hair, gaps.

The network sees the photo, the matte and how near each pixel's colour is to those of subject and background nearby,
and moves the log odds of being the subject. Its last layer starts at zero: training starts from the matte as it is.
"""
import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

DOUBT = .02  # the probability of subject that a matte of 0 stands for, and of background that 1 does
CERTAIN = .08  # less than this probability of subject is a matte of 0, more than one minus it is 1: no haze
WIDTH = 16  # features at half the size
MULTIPLE = 8  # of both sides
SURE = 5.  # where a matte is above 1 - 1/SURE, or below 1/SURE, colours are the subject's, or the background's
CELL, CELLS = 8, 7  # pixels; how many of such cells each way are nearby
NONE = .01  # so much of nearby has no colour
INPUTS = 8

# name -> channels in, out, kernel, stride, dilation
LAYERS = {'conv1': (INPUTS, WIDTH, 5, 2, 1), 'conv2': (WIDTH, WIDTH, 3, 1, 1),
          'conv3': (WIDTH, 2 * WIDTH, 3, 2, 1), 'conv4': (2 * WIDTH, 2 * WIDTH, 3, 1, 1),
          'conv5': (2 * WIDTH, 4 * WIDTH, 3, 2, 1), 'conv6': (4 * WIDTH, 4 * WIDTH, 3, 1, 1),
          'conv7': (4 * WIDTH, 4 * WIDTH, 3, 1, 2), 'conv8': (4 * WIDTH, 4 * WIDTH, 3, 1, 4),
          'conv9': (4 * WIDTH, 4 * WIDTH, 3, 1, 8), 'conv10': (6 * WIDTH, 2 * WIDTH, 3, 1, 1),
          'conv11': (3 * WIDTH, WIDTH, 3, 1, 1), 'conv12': (WIDTH + INPUTS, WIDTH, 3, 1, 1),
          'conv13': (WIDTH, 1, 3, 1, 1)}


def nearby(rgb, weight):
    """The mean colour of what `weight` picks within some cells, at the size of rgb, and how much of it there is."""
    spread = lambda v: F.avg_pool2d(F.avg_pool2d(v, CELL), CELLS, 1, CELLS // 2)
    there = spread(weight)
    mean = torch.cat([spread(rgb * weight), there], 1) / (there + NONE)
    mean = F.interpolate(mean, scale_factor=CELL, mode='bilinear', align_corners=False)
    return mean[:, :3], mean[:, 3:]


def inputs(rgb, coarse):
    """What the network sees: N x 8 x H x W."""
    front, some_front = nearby(rgb, (SURE * coarse + 1 - SURE).clamp(0, 1))
    back, some_back = nearby(rgb, (1 - SURE * coarse).clamp(0, 1))
    both = some_front * some_back
    mean = lambda v: v.mean(1, keepdim=True)
    step = front - back
    apart = mean(step * step)
    way = (mean((rgb - back) * step) / (apart + NONE)).clamp(-.5, 1.5)
    near = [4 * both * mean((rgb - side) * (rgb - side)) for side in (front, back)]
    return torch.cat([2 * rgb - 1, 2 * coarse - 1, both * (way - .5), *near, 4 * both * apart], 1)


class RimNet(nn.Module):
    """While it learns (`normed`), every layer but the last has a batch norm; folded() makes weights without."""

    def __init__(self, normed=False):
        super().__init__()
        self.normed = normed
        for name, (ic, oc, kernel, stride, dilation) in LAYERS.items():
            last = name == 'conv13'
            layer = nn.Conv2d(ic, oc, kernel, stride, dilation * (kernel // 2), dilation, bias=last or not normed)
            nn.init.kaiming_normal_(layer.weight, nonlinearity='relu')
            setattr(self, name, layer)
            if normed and not last:
                setattr(self, 'norm' + name[4:], nn.BatchNorm2d(oc))
        nn.init.zeros_(self.conv13.weight)
        nn.init.zeros_(self.conv13.bias)

    def layer(self, name, x, *skip):
        """With `skip`, x is enlarged by two and joined."""
        if skip:
            x = torch.cat([F.interpolate(x, scale_factor=2, mode='bilinear', align_corners=False), *skip], 1)
        y = getattr(self, name)(x)
        return F.relu(getattr(self, 'norm' + name[4:])(y) if self.normed else y)

    def change(self, x):
        """Of the log odds, N x 1 x H x W; x: inputs()"""
        half = self.layer('conv2', self.layer('conv1', x))
        quarter = self.layer('conv4', self.layer('conv3', half))
        y = self.layer('conv5', quarter)
        for name in ('conv6', 'conv7', 'conv8', 'conv9'):
            y = self.layer(name, y)
        return self.conv13(self.layer('conv12', self.layer('conv11', self.layer('conv10', y, quarter), half), x))

    def odds(self, rgb, coarse):
        """The logarithm of the odds; rgb: N x 3 x H x W, coarse: N x 1 x H x W, both in [0, 1], sides multiples of 8"""
        x = inputs(rgb, coarse).contiguous(memory_format=torch.channels_last)
        return torch.logit(DOUBT + (1 - 2 * DOUBT) * coarse) + self.change(x)

    @staticmethod
    def matte_of(odds):
        return ((torch.sigmoid(odds) - CERTAIN) / (1 - 2 * CERTAIN)).clamp(0, 1)

    def forward(self, rgb, coarse):
        return self.matte_of(self.odds(rgb, coarse))


def folded(weights, eps=1e-5):
    """A state with batch norms -> one without that computes the same."""
    out = {}
    for name in LAYERS:
        w, norm = weights[name + '.weight'], 'norm' + name[4:]
        if norm + '.weight' in weights:
            factor = weights[norm + '.weight'] / (weights[norm + '.running_var'] + eps).sqrt()
            out[name + '.weight'] = w * factor[:, None, None, None]
            out[name + '.bias'] = weights[norm + '.bias'] - factor * weights[norm + '.running_mean']
        else:
            out[name + '.weight'], out[name + '.bias'] = w, weights[name + '.bias']
    return out


def padded(x):
    """N x C x H x W: the border repeated at the bottom and right up to multiples of 8."""
    h, w = x.shape[2:]
    return F.pad(x, (0, -w % MULTIPLE, 0, -h % MULTIPLE), mode='replicate')


@torch.no_grad()
def refined(net, image, coarse, bf16=False):
    """image: bytes, coarse: H x W in [0, 1] -> H x W"""
    h, w = coarse.shape
    rgb = torch.from_numpy(image.transpose(2, 0, 1)[None].astype(np.float32) / 255)
    x, c = (padded(v) for v in (rgb, torch.from_numpy(coarse[None, None].astype(np.float32))))
    with torch.autocast('cpu', torch.bfloat16, enabled=bf16):
        y = net(x, c)
    return y[0, 0, :h, :w].numpy()
