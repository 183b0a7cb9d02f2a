#!/usr/bin/python3
"""Makes docs/benchmarks.md and its plots from what run.py measured.

  report.py [RESULTS.json ...] [--docs DOCS]      default: out/peers/results.json, docs
"""
import argparse
import json
import math
import os

LABELS = {
    'slide-fp32': 'SLIDE fp32', 'slide-bf16': 'SLIDE bf16', 'slide-int8': 'SLIDE int8', 'ort-fp32': 'ONNX Runtime fp32',
    'ort-fp32-nospin': 'ONNX Runtime fp32, no spinning', 'ort-int8': 'ONNX Runtime int8', 'opencv': 'OpenCV fp32', 'torch-fp32': 'PyTorch fp32',
    'torch-bf16': 'PyTorch bf16',
}
COLOURS = {'slide': '#c0392b', 'ort': '#2471a3', 'opencv': '#7d8c2b', 'torch': '#b9770e'}
TITLES = {
    'midas_v21': 'MiDaS v2.1', 'midas_v21_small': 'MiDaS v2.1 small', 'depth_anything_v2_vits': 'Depth Anything V2 Small', 'inpaint_coarse': 'Inpainting, coarse', 'inpaint_deepfill': 'Inpainting, coarse and refined',
    'u2net': 'U²-Net', 'u2netp': 'U²-NetP', 'fba': 'FBA matting', 'slide_depth': 'slide_depth (trained)', 'slide_inpaint': 'slide_inpaint (trained)',
}
PAIRS = (('slide-fp32', 'ort-fp32'), ('slide-bf16', 'torch-bf16'), ('slide-int8', 'ort-int8'))
# Of each pair's peer, or of the one that is named.
AIMS = {
    'midas_v21': (.70, .75, .85), 'depth_anything_v2_vits': (.60, .60, None), 'midas_v21_small': (.60, .50, .65), 'u2net': (.40, .60, (.25, 'ort-fp32')), 'u2netp': (.40, .60, (.25, 'ort-fp32')),
    'fba': (.55, None, None), 'inpaint_coarse': (.45, .50, .60), 'slide_depth': (None, None, None), 'slide_inpaint': (None, None, None),
    'inpaint_deepfill': (None, None, None),
}


def precision(name):
    return next((p for p in ('bf16', 'int8') if p in name), 'fp32')


def title(result):
    width = ''.join(', width ' + part[1:] for part in result['case'].split('_') if part[:1] == 'w' and part[1:].isdigit())
    return f'{TITLES[result["network"]]}{width}, {result["size"][0]}×{result["size"][1]}'


def by_name(result):
    return {p['name']: p for p in result['peers']}


def measured(result, name):
    peer = by_name(result).get(name)
    return peer if peer and peer.get('ms') else None


def ratio(result, ours, theirs, value=lambda p: p['ms']):
    a, b = measured(result, ours), measured(result, theirs)
    return f'{value(a) / value(b):.2f}' if a and b else '–'


def gflop(result):
    return next((p['gflop'] for p in result['peers'] if 'gflop' in p), None)


def peak(machine, threads, kind):
    """GFLOP/s of the best level with so many threads."""
    found = [p for p in machine['peaks'] if p['threads'] == threads] if isinstance(machine['peaks'], list) else []
    return max((p[kind] for p in found), default=0)


def of_peak(result, peer, machine):
    top, work = peak(machine, result['threads'], precision(peer['name'])), gflop(result)
    if not top or not work:
        return '–'
    rate = 1e3 * work / peer['ms']
    return f'{rate:.0f} ({100 * rate / top:.0f} % of {top:.0f})'


