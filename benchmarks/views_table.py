#!/usr/bin/python3
"""docs/views.md's table of slide_eval --json:   slide_eval STEREO_SCENES --json | views_table.py"""
import json
import sys

METHODS = ['one plane', 'single layer', 'hard, fill', 'soft, fill', 'hard, network', 'soft, network', 'soft, row copy',
           'own depth, single layer', 'own depth, soft']

scenes = [s for s in json.load(sys.stdin)['scenes'] if s['kind'] == 'stereo']
print('| | ' + ' | '.join(s['scene'] for s in scenes) + ' | PSNR | SSIM | visible | disoccluded |')
print('|---' * (len(scenes) + 5) + '|')
for method in (m for m in METHODS if m in scenes[0]['methods']):
    rows = [s['methods'][method] for s in scenes]
    mean = lambda key: sum(r[key] for r in rows) / len(rows)
    each = ' | '.join(f'{r["psnr"]:.2f} / {r["psnr_disoccluded"]:.2f}' for r in rows)
    print(f'| {method} | {each} | {mean("psnr"):.2f} | {mean("ssim"):.3f} | {mean("psnr_visible"):.2f} | {mean("psnr_disoccluded"):.2f} |')
