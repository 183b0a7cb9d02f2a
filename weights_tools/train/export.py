#!/usr/bin/python3
"""Writes averaged weights of checkpoints as the safetensors file that the runtime reads (float16), with its metadata.

  export.py --model depth|inpaint|matte|rim [--logits FACTOR] [--shift S] [--between WEIGHTS --share A] CHECKPOINT... OUT.safetensors

--logits multiplies the last layer: slide_matte was trained to doubt, and its mattes are nearer to the truth with 2. --shift is then
added to its bias: slide_inpaint believes too readily that a pixel is background; with -0.4 no more of the foreground gets into the fill
of photos than without it. Several checkpoints are runs that went on from the same weights with other samples: their mean is written. With --between, the
weights that the run started from, what is written lies between the two, A of the way to the checkpoint's: a run on other data learns
what is new in it and forgets some of the old, and part of the way keeps most of both (Wortsman et al. 2022, "Robust fine-tuning of
zero-shot models").
"""
import argparse

import torch

from common import load_safetensors, save_safetensors
from rim_net import folded

WILD = 'photos with disparity by Depth Anything V1, V2 Large (CC BY-NC 4.0) and 3, '  # what slide_depth alone learnt from
NOTE = ('Apache-2.0 for the code; weights trained on NYU Depth v2 (labelled set), {}and photos from OpenImages (CC BY 2.0), ImageNet, BSDS500 '
        'and Oxford pets with IS-Net mattes; the encoder starts from ImageNet weights: for research, see the model card')
MODELS = {  # name, last layer, recipe
    'depth': ('slide_depth', 'out3', 'weights_tools/train/train_depth.py: MobileNetV2 encoder, fusion decoder of 48 features; RGB/127.5 - 1, '
                             'relative inverse depth'),
    'inpaint': ('slide_inpaint', 'conv13', 'weights_tools/train/train_inpaint.py: which pixels are background, for the depth-aware fill'),
    'matte': ('slide_matte', 'out3', 'weights_tools/train/train_matte.py: as slide_depth, with a sigmoid: soft matte of the salient subject'),
    'rim': ('slide_rim', 'conv13', "weights_tools/train/train_rim.py: edges and hair of slide_matte's mattes at the photo's size"),
}
TRUE = 'mattes of alphamatting.com and AM-2k, '  # what slide_rim alone learnt from

p = argparse.ArgumentParser()
p.add_argument('--model', choices=MODELS, required=True)
p.add_argument('--logits', type=float, default=1.)
p.add_argument('--shift', type=float, default=0.)
p.add_argument('--between', metavar='WEIGHTS')
p.add_argument('--share', type=float, default=1.)
p.add_argument('checkpoints', nargs='+')
p.add_argument('out')
a = p.parse_args()
runs = [torch.load(path, map_location='cpu') for path in a.checkpoints]
weights = {key: sum(run['average'][key] for run in runs) / len(runs) for key in runs[0]['average']}
if a.between:
    start = load_safetensors(a.between)
    weights = {key: (1 - a.share) * start[key] + a.share * v for key, v in weights.items()}
if a.model == 'rim':
    weights = folded(weights)
name, last, recipe = MODELS[a.model]
for part in ('.weight', '.bias'):
    weights[last + part] *= a.logits
weights[last + '.bias'] += a.shift
training = ' and '.join(f'{run["step"]} steps, {run["elapsed"] / 60:.0f} minutes' for run in runs)
if a.between:
    training += f' from earlier weights on, {a.share:g} of the way taken'
metadata = {'model': name, 'recipe': recipe, 'training': training,
            'licence': NOTE.format({'depth': WILD, 'rim': TRUE}.get(a.model, ''))}
save_safetensors(a.out, weights, metadata)
print(a.out, metadata['training'])