def network_table(result, machine):
    ours = measured(result, 'slide-fp32')
    lines = ['| runtime | ms | SLIDE fp32 / it | GFLOP/s (of the peak) | load, ms | peak memory, MiB | of which before loading | max error | RMS error |',
             '|---|--:|--:|--:|--:|--:|--:|--:|--:|']
    for p in result['peers']:
        label = LABELS[p['name']]
        if 'failed' in p:
            lines.append(f'| {label} | does not run it |' + ' |' * 7)
        elif p['ms']:
            against = f'{ours["ms"] / p["ms"]:.2f}' if ours else '–'
            lines.append(f'| {label} | {p["ms"]:.1f} | {against} | {of_peak(result, p, machine)} | {p["load_ms"]:.1f} | {p["peak_kib"] / 1024:.0f} | '
                         f'{p["base_kib"] / 1024:.0f} | {p["max_error"]:.1e} | {p["rms_error"]:.1e} |')
    return lines


def summary_table(results):
    lines = ['| network | threads | GFLOP | SLIDE fp32, ms | ' + ' | '.join(f'{LABELS[a]} / {LABELS[b]}' for a, b in PAIRS) +
             ' | RMS error / ONNX Runtime\'s | memory above the start / ONNX Runtime\'s | load / ONNX Runtime\'s |', '|---|--:|--:|--:|' + '--:|' * (len(PAIRS) + 3)]
    for r in results['networks']:
        ours = measured(r, 'slide-fp32')
        if not ours:
            continue
        cells = [title(r), str(r['threads']), f'{gflop(r):.1f}', f'{ours["ms"]:.1f}'] + [ratio(r, *pair) for pair in PAIRS]
        fp32 = PAIRS[0]
        cells += [ratio(r, *fp32, lambda p: p['rms_error']), ratio(r, *fp32, lambda p: p['peak_kib'] - p['base_kib']), ratio(r, *fp32, lambda p: p['load_ms'])]
        lines.append('| ' + ' | '.join(cells) + ' |')
    return lines


def peak_table(machine):
    lines = ['| level | threads | fp32, GFLOP/s | bf16, GFLOP/s | int8, GOP/s | read, GB/s | copy, GB/s |', '|---|--:|--:|--:|--:|--:|--:|']
    for p in machine['peaks'] if isinstance(machine['peaks'], list) else []:
        cells = [f'{p[k]:.0f}' if p[k] else '–' for k in ('fp32', 'bf16', 'int8', 'read', 'copy')]
        lines.append(f'| {p["isa"]} | {p["threads"]} | ' + ' | '.join(cells) + ' |')
    return lines


def floor_of(result, peer, machine):
    """Milliseconds of the arithmetic alone, and of each node's arithmetic or memory traffic, whichever takes longer."""
    tops = {kind: peak(machine, result['threads'], kind) for kind in ('fp32', 'bf16', 'int8', 'read')}
    if not all(tops.values()) or 'work' not in peer:
        return None
    arithmetic = [2e-6 * macs / tops[kind] for kind, macs, *_ in peer['work']]
    memory = [1e-6 * size / tops['read'] for _, _, size, *_ in peer['work']]
    return sum(arithmetic), sum(map(max, arithmetic, memory))


def aim_of(result, aim, peer):
    """The share of a peer's time that is aimed at, that peer, and the milliseconds; None if there is no aim."""
    share, peer = aim if isinstance(aim, tuple) else (aim, peer)
    other = measured(result, peer)
    return (share, peer, share * other['ms']) if share and other else None


def missed(results):
    """What takes longer than is aimed at, with the most threads: results of networks, SLIDE's of a precision, and the aim in milliseconds."""
    most = max(r['threads'] for r in results['networks'])
    for r in results['networks']:
        for (ours, peer), aim in zip(PAIRS, AIMS.get(r['network'], (None, None, None))):
            p, wanted = measured(r, ours), aim_of(r, aim, peer)
            if r['threads'] == most and p and wanted and p['ms'] > wanted[2] and 'kernels' in p:
                yield r, p, wanted[2]


