#!/bin/sh
# Measures SLIDE beside ONNX Runtime, OpenCV and PyTorch on this machine. See README.md.
#   benchmarks/peers/run.sh [--prepare] [flags of run.py: --quick, --cases, --peers, --threads, --force]
# --prepare builds, installs and exports what is missing, and measures nothing.
set -eu
cd "$(dirname "$0")/../.."
out=${OUT:-out/peers}
build=${BUILD:-build/release}

mkdir -p "$out/node"
cmake -S . -B "$build" -DCMAKE_BUILD_TYPE=Release -DSLIDE_BENCHMARKS=ON >/dev/null
cmake --build "$build" --target slide_bench slide_convert slide_run peak_benchmark -j2 >"$out/build.log" 2>&1 || { cat "$out/build.log" >&2; exit 1; }
if [ -e /usr/include/dnnl.hpp ]; then
  cmake --build "$build" --target onednn_conv -j2 >>"$out/build.log" 2>&1
fi
if [ ! -d "$out/node/node_modules/onnxruntime-node" ]; then
  # The package holds the library for CPUs; its install script would fetch one for GPUs.
  (cd "$out/node" && npm install --silent --no-audit --no-fund --ignore-scripts onnxruntime-node@1.30.0)
fi
/usr/bin/python3 benchmarks/peers/export_onnx.py "$out"
/usr/bin/python3 benchmarks/peers/quantise.py "$out"
/usr/bin/python3 benchmarks/peers/calibrate.py "$out" "$build"
[ "${1:-}" = --prepare ] && exit 0
/usr/bin/python3 benchmarks/peers/run.py --out "$out" --build "$build" "$@"
