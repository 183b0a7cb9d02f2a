"""slide_inpaint: the depth-aware fill, and a network that tells which of the pixels around the hole are background.

Disparity tells it only roughly: it is grown and soft. The network sees the picture, a first fill, the disparity, that of the
background and the hole, and moves the weight that the colours have in the fill. Its last layer starts at zero: training starts
from the weights by disparity.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F

from fill import REST, background_fill

LOW, HIGH = .35, .85  # the probabilities of background that weights of 0 and 1 stand for: what is doubtful gives no colour
WIDTH = 16  # features at half the size

# name -> channels in (10 at full size), out, kernel, stride, dilation
LAYERS = {'conv1': (10, WIDTH, 5, 2, 1), 'conv2': (WIDTH, WIDTH, 3, 1, 1),
          'conv3': (WIDTH, 2 * WIDTH, 3, 2, 1), 'conv4': (2 * WIDTH, 2 * WIDTH, 3, 1, 1),
          'conv5': (2 * WIDTH, 3 * WIDTH, 3, 2, 1), 'conv6': (3 * WIDTH, 3 * WIDTH, 3, 1, 1),
          'conv7': (3 * WIDTH, 3 * WIDTH, 3, 1, 2), 'conv8': (3 * WIDTH, 3 * WIDTH, 3, 1, 4),
          'conv9': (3 * WIDTH, 3 * WIDTH, 3, 1, 8), 'conv10': (5 * WIDTH, 2 * WIDTH, 3, 1, 1),
          'conv11': (3 * WIDTH, WIDTH // 2, 3, 1, 1), 'conv12': (WIDTH // 2 + 10, WIDTH // 2, 3, 1, 1),
          'conv13': (WIDTH // 2, 1, 3, 1, 1)}


class InpaintNet(nn.Module):
    def __init__(self):
        super().__init__()
        for name, (ic, oc, kernel, stride, dilation) in LAYERS.items():
            layer = nn.Conv2d(ic, oc, kernel, stride, dilation * (kernel // 2), dilation)
            nn.init.kaiming_normal_(layer.weight, nonlinearity='relu')
            nn.init.zeros_(layer.bias)
            setattr(self, name, layer)
        nn.init.zeros_(self.conv13.weight)

    def layer(self, name, x, *skip):
        """With `skip`, x is enlarged by two and joined."""
        if skip:
            x = torch.cat([F.interpolate(x, scale_factor=2, mode='bilinear', align_corners=False), *skip], 1)
        return F.relu(getattr(self, name)(x))

    def logit(self, rgb, filled, d, behind, weight, hole):
        """filled: the smooth fill by `weight`, colour_weight(); sides multiples of 8 -> N x 1 x H x W, of the weight"""
        x = torch.cat([rgb, filled, d, behind, weight, hole], 1)
        half = self.layer('conv2', self.layer('conv1', x))
        quarter = self.layer('conv4', self.layer('conv3', half))
        y = self.layer('conv5', quarter)
        for name in ('conv6', 'conv7', 'conv8', 'conv9'):
            y = self.layer(name, y)
        y = self.layer('conv12', self.layer('conv11', self.layer('conv10', y, quarter), half), x)
        return torch.logit(LOW + (HIGH - LOW) * weight) + self.conv13(y)

    @staticmethod
    def weight_of(logit):
        return ((torch.sigmoid(logit) - LOW) / (HIGH - LOW)).clamp(REST, 1)

    def weigh(self, *x):
        return self.weight_of(self.logit(*x))

    def forward(self, rgbd, d, hole, matte=None):
        """rgbd: N x 4 x H x W in [-1, 1], d: D1 in [0, 1], hole: zeros and ones; sides multiples of 8 -> RGBD of the background"""
        return background_fill(rgbd, d, hole, matte, self)[1]