def kernel_table(results):
    """Where the time of those goes, by kernel."""
    lines = ['| network | precision | SLIDE, ms | aim, ms | kernel | nodes | ms | arithmetic at the peak, ms |', '|---|---|--:|--:|---|--:|--:|--:|']
    for r, p, aim in missed(results):
        tops = {kind: peak(results['machine'], r['threads'], kind) for kind in ('fp32', 'bf16', 'int8')}
        if not all(tops.values()):
            continue
        first = [title(r), precision(p['name']), f'{p["ms"]:.1f}', f'{aim:.1f}']
        shown = [k for k in p['kernels'] if k['ms'] > .02 * p['ms']]
        rest = [k for k in p['kernels'] if k not in shown]
        for k in shown:
            least = sum(2e-6 * macs / tops[kind] for kind, macs, _, kernel in p['work'] if kernel == k['kernel'])
            lines.append('| ' + ' | '.join([*first, k['kernel'], str(k['nodes']), f'{k["ms"]:.2f}', f'{least:.2f}']) + ' |')
            first = [''] * 4
        lines.append(f'| | | | | others | {sum(k["nodes"] for k in rest)} | {sum(k["ms"] for k in rest):.2f} | |')
    return lines


def floor_table(results):
    """Where the time goes as far as it must, beside the peer's and the project's aim for it."""
    lines = ['| network | threads | precision | SLIDE, ms | arithmetic at the peak, ms | arithmetic or memory, ms | reached | aim, of its peer\'s time | aim, ms |',
             '|---|--:|---|--:|--:|--:|--:|--:|--:|']
    for r in results['networks']:
        for (ours, peer), aim in zip(PAIRS, AIMS.get(r['network'], (None, None, None))):
            p = measured(r, ours)
            floor = p and floor_of(r, p, results['machine'])
            if not floor:
                continue
            wanted = ['–', '–']
            if aim_of(r, aim, peer):
                share, peer, ms = aim_of(r, aim, peer)
                wanted = [f'{share:.2f} of {LABELS[peer]}', f'{ms:.1f}']
            lines.append(f'| {title(r)} | {r["threads"]} | {precision(ours)} | {p["ms"]:.1f} | {floor[0]:.1f} | {floor[1]:.1f} | {100 * floor[1] / p["ms"]:.0f} % | '
                         + ' | '.join(wanted) + ' |')
    return lines


# Plots: time to the right, RMS error upwards, both logarithmic.

W, H, LEFT, RIGHT, TOP, BOTTOM = 640, 360, 62, 20, 34, 46
LABEL = 14  # its height


class Axis:
    def __init__(self, values, start, end):
        low, high = math.log10(min(values)), math.log10(max(values))
        margin = max(.08 * (high - low), .1)
        self.low, self.high, self.start, self.end = low - margin, high + margin, start, end

    def at(self, value):
        return self.start + (math.log10(value) - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self):
        steps = (1,) if self.high - self.low > 2.5 else (1, 2, 5)
        found = [step * 10. ** e for e in range(math.floor(self.low) - 1, math.ceil(self.high) + 1) for step in steps]
        return [v for v in found if self.low <= math.log10(v) <= self.high]


def text(x, y, content, anchor='start', size=12, colour='#333'):
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="{colour}">{content}</text>'


def label_box(px, py, width, taken):
    """Where a point's label goes: beside it, or above or below where it would cover another -> left, top, right, bottom."""
    boxes = [(left, py - 8 + dy, left + width, py + 7 + dy) for dy in (0, -5, 5, -13, 13, -26, 26, -39, 39, -52, 52) for left in (px + 9, px - 9 - width, px - width / 2)]
    inside = [b for b in boxes if b[0] > LEFT and b[2] < W and b[1] > TOP and b[3] < H - BOTTOM]
    return min(inside, key=lambda b: sum(b[0] < t[2] and t[0] < b[2] and b[1] < t[3] and t[1] < b[3] for t in taken))


