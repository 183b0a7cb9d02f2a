#!/bin/sh
# many_photos.sh: results, nothing done twice, failures tried again, new photos found.
#   many_photos_test.sh SLIDE_RUN WORK      WORK: an own folder, emptied first
set -eu
slide_run=$1 work=$2
root=$(cd "$(dirname "$0")/../.." && pwd)
fail() { echo "many_photos_test.sh: $*" >&2; cat "$work/out/jobs.log" >&2; exit 1; }

rm -rf "$work"
mkdir -p "$work/my photos"
cp "$root/tests/data/images/rgb_8.png" "$work/my photos/b it's.png"
cp "$root/tests/data/images/rgb_8.png" "$work/my photos/c.PNG"
echo "no photo" >"$work/my photos/d.jpg"
echo "no photo" >"$work/my photos/._c.PNG" # what macOS leaves on other systems' disks

# A program that notes each of its calls.
cat >"$work/noting" <<END
#!/bin/sh
echo call >>"$work/calls"
exec "$slide_run" "\$@"
END
chmod +x "$work/noting"
run() {
  : >"$work/calls"
  code=0
  "$root/examples/many_photos.sh" -j 2 -p "$work/noting" "$@" "$work/my photos" "$work/out" -- --depth-weights formula \
    --depth-model slide_depth --inpaint-weights formula --inpaint-model inpaint_coarse --frames 2 2>"$work/errors" || code=$?
  calls=$(wc -l <"$work/calls")
}
expect() { [ "$code" = "$1" ] && [ "$calls" = "$2" ] || fail "$3: exit code $code instead of $1, $calls calls instead of $2"; }

run
expect 1 3 "three photos, one bad"
[ -s "$work/out/b it's.png.html" ] && [ -s "$work/out/c.PNG.html" ] || fail "a result is missing"
[ ! -e "$work/out/d.jpg.html" ] || fail "a bad photo has a result"
grep -q "d.jpg" "$work/errors" || fail "the bad photo was not named"

run
expect 1 1 "only the failed one is tried again"
cp "$root/tests/data/images/rgb_8.png" "$work/my photos/d.jpg"
run
expect 0 1 "the failed one is good now"
run
expect 0 0 "nothing is left to do"

cp "$root/tests/data/images/rgb_8.png" "$work/my photos/a.png" # sorts before all others
run
expect 0 1 "a new photo"
[ -s "$work/out/a.png.html" ] || fail "the new photo has no result"
[ "$(find "$work/out" -name '*.html' | wc -l)" = 4 ] || fail "there are not four results"

run -S 1/:
expect 2 0 "this machine is not called : there"
code=0
"$root/examples/many_photos.sh" "$work/none" "$work/out" 2>/dev/null || code=$?
[ "$code" = 2 ] || fail "a missing folder is a usage error, not $code"

# Another machine: its ssh runs what it is told here, in a folder of its own.
command -v rsync >/dev/null || { echo "no rsync: several machines were not tested"; exit 0; }
mkdir -p "$work/bin" "$work/home"
cat >"$work/bin/ssh" <<END
#!/bin/sh
while case \$1 in -l | -p | -o | -S) shift 2 ;; -*) shift ;; *) false ;; esac; do :; done
shift
[ "\$1" != -- ] || shift
cd "$work/home"
export HOME="$work/home"
exec bash -c "\$*"
END
chmod +x "$work/bin/ssh"
PATH=$work/bin:$PATH
mkdir "$work/here"
mv "$work/out"/*.html "$work/here"
rm -r "$work/out"
unset SHELL # as in a container
run -S 2/another
expect 0 4 "four photos on another machine"
for page in "$work/here"/*.html; do
  cmp "$page" "$work/out/$(basename "$page")" || fail "another machine made another page"
done
[ "$(find "$work/home" -type f ! -path '*/.parallel/semaphores/*' | grep -c -e png -e html)" = 0 ] || fail "files were left on the other machine"
