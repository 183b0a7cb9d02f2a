#!/usr/bin/python3
"""Decodes the training data once, into arrays of bytes that the training loops map.

  prepare.py --data DATA --cache CACHE

Every 40th photo with a matte is held out of all three trainings (held.npy); the rooms and the photos in the wild follow the data's
own lists.
"""
import argparse
import os

import numpy as np
from PIL import Image

from common import Ragged
from pseudo_depth import SCALE, pseudo_disparity

p = argparse.ArgumentParser()
p.add_argument('--data', required=True)
p.add_argument('--cache', required=True)
a = p.parse_args()
os.makedirs(a.cache, exist_ok=True)


def numbers(name):
    with open(f'{a.data}/{name}') as f:
        return [int(v) for v in f.read().split()]


def rooms(name, ids):
    np.save(f'{a.cache}/{name}_rgb.npy', np.stack([np.asarray(Image.open(f'{a.data}/nyu/{i:04d}.jpg').convert('RGB')) for i in ids]))
    np.save(f'{a.cache}/{name}_depth.npy', np.stack([np.asarray(Image.open(f'{a.data}/nyu/{i:04d}_depth.png')) for i in ids]))


held = numbers('nyu_holdout.txt')
unused = set(held) | set(numbers('nyu_unused.txt'))
every = [int(f[:4]) for f in sorted(os.listdir(a.data + '/nyu')) if f.endswith('.jpg')]
rooms('rooms', [i for i in every if i not in unused])
rooms('holdout', held)

names = sorted(f[:-4] for f in os.listdir(a.data + '/photos') if f.endswith('.jpg'))
images, mattes, disparities, subject = [], [], [], []
for name in names:
    image = np.asarray(Image.open(f'{a.data}/photos/{name}.jpg').convert('RGB'))
    path = f'{a.data}/mattes/{name}.png'
    known = os.path.exists(path)
    matte = np.asarray(Image.open(path).convert('L')) if known else np.zeros(image.shape[:2], np.uint8)
    disparity, stands_out = pseudo_disparity(matte)
    images.append(image)
    mattes.append(matte)
    disparities.append(np.round(disparity * SCALE).astype(np.uint8))
    subject.append(2 if stands_out else int(known))
Ragged.write(f'{a.cache}/photos', images)
Ragged.write(f'{a.cache}/mattes', mattes)
Ragged.write(f'{a.cache}/disparities', disparities)
subject = np.array(subject, np.uint8)
np.save(f'{a.cache}/subject.npy', subject)  # 0: no matte, 1: an empty matte, 2: a subject
np.save(f'{a.cache}/held.npy', np.nonzero(subject > 0)[0][::40])

with open(f'{a.data}/wild.tsv') as f:
    wild = [line.rstrip('\n').split('\t') for line in f][1:]  # name, source, clip or '-', set
for part in ('train', 'holdout'):
    rows = [row for row in wild if row[3] == part]
    Ragged.write(f'{a.cache}/wild_{part}', [np.asarray(Image.open(f'{a.data}/wild/{r[0]}.jpg').convert('RGB')) for r in rows])
    Ragged.write(f'{a.cache}/wild_{part}_disparity', [np.asarray(Image.open(f'{a.data}/wild/{r[0]}_disparity.png').convert('L')) for r in rows])
    frames = [sum(other[2] == r[2] for other in rows) if r[2] != '-' else 1 for r in rows]
    np.save(f'{a.cache}/wild_{part}_share.npy', 1 / np.array(frames, np.float64))  # frames of one clip count as one photo

cuts = sorted(f[:-len('_alpha.png')] for f in os.listdir(a.data + '/mattes_true') if f.endswith('_alpha.png'))


def cut(name, mode):
    image = Image.open(f'{a.data}/mattes_true/{name}').convert(mode)
    return np.asarray(image.resize([max(2, round(v * 640 / max(image.size))) for v in image.size], Image.BOX))


Ragged.write(f'{a.cache}/cuts', [cut(c + '_image.jpg', 'RGB') for c in cuts])
Ragged.write(f'{a.cache}/cuts_alpha', [cut(c + '_alpha.png', 'L') for c in cuts])
print(len(every) - len(unused), 'rooms,', len(held), 'held out;', len(names), 'photos,', (subject == 2).sum(), 'with a subject;',
      sum(row[3] == 'train' for row in wild), 'photos in the wild;', len(cuts), 'cut-outs with true alpha')