def plot(result):
    points = [p for p in result['peers'] if p.get('ms') and 0 < p['rms_error'] < math.inf]
    if len(points) < 2:
        return None
    x = Axis([p['ms'] for p in points], LEFT, W - RIGHT - 110)
    y = Axis([p['rms_error'] for p in points], H - BOTTOM - LABEL, TOP + LABEL)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {W} {H}" font-family="sans-serif">', f'<rect width="{W}" height="{H}" fill="#fff"/>',
           text(LEFT, 20, f'{title(result)}, {result["threads"]} threads', size=14)]
    for v in x.ticks():
        out.append(f'<path d="M{x.at(v):.1f} {TOP}V{H - BOTTOM}" stroke="#e4e4e4"/>' + text(x.at(v), H - BOTTOM + 16, f'{v:g}', 'middle', 11))
    for v in y.ticks():
        out.append(f'<path d="M{LEFT} {y.at(v):.1f}H{W - RIGHT}" stroke="#e4e4e4"/>' + text(LEFT - 6, y.at(v) + 4, f'{v:.0e}', 'end', 11))
    out.append(text(W / 2, H - 10, 'milliseconds (left is faster)', 'middle'))
    out.append(f'<g transform="translate(14 {H / 2}) rotate(-90)">{text(0, 0, "RMS error (down is better)", "middle")}</g>')
    taken = [(x.at(p['ms']) - 6, y.at(p['rms_error']) - 6, x.at(p['ms']) + 6, y.at(p['rms_error']) + 6) for p in points]
    for p in sorted(points, key=lambda p: p['ms']):
        colour, px, py, label = COLOURS[p['name'].split('-')[0]], x.at(p['ms']), y.at(p['rms_error']), LABELS[p['name']]
        box = label_box(px, py, 7.1 * len(label), taken)
        taken.append(box)
        out.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="5" fill="{colour}"/>' + text((box[0] + box[2]) / 2, box[3] - 3, label, 'middle', colour=colour))
    return '\n'.join(out + ['</svg>', ''])


def stage_name(name):
    """Without the folder of the file that is written."""
    return 'writing ' + os.path.basename(name) if name.startswith('writing ') else name


def stage_lines(results):
    lines = ['## Layering, and a whole 3D photo', '']
    for r in results.get('layering', []):
        if 'ms' in r:
            error = max(e['rms'] for e in r['error'].values())
            lines.append(f'- Soft layering at 672×1008, {r["threads"]} thread(s): {r["ms"]:.1f} ms, peak memory {r["peak_kib"] / 1024:.0f} MiB, RMS error at most {error:.1e}.')
    for r in results.get('slide_run', []):
        if 'seconds' in r:
            stages = ', '.join(f'{stage_name(name)} {seconds:.2f} s' for name, seconds in r['stages'].items())
            lines.append(f'- `slide_run` from a photo of 1008×672 to the last of {r["frames"]} frames (Y4M), {r["threads"]} thread(s): {r["seconds"]:.2f} s, '
                         f'peak memory {r["peak_bytes"] / 2**20:.0f} MiB ({stages}; the rest is rendering and files).')
    return lines


def layer_lines(results, machine):
    lines = ['## Single convolutions beside oneDNN', '', 'SLIDE reads and writes planar tensors here; oneDNN\'s reorders to its blocked layouts are left out.', '',
             '| layer | threads | kernel | ms | GFLOP/s (of the peak) | max error |', '|---|--:|---|--:|--:|--:|']
    for layer in results['layers']:
        for r in layer['results']:
            top = peak(machine, layer['threads'], precision(r['name']))
            share = f' ({100 * r["gflops"] / top:.0f} % of {top:.0f})' if top else ''
            lines.append(f'| {layer["layer"]} | {layer["threads"]} | {r["name"]} | {r["ms"]:.2f} | {r["gflops"]:.0f}{share} | {r["max_error"]:.1e} |')
    return lines + ['']


