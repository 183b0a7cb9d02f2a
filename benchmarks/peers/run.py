#!/usr/bin/python3
"""Runs the networks on SLIDE and on other runtimes, in turns, and writes what it saw as JSON. See README.md."""
import argparse
import json
import math
import mmap
import os
import platform
import statistics
import subprocess
import sys
import time

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import cases  # noqa: E402
import tensors  # noqa: E402

PEERS = ('slide-fp32', 'slide-bf16', 'slide-int8', 'ort-fp32', 'ort-int8', 'opencv', 'torch-fp32', 'torch-bf16')
EXTRA_PEERS = ('ort-fp32-nospin',)
TURN = .2    # seconds of runs in one turn of a quick network
GAP = .05    # seconds between turns, in which the threads of the peer before stop spinning
OTHERS = .03  # share of the machine that other programs may take in a round
LOADING, COPIES = 256 << 20, 4  # bytes that loading touches at most: a runtime's own, and of the weights
LOADS = 4  # times that SLIDE and ONNX Runtime load a network, whose loading is compared; the others once
TICK = 1 / os.sysconf('SC_CLK_TCK')


def busy():
    """Seconds all CPUs together were not idle."""
    with open('/proc/stat') as f:
        user, nice, system, _idle, _wait, irq, soft, steal = map(int, f.readline().split()[1:9])
    return (user + nice + system + irq + soft + steal) * TICK


def own_time(pid):
    with open(f'/proc/{pid}/stat') as f:
        fields = f.read().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) * TICK


def others_share(seconds):
    """The part of the machine that other programs use."""
    start, own, clock = busy(), own_time('self'), time.monotonic()
    time.sleep(seconds)
    used = busy() - start - (own_time('self') - own)
    return max(0, used) / (time.monotonic() - clock) / os.cpu_count()


