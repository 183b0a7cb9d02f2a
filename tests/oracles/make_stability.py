#!/usr/bin/python3
"""Writes docs/stability.md from what slide_check says of the hard cases and of the operator cases.

  make_stability.py [slide_check]      by default that of build/release
"""
import collections
import json
import os
import statistics
import subprocess
import sys

ROOT = os.path.abspath(os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..'))
LEVELS = ['baseline', 'avx2', 'avxvnni', 'avx512', 'avx512vnni', 'avx512bf16', 'amx', 'neon', 'neondot', 'neoni8mm', 'neonbf16']

INTRO = """# Stability

Made by `tests/oracles/make_stability.py` from `slide_check op`; on the CPU it was made on, the highest level was {level}.

## Hard cases
Every case of `tests/data/hard_cases`: large means, sums that cancel, both ends of float32's range, denormals. The answers
are exact, rounded once to float64 (`tests/oracles/make_hard_cases.py`). For each method, with the kernel of the highest
level: the largest error and the root mean square of it, both relative to the result's; the part of the stated bound that
is used; the RMS error as a multiple of what the arithmetic predicts, "-" where terms cancel so far that nothing is
predicted; elements that are not finite because they lie outside of the kernel's domain (`docs/operators.md`).

An RMS error near 1 or above is a lost result, although the bound holds: it is relative to the terms of the sums. That is
bfloat16's and 8-bit integers' lot wherever a filter takes a large mean away; a layer that does needs float32.

| case | method | max | rms | of bound | rms/predicted | outside |
|---|---|---|---|---|---|---|
"""

USE = """
## Typical use of the bounds
Over all kernels of all levels on `tests/data/operator_cases` and `tests/data/onnx_cases`, by method: the median and the
largest part of the bound that a case uses, and of the predicted RMS error. A bound can hardly be reached by sums of many
independent terms, whose errors grow with the root of their number. Exact methods (bound 0) are left out.

| method | cases | of bound, median | largest | rms/predicted, median | largest |
|---|---|---|---|---|---|
"""


def number(x):
    return '0' if x == 0 else f'{x:.2g}' if x is not None else 'inf'


def check(program, folder):
    run = subprocess.run([program, 'op', '--json', folder], stdout=subprocess.PIPE, check=False)
    cases = json.loads(run.stdout)['cases']
    wrong = [c['file'] for c in cases if not c.get('passed')]
    if wrong:
        sys.exit('these do not pass: ' + ', '.join(wrong))
    return cases


def method(kernel):
    return kernel['kernel'].rsplit('.', 1)[0]


def hard_rows(cases):
    rows = []
    for case in cases:
        best = {}
        for k in case['kernels']:
            if method(k) not in best or LEVELS.index(k['isa']) > LEVELS.index(best[method(k)]['isa']):
                best[method(k)] = k
        name = os.path.basename(case['file']).removesuffix('.safetensors')
        for k in best.values():
            predicted = number(k['rms'] / k['expected_rms']) if k['expected_rms'] else '-'
            rows.append(f"| {name} | {method(k)} | {number(k['error_vs_float64'])} | {number(k['rms'])} | "
                        f"{number(k['of_bound'])} | {predicted} | {k['outside_domain'] or ''} |\n")
            name = ''
    return rows


def use_rows(cases):
    bound, predicted = collections.defaultdict(list), collections.defaultdict(list)
    for case in cases:
        for k in case['kernels']:
            if k['factor'] > 0:
                bound[method(k)].append(k['of_bound'])
                if k['expected_rms']:
                    predicted[method(k)].append(k['rms'] / k['expected_rms'])
    rows = []
    for name in sorted(bound):
        p = predicted[name] or [0]
        rows.append(f'| {name} | {len(bound[name])} | {number(statistics.median(bound[name]))} | {number(max(bound[name]))} | '
                    f'{number(statistics.median(p))} | {number(max(p))} |\n')
    return rows


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else f'{ROOT}/build/release/bin/slide_check'
    hard = check(program, f'{ROOT}/tests/data/hard_cases')
    usual = check(program, f'{ROOT}/tests/data/operator_cases') + check(program, f'{ROOT}/tests/data/onnx_cases')
    level = max((k['isa'] for c in usual for k in c['kernels']), key=LEVELS.index)
    with open(f'{ROOT}/docs/stability.md', 'w', encoding='utf-8') as out:
        out.write(INTRO.format(level=level) + ''.join(hard_rows(hard)) + USE + ''.join(use_rows(usual)))


if __name__ == '__main__':
    main()
