#!/bin/sh
# Installs the Debian packages that are missing, and does nothing (in well under a second) when none is. Where there is no
# apt-get it says what has to be there, and leaves the rest to CMake.
#   install_packages.sh build           to build and run
#   install_packages.sh build test ci   also to run all tests, and everything .ci/run does
set -eu

build="g++ cmake ninja-build libopenimageio-dev libopenexr-dev libjpeg62-turbo-dev libpng-dev zlib1g-dev
  libglm-dev nlohmann-json3-dev libcli11-dev"
test="doctest-dev"
ci="ccache clang-14 libomp-14-dev libclang-rt-14-dev clang-format-14 clang-tidy-14 libbenchmark-dev nodejs npm chromium
  ffmpeg groff-base parallel python3-numpy rsync pkg-config qemu-user-static g++-aarch64-linux-gnu libjpeg62-turbo-dev:arm64 libpng-dev:arm64
  zlib1g-dev:arm64"

if ! command -v apt-get >/dev/null 2>&1 || ! command -v dpkg-query >/dev/null 2>&1; then
  echo "No Debian packages here. Needed are a compiler of C++20 (g++ 12, clang 14), CMake 3.22, Ninja, OpenImageIO, OpenEXR," \
    "libjpeg-turbo, libpng, zlib, GLM, nlohmann-json, CLI11, and for the tests doctest, with their headers." >&2
  exit 0
fi

wanted=""
for set in "$@"; do
  case "$set" in
    build) wanted="$wanted $build" ;;
    test) wanted="$wanted $test" ;;
    ci) wanted="$wanted $ci" ;;
    *) echo "install_packages.sh: unknown set '$set' (build, test, ci)" >&2; exit 2 ;;
  esac
done

installed() {
  case "$1" in
    # Provided by the distribution or otherwise: the program itself is what counts.
    nodejs) command -v node >/dev/null 2>&1 ;;
    npm) command -v npm >/dev/null 2>&1 ;;
    *) dpkg-query -W -f '${Status}\n' "$1" 2>/dev/null | grep -q '^install ok installed$' ;;
  esac
}

missing=""
for package in $wanted; do
  installed "$package" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

as_root=""
if [ "$(id -u)" != 0 ]; then
  command -v sudo >/dev/null 2>&1 || { echo "Run as root, or install sudo: these packages are missing:$missing" >&2; exit 1; }
  as_root="sudo"
fi
echo "Installing:$missing"
case "$missing" in
  *:arm64*) $as_root dpkg --add-architecture arm64 ;;
esac
$as_root apt-get update -qq
# shellcheck disable=SC2086  # a list of words
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