def touch_memory(wanted):
    """So many bytes, if they are free. A virtual machine gets free memory from its host when it is touched, at milliseconds a megabyte, and gives it back after
    two seconds: whoever loads a network next would be charged for it.

    By a process of its own, whose size this one's children do not inherit as their highest."""
    child = os.fork()
    if child != 0:
        os.waitpid(child, 0)
        return
    with open('/proc/meminfo') as f:
        free = next(int(line.split()[1]) << 10 for line in f if line.startswith('MemFree'))
    with mmap.mmap(-1, max(min(wanted, free // 10 * 8), mmap.PAGESIZE), mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as memory:
        memory.madvise(mmap.MADV_HUGEPAGE)
        for at in range(0, len(memory), mmap.PAGESIZE):
            memory[at] = 1
    os._exit(0)


class PeerFailed(Exception):
    pass


class Peer:
    """A process that obeys lines."""

    def __init__(self, name, case, threads, options):
        self.name, self.rounds = name, []
        with open(os.path.join(options.out, 'peers.log'), 'ab') as log:
            self.process = subprocess.Popen(command(name, case, threads, options), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True)
        self.facts = self.answer()

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise PeerFailed(f'ended with code {self.process.wait()}; see peers.log')
        message = json.loads(line)
        if 'error' in message:
            raise PeerFailed(message['error'])
        return message

    def ask(self, line):
        try:
            self.process.stdin.write(line + '\n')
            self.process.stdin.flush()
        except BrokenPipeError:
            pass
        return self.answer()

    def run(self):
        return self.ask('run')['ms']

    def stop(self):
        try:
            self.process.communicate('quit\n', timeout=20)
        except (subprocess.TimeoutExpired, BrokenPipeError):
            self.process.kill()
            self.process.wait()


def command(name, case, threads, options):
    out = options.out
    inputs = f'{out}/{case.name}.case.safetensors'
    kind, _, precision = name.partition('-')
    if kind == 'slide':
        weights = os.path.join(cases.ROOT, case.weights) if case.weights else f'{out}/{case.weight_name}.weights.safetensors'
        budget = []
        if precision == 'int8' and case.int8_budget:
            weights, budget = f'{out}/{case.weight_name}.calibrated.safetensors', ['--error-budget', str(case.int8_budget)]
        return [options.slide_bench, case.network, '--weights', weights, '--inputs', inputs, '--threads', str(threads), '--precision', precision, *budget,
                '--serve', *options.slide_options.split()]
    if kind == 'ort':
        model = f'{out}/{case.name}.int8.onnx' if precision == 'int8' else f'{out}/{case.name}.onnx'
        return ['node', f'{HERE}/peer_ort.js', model, inputs, str(threads), *(['--no-spinning'] if precision.endswith('nospin') else [])]
    return ['/usr/bin/python3', f'{HERE}/peer_python.py', name, case.name, out, str(threads)]


def suits(name, case):
    if name == 'ort-int8':
        return case.onnx and case.quantise
    return case.onnx if name.startswith(('ort', 'opencv')) else True


def errors(peer, case, options):
    """The worst of all outputs: max |y - y64| / max |y64|, and RMS(y - y64) / RMS(y64)."""
    path = f'{options.out}/output.bin'
    peer.ask('output ' + os.path.abspath(path))
    y = np.fromfile(path, np.float32).astype(np.float64)
    os.remove(path)
    worst, at = [0., 0.], 0
    for expected in tensors.load(f'{options.out}/{case.name}.case.safetensors', 'output.').values():
        part = y[at:at + expected.size].reshape(expected.shape)
        at += expected.size
        difference = np.nan_to_num(part - expected, nan=np.inf)
        worst[0] = max(worst[0], float(np.abs(difference).max() / np.abs(expected).max()))
        worst[1] = max(worst[1], float(math.sqrt((difference ** 2).mean() / (expected ** 2).mean())))
    if at != y.size:
        raise PeerFailed(f'{y.size} numbers came out where {at} were expected')
    return {'max_error': worst[0], 'rms_error': worst[1]}


def load(name, case, threads, options):
    touch_memory(LOADING + COPIES * os.path.getsize(f'{options.out}/{case.weight_name}.weights.safetensors'))
    return Peer(name, case, threads, options)


def loading_times(case, threads, options):
    """Milliseconds that loading takes those with which it is compared, by name: all but one of LOADS, in turns, a process each."""
    times = {name: [] for name in options.peers if suits(name, case) and name.startswith(('slide', 'ort'))}
    for _ in range(0 if options.quick else LOADS - 1):
        for name, found in times.items():
            try:
                peer = load(name, case, threads, options)
                found.append(peer.facts['load_ms'])
                peer.stop()
            except PeerFailed:
                pass  # start_peers() says so
    return times


def start_peers(case, threads, options):
    """Each is started, warmed up and compared with float64 while the others wait -> peers, results of those that failed."""
    peers, failed, times = [], [], loading_times(case, threads, options)
    for name in options.peers:
        if not suits(name, case):
            continue
        peer = None
        try:
            peer = load(name, case, threads, options)
            loads = [*times.get(name, []), peer.facts['load_ms']]
            peer.facts |= {'load_ms': statistics.median(loads), 'loads_ms': loads}
            first = peer.run()
            peer.facts |= errors(peer, case, options)
            again = first if first > 5000 else min(peer.run(), peer.run())
            peer.turn = max(1, min(20, round(1e3 * TURN / again)))
            peers.append(peer)
        except PeerFailed as problem:
            failed.append({'name': name, 'failed': str(problem)})
            if peer:
                peer.stop()
    return peers, failed


def round_trip(options):
    """Nanoseconds that a cache line takes from core to core and back."""
    return float(subprocess.run([options.peak, '--round-trip'], stdout=subprocess.PIPE, text=True, check=True).stdout)


def one_round(peers, threads, options):
    """Every peer once, in turn -> the part of the machine that others took, the longest round trip between cores (0 of one thread)."""
    trips, used, clock = [0.], 0., 0.
    for peer in peers:
        if threads > 1 and options.round_trip:
            trips.append(round_trip(options))
        start, since, own = busy(), time.monotonic(), sum(own_time(p.process.pid) for p in peers) + own_time('self')
        peer.latest = statistics.median(peer.run() for _ in range(peer.turn))
        time.sleep(GAP)
        used += busy() - start - (sum(own_time(p.process.pid) for p in peers) + own_time('self') - own)
        clock += time.monotonic() - since
    if threads > 1 and options.round_trip:
        trips.append(round_trip(options))
    return max(0, used) / clock / os.cpu_count(), max(trips)


def measure(case, threads, options):
    peers, failed = start_peers(case, threads, options)
    start, quiet, disturbed = time.monotonic(), 0, []
    least = 1 if case.heavy or options.quick else 3
    while peers:
        share, trip = one_round(peers, threads, options)
        undisturbed = share <= OTHERS and trip <= (options.round_trip or math.inf)
        if undisturbed or options.force:
            quiet += 1
            for peer in peers:
                peer.rounds.append(peer.latest)
        if not undisturbed:
            disturbed.append({'share': round(share, 3), 'round_trip_ns': trip})
        spent = time.monotonic() - start
        if quiet >= 15 or spent > options.budget and (quiet >= least or len(disturbed) > least + 9):
            break
    results = []
    for peer in peers:
        facts = peer.facts | {'peak_kib': peer.ask('facts')['peak_kib']} | (peer.ask('kernels') if peer.name.startswith('slide') else {})
        ms = statistics.median(peer.rounds) if peer.rounds else None
        results.append({'name': peer.name, 'ms': ms, 'rounds': peer.rounds} | facts)
        peer.stop()
    return {'case': case.name, 'network': case.network, 'size': case.size, 'threads': threads, 'weights': case.weights or 'formula', 'quiet_rounds': quiet,
            'disturbed_rounds': disturbed, 'peers': results + failed}


def show(result):
    print(f'{result["case"]}, {result["threads"]} thread(s), {result["quiet_rounds"]} rounds, {len(result["disturbed_rounds"])} disturbed')
    for p in result['peers']:
        if 'failed' in p:
            print(f'  {p["name"]:16} does not run: {p["failed"][:100]}')
        elif p['ms'] is None:
            print(f'  {p["name"]:16} no undisturbed round')
        else:
            print(f'  {p["name"]:16} {p["ms"]:9.1f} ms  load {p["load_ms"]:7.1f} ms of {len(p["loads_ms"])}  peak {p["peak_kib"] / 1024:7.1f} MiB (start {p["base_kib"] / 1024:5.1f})  '
                  f'max {p["max_error"]:.1e} rms {p["rms_error"]:.1e}')
    sys.stdout.flush()


def json_of(command_line):
    done = subprocess.run(command_line, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout) if done.returncode == 0 else {'failed': f'code {done.returncode}'}


def layering(options):
    """Soft layering alone, which no peer has."""
    results = []
    for threads in options.threads:
        reference = f'{options.out}/layering.reference.safetensors'
        report = json_of([options.slide_bench, 'layering', '--size', '672x1008', '--threads', str(threads), '--runs', '15', '--reference', reference, '--json'])
        results.append(report | {'threads': threads})
        print(f'layering 672x1008, {threads} thread(s): {report.get("ms", math.nan):.1f} ms')
    return results


def whole(options):
    """slide_run from photo to last frame: sixty frames of a photo of 1008x672 as Y4M."""
    import cv2
    photo, film = f'{options.out}/photo_672x1008.png', f'{options.out}/film.y4m'
    cv2.imwrite(photo, cv2.resize(cv2.imread(cases.PHOTOS[1]), (1008, 672), interpolation=cv2.INTER_CUBIC))
    results = []
    for threads in options.threads:
        times, report = [], {}
        for _ in range(2 if options.quick else 4):
            start = time.monotonic()
            report = json_of([options.slide_run, photo, '-o', film, '--threads', str(threads), '--json'])
            times.append(time.monotonic() - start)
        if 'failed' in report:
            results.append({'threads': threads} | report)
            continue
        stages = {s['name']: s['seconds'] for s in report['photos'][0]['stages']}
        results.append({'threads': threads, 'seconds': statistics.median(times[1:]), 'all': times, 'stages': stages,
                        'peak_bytes': report['peak_memory_bytes'], 'frames': 60})
        print(f'slide_run, {threads} thread(s): {results[-1]["seconds"]:.2f} s, {report["peak_memory_bytes"] / 2**20:.0f} MiB')
    if os.path.exists(film):
        os.remove(film)
    return results


def layers(options):
    """Single convolutions beside oneDNN's, if the program could be built."""
    if not os.path.exists(options.onednn):
        return []
    found = [json_of([options.onednn, '--threads', str(t), '--rounds', '5' if options.quick else '31', '--json']) for t in options.threads]
    return [layer for one in found if isinstance(one, list) for layer in one]


def check(options):
    """Our float64 executor against PyTorch's float64, on the networks that take seconds."""
    worst = 0.
    for case in cases.CASES:
        if case.size[0] * case.size[1] > 256 * 384:
            continue
        path = f'{options.out}/{case.name}.reference.safetensors'
        json_of([options.slide_bench, case.network, '--weights', f'{options.out}/{case.weight_name}.weights.safetensors', '--inputs',
                 f'{options.out}/{case.name}.case.safetensors', '--reference', path, '--runs', '1', '--json'])
        ours, theirs = tensors.load(path, 'output.'), tensors.load(f'{options.out}/{case.name}.case.safetensors', 'output.')
        difference = max(float(np.abs(ours[k] - theirs[k]).max() / np.abs(theirs[k]).max()) for k in theirs)
        worst = max(worst, difference)
        print(f'{case.name}: float64 executors differ by {difference:.1e}')
    if worst > 1e-10:
        sys.exit('run.py: the networks are not the same')


def machine(options):
    with open('/proc/cpuinfo') as f:
        model = next((line.split(':')[1].strip() for line in f if line.startswith('model name')), platform.machine())
    return {'cpu': model, 'cores': os.cpu_count(), 'peaks': json_of([options.peak, '--json']), 'date': time.strftime('%Y-%m-%d')}


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', default='out/peers', help='folder of the exported models')
    parser.add_argument('--build', default='build/release', help='folder in whose bin/ the programs are')
    parser.add_argument('--cases', help='comma-separated; default: all')
    parser.add_argument('--peers', help=f'comma-separated, of {", ".join(PEERS + EXTRA_PEERS)}')
    parser.add_argument('--threads', default='2,1', help='comma-separated')
    parser.add_argument('--budget', type=float, help='seconds of rounds for a network at one thread count')
    parser.add_argument('--quick', action='store_true', help='few networks, few rounds, two threads')
    parser.add_argument('--force', action='store_true', help='count rounds that other programs disturbed')
    parser.add_argument('--round-trip', type=float, metavar='NS', help='count only rounds in which a cache line takes no longer from one core to another and back')
    parser.add_argument('--check', action='store_true', help='only compare the float64 executors')
    parser.add_argument('--slide-options', default='', help='more flags for slide_bench, e.g. "--isa avx2"')
    parser.add_argument('--results', help='the JSON file; default: results.json in --out')
    options = parser.parse_args()
    options.peers = options.peers.split(',') if options.peers else list(PEERS)
    options.threads = [2] if options.quick and options.threads == '2,1' else [int(t) for t in options.threads.split(',')]
    options.budget = options.budget or (3 if options.quick else 9)
    options.results = options.results or f'{options.out}/results.json'
    for name, program in (('slide_bench', 'slide_bench'), ('slide_run', 'slide_run'), ('peak', 'peak_benchmark'), ('onednn', 'onednn_conv')):
        setattr(options, name, f'{options.build}/bin/{program}')
    return options


def main():
    options = parse()
    if options.check:
        check(options)
        return
    load = others_share(1)
    if load > OTHERS and not options.force:
        sys.exit(f'run.py: other programs use {100 * load:.0f} % of this machine; wait for them, or give --force')
    chosen = [c for c in cases.CASES if (c.name in options.cases.split(',') if options.cases else c.quick or not options.quick)]
    results = {'machine': machine(options), 'forced': options.force, 'round_trip_ns': options.round_trip, 'networks': []}
    for case in chosen:
        for threads in options.threads:
            if case.heavy and threads != max(options.threads):
                continue
            results['networks'].append(measure(case, threads, options))
            show(results['networks'][-1])
    if not options.cases:
        results |= {'layering': layering(options), 'slide_run': whole(options), 'layers': layers(options)}
    with open(options.results, 'w') as f:
        json.dump(results, f, indent=1)
    print('wrote', options.results)


if __name__ == '__main__':
    main()
