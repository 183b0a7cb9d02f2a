#!/usr/bin/python3
"""The figures of the model cards, and contact sheets to look at.

  evaluate.py depth   --cache CACHE --weights slide_depth.safetensors   [--views VIEWS] [--alphamatting FOLDER] [--sheet OUT.png]
  evaluate.py inpaint --cache CACHE --weights slide_inpaint.safetensors [--views VIEWS] [--sheet OUT.png]
                      [--matte-weights slide_matte.safetensors] [--depth-weights slide_depth.safetensors]
  evaluate.py matte   --cache CACHE --weights slide_matte.safetensors   [--alphamatting FOLDER] [--u2netp FOLDER] [--sheet OUT.png]
                      [--rim-weights slide_rim.safetensors]

VIEWS holds rectified stereo scenes (left.png, right.png, disparity.png, scene.json), FOLDER alphamatting.com's GTnn_image.jpg and
GTnn_alpha.png, and other photos with alpha
under other names. With --rim-weights the mattes are refined by slide_rim. With --matte-weights the fill gets slide_matte's matte, too, and with --depth-weights a second round of composites has slide_depth's
disparity. --u2netp photos beside the maps that U2-NetP's authors published of them. Networks see pictures as the runtime gives them: the longer side 384 pixels, both multiples of 32.
"""
import argparse
import glob
import itertools
import json
import os

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage

from common import Ragged, load_safetensors
from depth_net import DepthNet
from fill import background_fill, background_weight, followed, push_pull_fill
from guided import MATTE_RADIUS, guided_upsample
from inpaint_data import InpaintData, finished, layering
from inpaint_net import InpaintNet
from matte_net import MatteNet
from rim_net import RimNet, refined
from train_depth import evaluate_wild
from train_matte import coarse_matte, input_size, predict


def load(net, path):
    net.load_state_dict(load_safetensors(path))
    return net.eval().to(memory_format=torch.channels_last)


def fit(q, g, known):
    """The best scale and shift of q onto g, in the least-squares sense."""
    s, t = np.linalg.lstsq(np.stack([q[known], np.ones(known.sum())], 1), g[known], rcond=None)[0]
    return q * s + t


# ---- depth

@torch.no_grad()
def disparity(net, image, side=384, guided=True):
    """In [0, 1] at the photo's size, as graphs/stages makes it; without guide enlarged bicubically."""
    h, w = input_size(*image.shape[:2], side)
    small = cv2.resize(image, (w, h), interpolation=cv2.INTER_CUBIC)
    x = torch.from_numpy(np.ascontiguousarray(small.transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1))
    y = net(x)[None]
    y = (y - y.min()) / (y.max() - y.min() + 1e-9)
    if guided:
        return guided_upsample(y[0, 0].double().numpy(), small / 255, image / 255).clip(0, 1)
    return F.interpolate(y, size=image.shape[:2], mode='bicubic', align_corners=False)[0, 0].double().numpy()


def rooms(estimate, cache):
    over, relative = [], []
    for image, z in zip(np.load(cache + '/holdout_rgb.npy'), np.load(cache + '/holdout_depth.npy')):
        z = np.maximum(z / 25.5, .3)
        depth = 1 / np.maximum(fit(estimate(image), 1 / z, z > 0), .1)
        over.append((np.maximum(depth / z, z / depth) > 1.25).mean())
        relative.append((np.abs(depth - z) / z).mean())
    return f'ratio > 1.25 on {100 * np.mean(over):.2f}%, AbsRel {np.mean(relative):.4f}'


def ordinal(q, g, known, reach=6, step=.1):
    """Of the pairs of pixels 2·reach apart across an edge (step of the range), the part whose order is wrong."""
    wrong = pairs = 0
    span = np.ptp(g[known])
    for axis in (0, 1):
        a, b = (np.take(v, range(0, v.shape[axis] - 2 * reach), axis) for v in (g, q)), (np.take(v, range(2 * reach, v.shape[axis]), axis) for v in (g, q))
        (ga, qa), (gb, qb) = a, b
        both = np.take(known, range(0, known.shape[axis] - 2 * reach), axis) & np.take(known, range(2 * reach, known.shape[axis]), axis)
        edge = both & (np.abs(ga - gb) > step * span)
        pairs += edge.sum()
        wrong += (edge & (np.sign(qa - qb) != np.sign(ga - gb))).sum()
    return wrong / max(1, pairs)