def versions(results):
    found = {p['name'].split('-')[0]: p['version'] for r in results['networks'] for p in r['peers'] if 'version' in p}
    return ', '.join(('SLIDE ' if kind == 'slide' else '') + version for kind, version in sorted(found.items()))


INTRO = '''# Benchmarks

Made by `benchmarks/peers/report.py` from runs of `benchmarks/peers/run.sh`; [benchmarks/peers/README.md](../benchmarks/peers/README.md) says how
it is measured and how to repeat it.

- **Time**: the median over rounds. In a round every runtime runs once, in turn, while the others wait; rounds in which other programs took more than
  3 % of the machine do not count.
- **Load**: from the model's file to a session, plan or module that is ready to run (SLIDE, ONNX Runtime: the median of four processes). **Memory**: the highest resident size of the process; a peer's holds its
  interpreter, therefore what it was before the model was loaded stands beside it.
- **Errors** are those of the worst output against PyTorch in float64, relative to the output's largest magnitude and to its root mean square. The networks have
  made-up weights unless "trained" is said. Networks of random weights amplify rounding more than trained ones do: compare runtimes, not networks.
- **int8**: of MiDaS and the U²-Nets SLIDE knows ranges and errors of layers from the photos that calibrate ONNX Runtime's models (for both, the photo measured is
  one of the six), and takes the fastest plan that is expected to err 0.1 to 0.65 at most (`int8_budget` in `cases.py`: such that it errs less than half of what ONNX
  Runtime does); of the gated networks and FBA it measures ranges at each run.
- **slide_depth** (trained) is planned as it ships, in bf16 and int8 to err 1 and 1.5 % at most on ordinary photos, with float32 where the most would be lost.
- **Of the peak**: multiplications of the network's definition (a 1×1 convolution counted before the enlargement that it reads) against what the machine does at most in that precision with as many threads. Winograd
  convolutions multiply less than the definition, so that more than 100 % is possible.
'''

FLOORS = '''## Floors

What SLIDE's time could not undercut with the kernels that it chose: the multiplications that they really do (after Winograd) at the machine's peak in
their precision; and node by node the longer of that and of reading the inputs and the weights and writing the output once at the machine's reading speed,
as if no cache held anything. *Reached* is the second floor's part of the time.
'''

VITS = '''## Depth Anything V2 Small, on a Xeon

518×518, 114.6 GFLOP, formula weights. Machine: Intel Xeon (Sapphire Rapids, AMX), 2 cores; ONNX Runtime 1.32.0, PyTorch 1.13. Medians while other
programs used the machine now and then, each pair of SLIDE and ONNX Runtime in the same minute: the figures of two threads are no better than a fifth.
In a quieter minute the nodes of SLIDE in float32 added up to 370 ms. Errors are RMS against PyTorch in float64.

| | 2 threads, ms | 1 thread, ms | RMS error | memory |
|---|--:|--:|--:|--:|
| SLIDE fp32 | 476 | 841 | 2.6e-6 | 172 MiB planned |
| ONNX Runtime fp32 | 705 | 1336 | 4.4e-6 | 384 MiB above the start |
| SLIDE bf16 | 152 | 289 | 2.9e-2 | 115 MiB planned |
| PyTorch bf16 | 389 | – | – | – |
| SLIDE int8 (not calibrated; attention in bf16) | 147 | 276 | 8.8e-2 | 94 MiB planned |

Attention was 255 of 453 ms in bfloat16 on one thread while it was computed in float32; by tiles it takes 88. In float32 the linear layers run at 155 GFLOP/s a
thread and attention, with its exponentials, at 134.

| pixels | 252×252 | 392×392 | 518×518 | 686×686 |
|---|--:|--:|--:|--:|
| GFLOP | 20.9 | 57.1 | 114.6 | 246.5 |
| SLIDE bf16, 2 threads, ms | 40 | – | 152 | 346 |
'''

