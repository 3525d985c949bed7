#!/usr/bin/env bash
# Measure the best device of this machine, in about ten minutes: the costs of a triangle (profile),
# the state of the installation, equality of counters with the exact reference, the accuracy of
# criteria, the gain from the choice of a triangulator, and the speed of optimal triangulation in
# compute shaders.
#
#   scripts/gpu.sh [OUT]      OUT: output folder, by default results/reference/<device>
#
# DEVICE=name  another device than the best one; see: .venv/bin/python -m harness list rasterisers
# PYTHON=path  another Python than that of .venv, with the packages of requirements.lock
# QUICK=yes    short measurements, to check that everything works
#
# A failed step does not stop the others; the last line lists the failed steps. Complete results are
# retained, so the same call resumes an interrupted one.
set -uo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-.venv/bin/python}
export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"

device=${DEVICE:-$("$python" -c \
    'from harness.rasterisers import find_device; print(find_device("opengl").name)')} || exit 3
to=${1:-results/reference/$device}
mkdir -p "$to"
if [ "${QUICK:-}" = yes ]; then
    scenes="city:buildings=40" sizes=256 budget=0.05 profiled=0.05 study=(--quick)
    compared=(-k footprints) often=0.001
else
    scenes="city glyphs cad" sizes=256,1024,4096 budget=0.5 profiled=0.5 study=(--budget 0.05)
    compared=() often=0.1
fi
peers=ear-clipping,delaunay,refined,optimal:overdraw,optimal:half-perimeter,optimal:expected-quads
peers+=,worst:half-perimeter
failed=()

step() { # name, file that the command writes, command
    local name=$1 result=$2
    shift 2
    [ -e "$result" ] && { printf '%s: already complete\n' "$name"; return; }
    printf '\n== %s %s\n' "$name" "$(date +%T)"
    # Remove the output of an interrupted step.
    [ "$(dirname "$result")" = "$to" ] || rm -rf "$(dirname "$result")"
    "$@" || failed+=("$name")
}

doctor() {
    { "$python" -m harness doctor; nvidia-smi 2>/dev/null; true; } | tee "$to/doctor.txt"
}

# Draw a scene on the device and on the reference, and list the counters that differ.
equality() {
    "$python" -m harness run --scene "$1" --device "$device" --rasterisers opengl,reference \
        --resolution "$sizes" --triangulators $peers --budget 0.001 --precision 1 --quiet \
        --out "$to/equality-${1%%:*}" || return
    "$python" - "$to/equality-${1%%:*}/summary.csv" <<'PY'
import sys

import pandas as pd

table = pd.read_csv(sys.argv[1])
parts = {name: part for name, part in table.groupby("rasteriser")}
by = ["triangulator", "resolution"]
both = parts["opengl"].merge(parts["reference"], on=by, suffixes=("", " of the reference"))
names = [c for c in ("fragments", "quads", "helper_lanes") if both[c].notna().all()]
wrong = [n for n in names if (both[n] != both[f"{n} of the reference"]).any()]
print(f"{len(both)} cases, {', '.join(names) or 'no counter'} compared: ", end="")
print(f"{', '.join(wrong)} differ" if wrong else "all equal")
for name in wrong:
    print(both[[*by, name, f"{name} of the reference"]].to_string(index=False))
sys.exit(bool(wrong) or not names)
PY
}

# Compare the optimal triangulations of the device's compute shaders with those of the CPU.
optimum() {
    DEVICE="$device" ENDURANCE=$often "$python" -m pytest -q tests/endurance/test_device.py \
        "${compared[@]}" | tee "$to/optimum.part"
    local code=$?
    mv "$to/optimum.part" "$to/optimum-equality.txt"
    return $code
}

step profile "$to/profile.json" \
    "$python" -m harness profile --device "$device" --budget $profiled --quiet --out "$to/profile.json"
step doctor "$to/doctor.txt" doctor
# The most important steps come first, because a machine may be available for minutes only.
for scene in $scenes; do
    step "gains $scene" "$to/gains-${scene%%:*}/summary.csv" \
        "$python" -m harness run --scene "$scene" --device "$device" --resolution "$sizes" \
        --triangulators $peers --budget $budget --quiet --out "$to/gains-${scene%%:*}"
    step "equality $scene" "$to/equality-${scene%%:*}/summary.csv" equality "$scene"
    [ "$scene" = "${scenes%% *}" ] || continue
    step validate "$to/validate-city/correlations.csv" \
        "$python" -m harness study validate --scene city --resolution 512 --device "$device" \
        --rasterisers opengl,bounding-box "${study[@]}" --quiet --out "$to/validate-city"
done
# H-optimal triangulation in compute shaders: equality with the CPU, and polygons per second.
step "optimum, equality" "$to/optimum-equality.txt" optimum
step optimum "$to/optimum.json" \
    env DEVICE="$device" "$python" -m pytest tests/benchmarks/test_gpu.py --benchmark-enable -s -q \
    --benchmark-json="$to/optimum.json"
# The same GPU through WebGPU, if wgpu is installed.
if "$python" -c 'import wgpu' 2>/dev/null; then
    step webgpu "$to/webgpu-city/summary.csv" \
        "$python" -m harness run --scene "${scenes%% *}" --device "$device" --resolution "$sizes" \
        --rasterisers webgpu --triangulators $peers --budget $budget --quiet --out "$to/webgpu-city"
fi
# The summary that docs/devices.md includes once it is in results/devices.
first=${scenes%% *}
step summary "$to/$device.json" \
    "$python" -m harness import "$to/gains-${first%%:*}" --summary "$to/$device.json"
step "gains over all" "$to/gains/gains.csv" \
    "$python" -m harness study gains "$to"/gains-*/ --out "$to/gains"

if [ ${#failed[@]} -gt 0 ]; then
    printf '\nfailed: %s\n' "$(IFS=,; echo "${failed[*]}")"
    exit 1
fi
printf '\nall done: %s\n' "$to"
printf 'to contribute: cp %s results/devices/, then make documents\n' "$to/$device.json"