def views(estimate, folder):
    lines = []
    for scene in sorted(glob.glob(folder + '/*/scene.json')):
        with open(scene) as f:
            info = json.load(f)
        here = os.path.dirname(scene) + '/'
        g = cv2.imread(here + info['disparity'], cv2.IMREAD_UNCHANGED) * float(info['disparity_scale'])
        known = g > 0
        q = estimate(cv2.imread(here + info['source_image'])[..., ::-1].copy())
        error = fit(q, g, known)[known] - g[known]
        lines.append((np.sqrt((error ** 2).mean()), np.sqrt((error ** 2).mean()) / np.ptp(g[known]), ordinal(q, g, known)))
    each = ', '.join(f'{px:.2f}' for px, _, _ in lines)
    _, share, order = np.mean(lines, 0)
    return f'RMSE {each} px, on average {100 * share:.1f}% of the range; {100 * order:.1f}% of the pairs across edges in wrong order'


def held_subjects(cache):
    """Held-out photos with a subject, and their mattes."""
    photos, mattes, subject = Ragged(cache + '/photos'), Ragged(cache + '/mattes'), np.load(cache + '/subject.npy')
    return [(photos[i], mattes[i]) for i in np.load(cache + '/held.npy') if subject[i] == 2]


def alphamatting(folder, scale=1, names='GT*'):
    """alphamatting.com's photos (RGB) and alphas (bytes), or other names'."""
    read = lambda f: cv2.resize(cv2.imread(f), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return [(read(f)[..., ::-1].copy(), read(f.replace('image.jpg', 'alpha.png'))[..., 0]) for f in sorted(glob.glob(f'{folder}/{names}_image.jpg'))]


def boundaries(estimate, pairs, side):
    """At `side` pixels: how far the steepest point of the disparity is from the matte's edge, along its normal, within 10 pixels."""
    near, far, standing = [], [], 0
    for photo, alpha in pairs:
        h, w = input_size(*alpha.shape, side)
        matte, q = cv2.resize(alpha, (w, h)).astype(np.float32) / 255, cv2.resize(estimate(photo), (w, h))
        q = (q - q.min()) / (np.ptp(q) + 1e-9)
        ring = ndimage.binary_dilation(matte > .5, iterations=12) & (matte < .1)
        inside = (matte > .9) & ndimage.binary_dilation(matte < .5, iterations=12)
        standing += bool(ring.any() and inside.any() and np.median(q[inside]) - np.median(q[ring]) > .05)
        smooth = cv2.GaussianBlur(matte, (0, 0), 2)
        ny, nx = np.gradient(smooth)
        edge = (matte > .5) ^ ndimage.binary_erosion(matte > .5)
        edge[:10], edge[-10:], edge[:, :10], edge[:, -10:] = False, False, False, False
        y, x = np.nonzero(edge & (np.hypot(nx, ny) > .05))
        if len(y) < 20:
            continue
        n = np.hypot(nx, ny)[y, x]
        t = np.arange(-10, 10.5, .5)
        profile = ndimage.map_coordinates(q, [y[:, None] + t * (ny[y, x] / n)[:, None], x[:, None] + t * (nx[y, x] / n)[:, None]], order=1)
        seen = profile[:, -1] - profile[:, 0] > .05
        offset = np.abs(t[:-1] + .25)[np.argmax(np.diff(profile, axis=1), axis=1)]
        near.append((offset[seen] <= 2).mean() if seen.any() else 0)
        far.append(np.median(offset[seen]) if seen.any() else 10)
    return (f'edges within 2 pixels of the matte\'s on {100 * np.mean(near):.0f}% of their length, median offset {np.mean(far):.1f} px; '
            f'subject nearer than its surroundings in {standing} of {len(pairs)}')


def depth(a):
    net = load(DepthNet(), a.weights)
    constant = lambda image: np.ones(image.shape[:2])
    ramp = lambda image: np.broadcast_to(np.linspace(0, 1, image.shape[0])[:, None], image.shape[:2]).copy()
    for name, estimate in (('constant', constant), ('bottom near', ramp), ('at 256', lambda x: disparity(net, x, 256)), ('at 384', lambda x: disparity(net, x))):
        print(f'rooms, {name}: {rooms(estimate, a.cache)}', flush=True)
        if a.views:
            print(f'stereo scenes, {name}: {views(estimate, a.views)}', flush=True)
    print('photos in the wild, before they are enlarged:', evaluate_wild(net, a.cache, 'cpu'), flush=True)
    for name, guided in (('', True), (', bicubic', False)):
        print(f'held-out photos{name}:', boundaries(lambda x: disparity(net, x, guided=guided), held_subjects(a.cache), 384), flush=True)
        if a.alphamatting:
            print(f'alphamatting at 800 pixels{name}:', boundaries(lambda x: disparity(net, x, guided=guided), alphamatting(a.alphamatting), 800), flush=True)
    if a.sheet:
        sheet(a, lambda image: disparity(net, image), True)


# ---- inpainting

def uncovered(d):
    """Left disparity (pixels) -> pixels of the right view that no left pixel maps to, and the background's disparity there."""
    h, w = d.shape
    right = np.full((h, w), -1.)
    for y in range(h):
        x = np.round(np.arange(w) - d[y]).astype(int)
        keep = (x >= 0) & (x < w)
        np.maximum.at(right[y], x[keep], d[y][keep])
    hole = ndimage.binary_opening(right < 0, np.ones((1, 3)))
    left_of, right_of = right.copy(), right.copy()
    for x in range(1, w):
        left_of[:, x] = np.where(right[:, x] < 0, left_of[:, x - 1], right[:, x])
    for x in range(w - 2, -1, -1):
        right_of[:, x] = np.where(right[:, x] < 0, right_of[:, x + 1], right[:, x])
    back = np.where(left_of < 0, right_of, np.where(right_of < 0, left_of, np.minimum(left_of, right_of)))
    hole &= (left_of >= 0) & (right_of >= 0)
    return hole, back


def believed(matte):
    """slide_matte's matte as slide_run --matte auto uses it: nothing where no subject stands out."""
    used = .01 <= (matte > .5).mean() <= .85 and (matte > .9).mean() > .5 * (matte > .1).mean()
    return (matte * used).astype(np.float32)


@torch.no_grad()
def fills(net, scene, d, hole, mattes):
    """{name: (RGBD, weight of the colours)}: the fill and the network's, smooth and with texture, with each matte {name: matte}."""
    out = {}
    for name, matte in mattes.items():
        for who, network in (('fill', None), ('network', net)):
            smooth, textured, weight = background_fill(scene, d, hole, None if matte is None else followed(matte), network)
            out.update({f'smooth {who}{name}': (smooth[0].numpy(), weight), f'{who}{name}': (textured[0].numpy(), weight)})
    return out


def stereo(net, matting, folder):
    """What the right view uncovers, taken from the inpainted left view: PSNR in the uncovered pixels."""
    scores = {}
    for scene in sorted(glob.glob(folder + '/*/scene.json')):
        with open(scene) as f:
            info = json.load(f)
        here = os.path.dirname(scene) + '/'
        left, right = (cv2.imread(here + info[n])[..., ::-1].copy() for n in ('source_image', 'target_image'))
        d = cv2.imread(here + info['disparity'], cv2.IMREAD_UNCHANGED) * float(info['disparity_scale'])
        index = ndimage.distance_transform_edt(d <= 0, return_distances=False, return_indices=True)
        d = d[index[0], index[1]]
        hole, back = uncovered(d)
        h, w = (v // 8 * 8 for v in d.shape)
        d1, _, mask = layering(((d - d.min()) / np.ptp(d)).astype(np.float32), np.ptp(d))
        rgbd = np.concatenate([left / 127.5 - 1, 2 * d1[..., None] - 1], 2).transpose(2, 0, 1).astype(np.float32)
        s, dt, ht = (torch.from_numpy(np.ascontiguousarray(v[..., :h, :w]))[None] for v in (rgbd, d1[None], mask[None]))
        mattes = {'': None}
        if matting:
            mattes[", slide_matte's"] = torch.from_numpy(believed(matte_of(matting, left))[None, None, :h, :w])
        ours = {name: y[:3] for name, (y, *_) in fills(net, s, dt, ht, mattes).items()}
        unknown = background_weight(dt, ht)[0, 0].numpy() < .5
        rgb = np.ascontiguousarray(left[:h, :w])
        ours['Telea'] = cv2.inpaint(rgb, unknown.astype(np.uint8), 3, cv2.INPAINT_TELEA).transpose(2, 0, 1) / 127.5 - 1
        ours['Navier-Stokes'] = cv2.inpaint(rgb, unknown.astype(np.uint8), 3, cv2.INPAINT_NS).transpose(2, 0, 1) / 127.5 - 1
        index = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
        ours['nearest copy'] = s[0, :3].numpy()[:, index[0], index[1]]
        y, x = np.nonzero(hole[:h, :w])
        at = np.round(x + back[y, x]).astype(int)
        inside = at < w
        y, x, at = y[inside], x[inside], at[inside]
        for name, v in ours.items():
            error = (v[:, y, at].clip(-1, 1) - (right[y, x].T / 127.5 - 1)) / 2
            scores.setdefault(name, []).append((-10 * np.log10((error ** 2).mean()), np.abs(error).mean()))
    for name, rows in scores.items():
        print(f'stereo, {name:14s} PSNR {np.mean(rows, 0)[0]:.2f} dB, L1 {np.mean(rows, 0)[1]:.4f}; each {", ".join(f"{r[0]:.2f}" for r in rows)}', flush=True)


def estimated(net, sample, parallax):
    """The sample with the disparity that slide_depth makes of its scene, and the hole that follows."""
    scene, truth, _, alpha, *_ = sample
    image = lambda v: (v[:3].transpose(1, 2, 0) + 1) / 2
    return finished(image(scene), image(truth), disparity(net, bytes_of(scene)), alpha[0], parallax)


def bytes_of(scene):
    return ((scene[:3].transpose(1, 2, 0) + 1) * 127.5).round().clip(0, 255).astype(np.uint8)


def inpaint(a):
    net, matting = load(InpaintNet(), a.weights), load(MatteNet(), a.matte_weights) if a.matte_weights else None
    data = InpaintData(a.cache, 99, 160, held=True)
    composites(a, net, matting, (data.sample() for _ in range(120)))
    if a.depth_weights:
        print('with slide_depth\'s disparity, 256 pixels')
        depths, data, rng = load(DepthNet(), a.depth_weights), InpaintData(a.cache, 778, 256, held=True), np.random.default_rng(346)
        samples = (estimated(depths, data.sample(), np.exp(rng.uniform(np.log(5), np.log(30)))) for _ in range(150))
        a.sheet = None
        composites(a, net, matting, list(itertools.islice((s for s in samples if s[5].sum() >= 200), 90)))
    if a.views:
        stereo(net, matting, a.views)


def composites(a, net, matting, samples):
    scores, tiles = {}, []
    for k, (scene, truth, d, alpha, hole, mask, cover) in enumerate(samples):
        s, dt, ht, at = (torch.from_numpy(v)[None] for v in (scene, d, hole, alpha))
        mattes = {'': None, ', the true matte': at}
        if matting:
            mattes[", slide_matte's"] = torch.from_numpy(believed(matte_of(matting, bytes_of(scene))))[None, None]
        found = fills(net, s, dt, ht, mattes)
        ours, shares = ({name: v[i] for name, v in found.items()} for i in (0, 1))
        shares = {name: push_pull_fill(at, w)[0, 0].numpy() for name, w in shares.items()}
        unknown, beyond, told = (v[0, 0].numpy() < .5 for v in (found['fill'][1], background_weight(dt, ht), found['network'][1]))
        rgb, matte = ((scene[:3].transpose(1, 2, 0) + 1) * 127.5).clip(0, 255).astype(np.uint8), (alpha[0] * 255).astype(np.uint8)
        for name, region in (('outline', cv2.dilate(cover[0], np.ones((3, 3))) > 0), ('by depth', beyond), ('our known pixels', unknown), ('the network\'s', told)):
            for method, flag in (('Telea', cv2.INPAINT_TELEA), ('Navier-Stokes', cv2.INPAINT_NS)):
                y, share = (cv2.inpaint(v, region.astype(np.uint8), 3, flag) for v in (rgb, matte))
                ours[f'{method}, {name}'], shares[f'{method}, {name}'] = y.transpose(2, 0, 1) / 127.5 - 1, share / 255
            index = ndimage.distance_transform_edt(region, return_distances=False, return_indices=True)
            ours[f'nearest copy, {name}'], shares[f'nearest copy, {name}'] = (v[:, index[0], index[1]] for v in (scene[:3], alpha))
        m = mask[0] > 0
        inner = m & ndimage.binary_erosion(m)
        slope = lambda v: np.hypot(*np.gradient(v[:3].mean(0)))[inner].mean() if inner.any() else np.nan
        ring = ndimage.binary_dilation(m, iterations=6) & (cover[0] == 0)
        front = (cover[0] > 0) & ~m
        for name, y in ours.items():
            y = y[:3].clip(-1, 1)
            mse = ((y - truth[:3]) ** 2)[:, m].mean() / 4
            leak = np.nan
            if ring.sum() > 20 and front.sum() > 20:
                cf, cb = scene[:3][:, front].mean(1), truth[:3][:, m].mean(1)
                if np.linalg.norm(cf - cb) > .3:
                    leak = np.dot(y[:, m].mean(1) - cb, cf - cb) / np.dot(cf - cb, cf - cb)
            share = shares[name][..., m].mean()
            scores.setdefault(name, []).append((-10 * np.log10(mse + 1e-9), np.abs(y - truth[:3])[:, m].mean() / 2, slope(y) / max(slope(truth), 1e-3), leak, share))
        if k < 24:
            tiles.append([scene[:3], np.where(m, .9, scene[:3]), ours['fill'][:3], ours['network'][:3], np.where(m, ours['network'][:3], truth[:3]), truth[:3]])
    for name, rows in scores.items():
        p, l1, _, leak, share = np.nanmean(rows, 0)
        print(f'{name:34s} PSNR {p:.2f} dB, L1 {l1:.4f}, gradient {np.nanmedian([r[2] for r in rows]):.2f} of the truth\'s, way to the foreground\'s colour {leak:+.3f}, '
              f'foreground\'s share {share:.3f}')
    gain = np.array([r[0] for r in scores['network']]) - np.array([r[0] for r in scores['fill']])
    print(f'the network over the fill: {gain.mean():+.3f} dB, better in {100 * (gain > 0).mean():.0f}%, worst {gain.min():+.2f} dB')
    if a.sheet:
        rows = [np.hstack([((v + 1) * 127.5).clip(0, 255).astype(np.uint8).transpose(1, 2, 0) for v in r]) for r in tiles]
        cv2.imwrite(a.sheet, np.hstack([np.vstack(rows[:12]), np.vstack(rows[12:])])[..., ::-1])


# ---- mattes

def matte_of(net, image, guided=True):
    """At the photo's size, as graphs/stages makes it; without guide enlarged bilinearly."""
    if not guided:
        return predict(net, image, 'cpu')
    y, small = coarse_matte(net, image)
    return guided_upsample(y[0, 0].double().numpy(), small / 255, image / 255, MATTE_RADIUS).clip(0, 1)


def gradient_error(a, m):
    return np.mean([np.abs(np.diff(a - m, axis=k)).mean() for k in (0, 1)])


def matte(a):
    net = load(MatteNet(), a.weights)
    rim = load(RimNet(), a.rim_weights) if a.rim_weights else None
    photos, mattes = Ragged(a.cache + '/photos'), Ragged(a.cache + '/mattes')
    pairs = [(photos[i], mattes[i] / 255) for i in np.load(a.cache + '/held.npy')]
    sets = {'held-out photos': pairs}
    if a.alphamatting:
        for name, scale in (('alphamatting, half size', .5), ('alphamatting, full size', 1)):
            sets[name] = [(image, m / 255) for image, m in alphamatting(a.alphamatting, scale)]
        sets['others with alpha, full size'] = [(image, m / 255) for image, m in alphamatting(a.alphamatting, 1, '[!G]*')]
    for name, pairs in sets.items():
        flat = np.mean([(np.abs(m.mean() - m).mean(), gradient_error(m * 0, m)) for _, m in pairs], 0)
        for how, guided in (('', True), (', bilinear', False)) if rim is None else ((', refined', True),):
            rows = []
            for image, m in pairs:
                y = matte_of(net, image, guided=guided)
                y = y if rim is None else refined(rim, image, y)
                union = ((y > .5) | (m > .5)).sum()
                rows.append((np.abs(y - m).mean(), gradient_error(y, m), ((y > .5) & (m > .5)).sum() / union if (m > .5).mean() > .02 else np.nan))
            e, g, i = np.nanmean(rows, 0)
            print(f'{name}{how}: error {e:.4f}, gradient error {g:.5f}, IoU {i:.3f}; a constant: {flat[0]:.4f}, {flat[1]:.5f}', flush=True)
    if a.u2netp:
        print(f'U2-NetP\'s published maps: {beside_published(net, a.u2netp)}', flush=True)
    if a.sheet:
        sheet(a, lambda image: matte_of(net, image), False)


def beside_published(net, folder):
    """How far our maps are from those that U2-NetP's authors published (NAME.* and NAME_u2netp.png); neither is the truth."""
    rows = []
    for path in sorted(glob.glob(folder + '/*_u2netp.png')):
        photo, = [f for f in glob.glob(path[:-len('_u2netp.png')] + '.*')]
        image, theirs = cv2.imread(photo)[..., ::-1].copy(), cv2.imread(path)[..., 0] / 255
        y = matte_of(net, image)
        theirs = cv2.resize(theirs, y.shape[::-1])
        rows.append((np.abs(y - theirs).mean(), ((y > .5) & (theirs > .5)).sum() / max(1, ((y > .5) | (theirs > .5)).sum())))
    return f'{len(rows)} photos, difference {np.mean(rows, 0)[0]:.4f}, IoU {np.mean(rows, 0)[1]:.3f}, over 0.8 in {sum(i > .8 for _, i in rows)}'


def sheet(a, estimate, stretch, count=24, side=200):
    """24 held-out photos, each beside its map."""
    photos, subject = Ragged(a.cache + '/photos'), np.load(a.cache + '/subject.npy')
    tiles = []
    for i in [i for i in np.load(a.cache + '/held.npy') if subject[i] == 2][1:2 * count + 1:2]:
        y = estimate(photos[i])
        y = (y - y.min()) / (np.ptp(y) + 1e-9) if stretch else y
        pair = [photos[i], np.repeat((y.clip(0, 1) * 255).astype(np.uint8)[..., None], 3, 2)]
        tiles.append(np.hstack([cv2.resize(v, (int(side * 1.2), side)) for v in pair]))
    rows = [np.hstack(tiles[k:k + 4]) for k in range(0, len(tiles) - 3, 4)]
    cv2.imwrite(a.sheet, np.vstack(rows)[..., ::-1])


if __name__ == '__main__':
    p = argparse.ArgumentParser()
    p.add_argument('what', choices=('depth', 'inpaint', 'matte'))
    p.add_argument('--cache', required=True)
    p.add_argument('--weights', required=True)
    p.add_argument('--views')
    p.add_argument('--alphamatting')
    p.add_argument('--u2netp')
    p.add_argument('--matte-weights')
    p.add_argument('--depth-weights')
    p.add_argument('--rim-weights')
    p.add_argument('--sheet')
    arguments = p.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    globals()[arguments.what](arguments)
