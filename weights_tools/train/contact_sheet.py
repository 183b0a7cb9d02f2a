#!/usr/bin/python3
"""A contact sheet of what slide_run makes of photos: photo, disparity, matte where one is used, a view from the side.

  contact_sheet.py --run build/bin/slide_run --out SHEET.jpg [--columns 2] [--height 150] [--depth-weights F] [--saliency-weights F] PHOTO...

A photo @LIST stands for the files named in LIST, one a line. Tiles are numbered in the order given. The view is where the swing
turns, at the default parallax.
"""
import argparse
import os
import subprocess
import tempfile

import cv2
import numpy as np


def listed(names):
    for name in names:
        if name.startswith('@'):
            with open(name[1:]) as f:
                yield from f.read().split()
        else:
            yield name


def maps(run, photo, options):
    """-> photo, disparity, matte (grey where none is used) and view, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([run, photo, '--max-side', '512', '--matte', 'auto', '--path', 'swing', '--frames', '4', '--quiet',
                        '--layers', folder + '/layers', '-o', folder + '/frames/', *options], check=True)
        image, view = cv2.imread(folder + '/layers/image.png'), cv2.imread(folder + '/frames/frame_0001.png')
        read = lambda f: cv2.imread(f'{folder}/layers/{f}', cv2.IMREAD_UNCHANGED)
        matte = read('matte.pfm') if os.path.exists(folder + '/layers/matte.pfm') else np.full(image.shape[:2], .25)
        grey = [cv2.cvtColor((v.clip(0, 1) * 255).astype(np.uint8), cv2.COLOR_GRAY2BGR) for v in (read('D.pfm'), matte)]
        return [image, *grey, view]


def main():
    p = argparse.ArgumentParser()
    p.add_argument('--run', required=True)
    p.add_argument('--out', required=True)
    p.add_argument('--columns', type=int, default=2)
    p.add_argument('--height', type=int, default=150)
    p.add_argument('--quality', type=int, default=80)
    p.add_argument('--depth-weights')
    p.add_argument('--saliency-weights')
    p.add_argument('photos', nargs='+')
    a = p.parse_args()
    options = [v for name in ('depth_weights', 'saliency_weights') if getattr(a, name) for v in ('--' + name.replace('_', '-'), getattr(a, name))]
    size = (a.height * 4 // 3, a.height)
    tiles = []
    for number, photo in enumerate(listed(a.photos), 1):
        tile = np.hstack([fitted(v, size) for v in maps(a.run, photo, options)])
        cv2.putText(tile, str(number), (4, 20), cv2.FONT_HERSHEY_SIMPLEX, .6, (0, 0, 0), 3)
        cv2.putText(tile, str(number), (4, 20), cv2.FONT_HERSHEY_SIMPLEX, .6, (255, 255, 255), 1)
        tiles.append(tile)
    tiles += [tiles[0] * 0] * (-len(tiles) % a.columns)
    sheet = np.vstack([np.hstack(tiles[k:k + a.columns]) for k in range(0, len(tiles), a.columns)])
    cv2.imwrite(a.out, sheet, [cv2.IMWRITE_JPEG_QUALITY, a.quality])


def fitted(image, size):
    """Scaled to fit, the rest black."""
    scale = min(size[0] / image.shape[1], size[1] / image.shape[0])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)[:size[1], :size[0]]
    out = np.zeros((size[1], size[0], 3), np.uint8)
    out[:small.shape[0], :small.shape[1]] = small
    return out


if __name__ == '__main__':
    main()
