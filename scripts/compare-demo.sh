#!/usr/bin/env bash
# Plays through what CI does: a first run without a baseline, a change that changes nothing, and
# one that makes a user's triangulator worse. Ends with 0 if each is judged as it should be.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-results/compare-demo}
rm -rf "$out"
mkdir -p "$out/project"
out=$(cd "$out" && pwd)
cd "$out/project"

triangulator() {
    cat > mine.py <<PY
from triangulators import triangulate


def cut(polygon):
    return triangulate(polygon, "$1")
PY
}

# Busy machines make times inconclusive, which is no failure of this demonstration.
judge() {
    local expected=$1 code=0
    printf '\n== %s\n' "$2"
    shift 2
    "$@" "$here/ci-compare.sh" ../baseline .. --allow-inconclusive -- --scene city --quick \
        --triangulators fan,delaunay,optimal:half-perimeter,mine:cut || code=$?
    if [ "$code" != "$expected" ]; then
        printf 'expected exit code %s, got %s\n' "$expected" "$code" >&2
        exit 1
    fi
}

triangulator ear-clipping
judge 0 "the first run: no baseline yet; its run is kept as one" env KEEP=yes
judge 0 "the same code again" env
triangulator worst:overdraw
judge 1 "mine:cut is now the worst triangulation under its old name" env
printf '\nreports: %s\n' "$out/compare.html $out/compare.md"
