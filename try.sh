#!/bin/sh
# Installs what is missing, builds, and turns a photo into a 3D photo. May be run again and again.
#   ./try.sh              the cat in examples/photos
#   ./try.sh photo.jpg    your own
set -eu
cd "$(dirname "$0")"
cmake/install_packages.sh build
cmake --preset release -DSLIDE_TESTS=OFF >/dev/null
cmake --build --preset release --target slide_run slide_convert slide_check
photo="${1:-examples/photos/chelsea.png}"
mkdir -p out
build/release/bin/slide_run "$photo" -o 'out/{}.html' -o 'out/{}.gif' -o 'out/{}.glb' --explain
echo "Look: out/ holds the 3D photo as a web page, an animation and a 3D model."
