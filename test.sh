#!/bin/sh
# Runs all tests of the release build. Installs what is missing first; may be run again and again.
set -eu
cd "$(dirname "$0")"
cmake/install_packages.sh build test
cmake --preset release -DSLIDE_TESTS=ON ${SLIDE_CMAKE_FLAGS:-} >/dev/null
cmake --build --preset release
ctest --preset release "$@"
