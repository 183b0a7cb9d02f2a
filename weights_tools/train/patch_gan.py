"""SN-PatchGAN with the hinge loss (Yu et al., "Free-form image inpainting with gated convolution", ICCV 2019), for slide_inpaint."""
import torch
import torch.nn as nn
import torch.nn.functional as F
from torch.nn.utils import spectral_norm

WIDTH = 16


class PatchCritic(nn.Sequential):
    """RGBD and the hole -> a map of scores, high where a patch looks like a photo's."""

    def __init__(self, c=WIDTH):
        layers, ic = [], 5
        for oc in (c, 2 * c, 4 * c, 4 * c):
            layers += [spectral_norm(nn.Conv2d(ic, oc, 5, 2, 2)), nn.LeakyReLU(.2)]
            ic = oc
        super().__init__(*layers[:-1])


class Adversary:
    """The critic with its optimiser. What neither picture shows truly, the covered part outside the hole, both leave out."""

    def __init__(self, device, rate, saved=None):
        self.critic = PatchCritic().to(device)
        self.optimiser = torch.optim.Adam(self.critic.parameters(), lr=rate, betas=(.5, .99))
        if saved:
            self.critic.load_state_dict(saved['critic'])
            self.optimiser.load_state_dict(saved['optimiser'])

    def state(self):
        return {'critic': self.critic.state_dict(), 'optimiser': self.optimiser.state_dict()}

    def loss(self, y, truth, mask, cover):
        """One step of the critic, then the generator's loss. y, truth: N x 4 x H x W; only the mask of y is judged."""
        seen = 1 - cover * (1 - mask)
        real, fake = (torch.cat([v * seen, mask], 1) for v in (truth, mask * y + (1 - mask) * truth))
        self.optimiser.zero_grad()
        (F.relu(1 - self.critic(real)).mean() + F.relu(1 + self.critic(fake.detach())).mean()).backward()
        self.optimiser.step()
        self.critic.requires_grad_(False)
        loss = -self.critic(fake).mean()
        self.critic.requires_grad_(True)
        return loss