MISSED = '''## Where aims are missed

Of what takes longer than its aim, the time by kernel: sums over nodes, medians of five runs.

- **Winograd** convolutions are three parts. In U²-Net in float32 (one thread, timers around the parts) products take 71 % of the whole network's time, the
  input's transform 15 %, the output's 8 %, transforming weights at each run 3 %. Products of many tiles run at 80 to 93 % of the peak, of few tiles at 52 to 77 %,
  weights from memory included. The transform of an input of 320×320 pixels takes 340 to 390 cycles for 16 tiles of a channel; 186 would do if all were in
  the first caches, and reading it once from memory takes 100. Tiles of 6×6 outputs multiply a fifth less; taken wherever they fit, they make the
  network take 1.35 times as long (transforming the input nearly three times) and err 2.4 times as much.
- **MiDaS small** is 1×1 and depthwise layers of little depth and Winograd layers of 64 channels. With no regard to the error its fastest plan takes 15.8 instead of
  17.3 ms on one thread (ONNX Runtime in 8 bits 16.9): 7.2 ms are Winograd layers in bfloat16 (multiplied directly in 8 bits they would take 5.6 at the very peak), 5.0 are
  8-bit layers, 2.4 depthwise ones, which wait for their input. Tensors between layers are float32 in SLIDE and 8 bits in ONNX Runtime.
'''


def merged(paths):
    """What run.py wrote; what a later file has, too, at the same number of threads is taken from there."""
    files = []
    for path in paths:
        with open(path) as f:
            files.append(json.load(f))
    found = {(n['case'], n['threads']): n for results in files for n in results['networks']}
    order = list(dict.fromkeys(case for case, _ in found))
    networks = sorted(found.values(), key=lambda n: (order.index(n['case']), -n['threads']))
    whole = {kind: list({r['threads']: r for results in files for r in results.get(kind, [])}.values()) for kind in ('layering', 'slide_run')}
    return files[0] | whole | {'networks': networks, 'forced': any(results['forced'] for results in files)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('results', nargs='*', default=['out/peers/results.json'])
    parser.add_argument('--docs', default='docs')
    options = parser.parse_args()
    docs, results = options.docs, merged(options.results)
    machine = results['machine']
    os.makedirs(f'{docs}/pictures', exist_ok=True)
    lines = [INTRO, f'Machine: {machine["cpu"]}, {machine["cores"]} cores. {versions(results)}.', '']
    if results.get('round_trip_ns'):
        lines += [f'With more than one thread only rounds count in which a cache line took at most {results["round_trip_ns"]:.0f} ns from one core to another and back: '
                  'the virtual machine that this is moves between cores that share a cache and cores that do not.', '']
    if results.get('forced'):
        lines += ['**Other programs were running: these numbers mean nothing.**', '']
    lines += ['## Summary', '', 'Ratios of medians; below 1 SLIDE is faster, more exact, smaller.', '', *summary_table(results), '', '## What the machine can do', '',
              *peak_table(machine), '', *stage_lines(results), '']
    lines += [FLOORS, *floor_table(results), '']
    if any(missed(results)):
        lines += [MISSED, *kernel_table(results), '']
    lines.append(VITS)
    if results.get('layers'):
        lines += layer_lines(results, machine)
    for result in results['networks']:
        lines += [f'## {title(result)}, {result["threads"]} thread{"s" if result["threads"] > 1 else ""}', '']
        picture = plot(result) if result['threads'] == max(r['threads'] for r in results['networks']) else None
        if picture:
            with open(f'{docs}/pictures/speed_{result["case"]}.svg', 'w') as f:
                f.write(picture)
            lines += [f'![Error against time](pictures/speed_{result["case"]}.svg)', '']
        lines += [*network_table(result, machine), '', f'{result["quiet_rounds"]} rounds.', '']
    with open(f'{docs}/benchmarks.md', 'w') as f:
        f.write('\n'.join(lines).rstrip() + '\n')
    print(f'wrote {docs}/benchmarks.md')


if __name__ == '__main__':
    main()
