#!/bin/sh
# Installs a build and uses it as others do: the programs, the CMake package, pkg-config.
#   package_test.sh BUILD WORK CMAKE CC CXX STATIC
# BUILD: a complete build; WORK: an own folder, emptied first; STATIC: ON if everything is linked statically
set -eu
build=$1 work=$2 cmake=$3 cc=$4 cxx=$5 static=$6
source=$(cd "$(dirname "$0")" && pwd)
fail() { echo "package_test.sh: $*" >&2; exit 1; }

rm -rf "$work"
mkdir -p "$work"
"$cmake" --install "$build" --prefix "$work/first" >/dev/null
mv "$work/first" "$work/prefix"  # a package that was moved after its installation works as well
prefix=$work/prefix

for file in bin/slide_check bin/slide_convert share/man/man1/slide_run.1 share/man/man1/slide_check.1 \
  share/man/man1/slide_convert.1 share/bash-completion/completions/slide_run \
  share/bash-completion/completions/slide_check share/bash-completion/completions/slide_convert include/slide/slide.h; do
  [ -s "$prefix/$file" ] || fail "$file was not installed"
done
for text in LICENSE NOTICE weights.md; do
  find "$prefix/share/doc" -name "$text" | grep -q . || fail "$text was not installed"
done
"$prefix/bin/slide_run" --version | grep -q slide_run
if grep -rlF "$(cd "$source/../.." && pwd)" "$prefix" --include='*.cmake' --include='*.pc' --include='*.h'; then
  fail "these files name folders of the build"
fi

"$cmake" -S "$source" -B "$work/user" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_C_COMPILER="$cc" \
  -DCMAKE_CXX_COMPILER="$cxx" -DSTATIC="$static" >/dev/null
"$cmake" --build "$work/user" >/dev/null
"$work/user/use_c" "$work/page.html"
[ -s "$work/page.html" ] || fail "the example in C wrote no page"
"$work/user/use_cpp"

# The shared library, where it was built: its soname, nothing but the C API in sight, and a program in C.
shared=$(find "$prefix" -name libslide.so)
if [ -n "$shared" ]; then
  readelf -d "$shared" | grep -q 'SONAME.*\[libslide.so.0.2\]' || fail "libslide.so has another soname"
  if nm -D --defined-only "$shared" | grep -vE ' (T slide_[a-z_]+@@SLIDE_0\.2|A SLIDE_0\.2)$'; then
    fail "libslide.so shows more than its C API"
  fi
  "$work/user/use_shared" "$work/shared.html"
  cmp "$work/page.html" "$work/shared.html" || fail "the shared library wrote another page"
fi

if command -v dpkg-deb >/dev/null && command -v dpkg-shlibdeps >/dev/null; then
  (cd "$work" && "$(dirname "$cmake")/cpack" -G DEB --config "$build/CPackConfig.cmake" -B "$work/deb" >/dev/null) ||
    fail "cpack made no package"
  programs=$(find "$work/deb" -maxdepth 1 -name 'slide_*.deb')
  dpkg-deb -c "$programs" | grep -q ' ./usr/bin/slide_run$' || fail "slide's package has no usr/bin/slide_run"
  dpkg-deb -c "$(find "$work/deb" -maxdepth 1 -name 'slide-dev_*.deb')" | grep -q '/slide/slide.h$' ||
    fail "slide-dev's package has no slide.h"
fi

command -v pkg-config >/dev/null || { echo "no pkg-config: that part was left out"; exit 0; }
PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name slide.pc)")
export PKG_CONFIG_PATH
link=""
[ "$static" = OFF ] || link=-static
# Where both libraries are installed, the linker takes the shared one, which is in no folder of the system's here.
[ -z "$shared" ] || link="-Wl,-rpath,$(dirname "$shared")"
# shellcheck disable=SC2046,SC2086  # lists of words
"$cc" $(pkg-config --cflags slide) "$source/use.c" -o "$work/use_pkg_config" $link $(pkg-config --static --libs slide)
"$work/use_pkg_config" "$work/pkg_config.html"
cmp "$work/page.html" "$work/pkg_config.html" || fail "the same program wrote another page"

# The examples, as they say that they are compiled.
for example in example camera_stream; do
  # shellcheck disable=SC2046,SC2086  # lists of words
  "$cc" "$source/../../examples/c_api/$example.c" $(pkg-config --cflags slide) $link $(pkg-config --static --libs slide) \
    -o "$work/c_$example"
done
"$work/c_camera_stream" 2 32 24 | grep -q 'frame  1:.*prepared before' || fail "the second frame was prepared anew"
if [ -n "$shared" ]; then
  # shellcheck disable=SC2046,SC2086  # lists of words
  "$cc" "$source/use.c" $(pkg-config --cflags --libs slide) $link -o "$work/use_shared"
  "$work/use_shared" "$work/pkg_config_shared.html"
  readelf -d "$work/use_shared" | grep -q 'NEEDED.*libslide.so.0.2' || fail "pkg-config --libs does not take libslide.so"
fi
