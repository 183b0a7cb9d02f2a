#!/usr/bin/python3
"""Quality against time of slide_eval's ablations, as SVG: each value of the option is a point with its name.

  slide_eval SCENES --only 'soft, fill' --ablate beta=0.04,0.083,0.2 --json | ablation_plot.py [KIND [METHOD [FIGURE]]] > plot.svg

Default: the first kind of scene and method there is, and psnr."""
import json
import sys

WIDTH, HEIGHT, LEFT, TOP = 560, 320, 70, 30


def scale(values, low, high):
    a, b = min(values), max(values)
    room = (b - a) * .1 or abs(a) * .01 or 1
    return lambda v: low + (v - a + room) / (b - a + 2 * room) * (high - low), a, b


runs = json.load(sys.stdin)
kind = sys.argv[1] if len(sys.argv) > 1 else next(iter(runs[0]['means']))
method = sys.argv[2] if len(sys.argv) > 2 else next(iter(runs[0]['means'][kind]))
figure = sys.argv[3] if len(sys.argv) > 3 else 'psnr'
points = [(r['means'][kind][method]['seconds'], r['means'][kind][method][figure], r['value']) for r in runs]
x, x0, x1 = scale([p[0] for p in points], LEFT, WIDTH - 20)
y, y0, y1 = scale([p[1] for p in points], HEIGHT - 50, TOP)
print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">')
print(f'<text x="{WIDTH / 2}" y="18" text-anchor="middle">{runs[0]["option"]}: {kind}, {method}</text>')
print(f'<path d="M{LEFT},{TOP} V{HEIGHT - 50} H{WIDTH - 20}" fill="none" stroke="black"/>')
for v in (x0, x1):
    print(f'<text x="{x(v):.1f}" y="{HEIGHT - 34}" text-anchor="middle">{v:.2f}</text>')
for v in (y0, y1):
    print(f'<text x="{LEFT - 6}" y="{y(v) + 4:.1f}" text-anchor="end">{v:.4g}</text>')
print(f'<text x="{WIDTH / 2}" y="{HEIGHT - 12}" text-anchor="middle">seconds for the layers</text>')
print(f'<text x="16" y="{HEIGHT / 2}" text-anchor="middle" transform="rotate(-90 16 {HEIGHT / 2})">{figure}</text>')
for seconds, value, name in points:
    print(f'<circle cx="{x(seconds):.1f}" cy="{y(value):.1f}" r="4"/><text x="{x(seconds) + 7:.1f}" y="{y(value) + 4:.1f}">{name:g}</text>')
print('</svg>')
