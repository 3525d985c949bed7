#!/usr/bin/env bash
# Runs `make test` in fresh clones of HEAD, each with an environment and a cache of its own, and
# prints one line a clone: what came out, and the seconds of set-up and of the tests.
# usage: scripts/fresh.sh [CLONES]   logs of failures are kept and named
set -euo pipefail
cd "$(dirname "$0")/.."

clones=${1:-10}
commit=$(git rev-parse HEAD)
place=$(mktemp -d "${TMPDIR:-/tmp}/fresh.XXXXXX")
# Data that may lie beside the checkout lie beside the clones, too.
[ ! -d ../shared ] || ln -s "$(cd ../shared && pwd)" "$place/shared"
# What this shell sets must not make a clone slower, or other, than a user's.
unset PYTHONDONTWRITEBYTECODE PYTHONPATH VIRTUAL_ENV

failed=0
for number in $(seq "$clones"); do
    clone=$place/clone-$number log=$place/clone-$number.log
    git clone -q --no-local . "$clone"
    git -C "$clone" checkout -q "$commit"
    export XDG_CACHE_HOME=$place/cache-$number
    start=$(date +%s)
    result=passed
    (cd "$clone" && ./scripts/setup.sh test) >"$log" 2>&1 || result="set-up failed"
    ready=$(date +%s)
    if [ "$result" = passed ]; then
        make -C "$clone" test >>"$log" 2>&1 || result=FAILED
    fi
    end=$(date +%s)
    summary=$(grep -E '^[0-9]+ (passed|failed)' "$log" | tail -1 || true)
    printf '%3d  %-13s  set-up %4d s  tests %4d s  %s\n' \
        "$number" "$result" $((ready - start)) $((end - ready)) "$summary"
    rm -rf "$clone" "$XDG_CACHE_HOME"
    if [ "$result" = passed ]; then rm "$log"; else
        failed=$((failed + 1))
        printf '     see %s\n' "$log"
    fi
done
[ "$failed" -gt 0 ] || rm -rf "$place"
printf '%d of %d clones of %s passed\n' $((clones - failed)) "$clones" "${commit:0:10}"
[ "$failed" = 0 ]
