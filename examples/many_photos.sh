#!/bin/sh
# Turns a folder of photos into 3D photos, many at once, on one machine or on several, with GNU parallel. May be stopped
# and started again: what is done is not done again, what failed is tried again. docs/many_photos.md tells more.
#
#   many_photos.sh [-j JOBS] [-S HOSTS] [-p PROGRAM] PHOTOS OUT [-- OPTIONS OF slide_run...]
#
#   -j JOBS     photos at once on each machine; default: one a core (each takes one thread)
#   -S HOSTS    machines by ssh, as GNU parallel's --sshlogin has it: 'anna,4/bert'; this one is localhost
#   -p PROGRAM  slide_run, here and on every machine; default: slide_run
#
# PHOTOS/cat.jpg becomes OUT/cat.jpg.html. OUT also holds photos.list (the order of the photos) and jobs.log.
# Exit code: 0 all done, 1 some failed (run it again to retry them), 2 usage.
set -eu

usage() {
  sed -n '5,9p' "$0" | cut -c3- >&2
  exit 2
}

jobs=100%
hosts=""
program=slide_run
while getopts j:S:p: option; do
  case $option in
    j) jobs=$OPTARG ;;
    S) hosts=$OPTARG ;;
    p) program=$OPTARG ;;
    *) usage ;;
  esac
done
shift $((OPTIND - 1))
[ $# -ge 2 ] || usage
[ -d "$1" ] || { echo "many_photos.sh: $1 is no folder" >&2; exit 2; }
photos=$(cd "$1" && pwd)
case ",$hosts," in
  *,:,* | */:,*) echo "many_photos.sh: in -S this machine is localhost (it must let you in by ssh), not :" >&2; exit 2 ;;
esac
mkdir -p "$2"
out=$(cd "$2" && pwd)
shift 2
[ $# = 0 ] || { [ "$1" = -- ] && shift; } || usage
command -v parallel >/dev/null || { echo "many_photos.sh: GNU parallel is missing (Debian: apt install parallel)" >&2; exit 2; }

# GNU parallel knows jobs by their number. New photos therefore go to the end of the list, whatever their names are.
cd "$out"
touch photos.list
find "$photos" -maxdepth 1 -type f ! -name '*
*' ! -name '._*' \( -iname '*.jpg' -o -iname '*.jpeg' -o -iname '*.jfif' -o -iname '*.png' -o -iname '*.tif' \
  -o -iname '*.tiff' -o -iname '*.webp' -o -iname '*.bmp' -o -iname '*.exr' -o -iname '*.heic' -o -iname '*.heif' \
  -o -iname '*.avif' \) -exec basename -a -- {} + | sort | grep -vxFf photos.list >photos.new || true
cat photos.new >>photos.list
rm photos.new
[ -s photos.list ] || { echo "many_photos.sh: no photo in $photos" >&2; exit 2; }

# Where no SHELL is set (containers, services), GNU parallel guesses one from its parents, and can guess none that works.
export SHELL="${SHELL:-/bin/sh}"

# On other machines the photo is sent to a temporary folder, the result comes back, and the folder is removed.
if [ -n "$hosts" ]; then
  # GNU parallel quotes names for rsync as rsync wanted it before version 3.2.4.
  export RSYNC_OLD_ARGS=1
  # What follows /./ is the file's name there.
  set -- --sshlogin "$hosts" --workdir ... --transferfile "$photos/./{}" --return './{}.html' --cleanup \
    "$program" --threads 1 --quiet './{}' -o './{}.html' "$@"
else
  set -- "$program" --threads 1 --quiet "$photos/{}" -o './{}.html' "$@"
fi

failed=0
parallel --quote --jobs "$jobs" --joblog jobs.log --resume-failed "$@" <photos.list || failed=$?
[ "$failed" = 0 ] || { echo "many_photos.sh: some photos failed (column Exitval of $out/jobs.log); run it again to retry them" >&2; exit 1; }
