#!/usr/bin/env bash
# Measure a GPU in six minutes: orders of triangles, the cost of a triangle, shading, samples.
#
#   scripts/gpu.sh prepare OUT    on any machine: exact counters of the reference, and the times that
#                                 docs/studies/gpu.md predicts from them
#   scripts/gpu.sh plan           print the steps and their seconds
#   scripts/gpu.sh measure OUT [STEP ...]   on the machine with the GPU; all steps, or the named ones
#   scripts/gpu.sh judge OUT      afterwards, on any machine: equality of counters, and the tables of
#                                 docs/studies/gpu.md
#
# DEVICE=name   another device than the best one; see: .venv/bin/python -m harness list rasterisers
# PYTHON=path   another Python than that of .venv, with the packages of requirements.lock
# SECONDS_LIMIT=n  end after so many seconds (540); the steps come in the order of their importance
# RASTER_HARNESS_CACHE=file  triangulations; `prepare` stores them there, and a copy of the file saves
#               their computation on the machine with the GPU
# QUICK=yes     a small scene and short measurements, as a rehearsal on a software device
#
# A failed step does not stop the others; the last line lists the failed steps. Complete steps are
# not repeated, so the same call resumes an interrupted one.
set -uo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-.venv/bin/python}
export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"
harness=("$python" -m harness)

peers=ear-clipping,earcut-refine,flips:l1,delaunay,refined,optimal:overdraw,optimal:half-perimeter
peers+=,optimal:expected-quads,worst:half-perimeter
# Without optima, which take minutes for the parts of cad.
quick_peers=ear-clipping,earcut-refine,flips:l1,delaunay,refined
orders=native,walk,vertex-cache,shuffled
if [ "${QUICK:-}" = yes ]; then
    scenes=(city:buildings=40 glyphs:limit=8) sizes=64,256 size=256 budget=0.02 profiled=0.02
    compared=(-k footprints) share=0.001 factor=4
else
    scenes=(city glyphs cad) sizes=256,1024,4096 size=1024 budget=0.25 profiled=0.2
    compared=() share=0.1 factor=2
fi
few=("${scenes[@]:0:2}")

# Steps: name, seconds (measured on an H200, or planned), file that is written last.
steps=(
    "doctor 6 doctor.txt"
    "orders-${scenes[0]%%:*} 35 orders-${scenes[0]%%:*}/summary.csv"
    "orders-${scenes[1]%%:*} 45 orders-${scenes[1]%%:*}/summary.csv"
    "profile 80 profile.json"
    "work-${few[0]%%:*} 16 work-${few[0]%%:*}/summary.csv"
    "again 14 again/summary.csv"
    "work-${few[1]%%:*} 25 work-${few[1]%%:*}/summary.csv"
    "texture 16 texture/summary.csv"
    "samples 12 samples/summary.csv"
    ${scenes[2]:+"orders-cad 45 orders-cad/summary.csv"}
    "optimum 30 optimum.json"
    "webgpu 15 webgpu/summary.csv"
)
# An independent measurement of triangles per second: `draw-prim-rate` of piglit, if it is installed.
command -v draw-prim-rate > /dev/null && steps+=("piglit 10 draw-prim-rate.txt")

# One run of the scenes' triangulators; further arguments select a rasteriser and options.
run_scene() { # folder, scene, sizes, seconds of each case, further arguments
    local triangulators=$peers
    [ "$2" = cad ] && triangulators=$quick_peers
    "${harness[@]}" run --scene "$2" --resolution "$3" --triangulators $triangulators \
        --budget "$4" --quiet --no-report --out "$to/$1" "${@:5}"
}

doctor() {
    { "${harness[@]}" doctor; nvidia-smi; } 2>&1 | tee "$to/doctor.part"
    mv "$to/doctor.part" "$to/doctor.txt"
}

perform() { # name of a step
    case "$1" in
        doctor) doctor ;;
        profile) "${harness[@]}" profile --device "$device" --budget $profiled --quiet \
            --out "$to/profile.json" ;;
        orders-*) run_scene "$1" "$(scene_of "$1")" $sizes $budget --device "$device" --order $orders ;;
        work-*) run_scene "$1" "$(scene_of "$1")" $sizes "$(half $budget)" --device "$device" \
            --work 16,64 ;;
        samples) run_scene samples "${scenes[0]}" $sizes "$(half $budget)" --device "$device" \
            --samples 4 ;;
        texture) run_scene texture "${scenes[0]}" $sizes "$(half $budget)" --device "$device" \
            --texture 1,4 ;;
        # A second measurement of a tenth of the cases: the scatter of the measurement itself.
        again) run_scene again "${scenes[0]}" $size $budget --device "$device" --order $orders ;;
        webgpu) run_scene webgpu "${scenes[0]}" $sizes "$(half $budget)" --device "$device" \
            --rasterisers webgpu ;;
        piglit) timeout 8 draw-prim-rate -auto -fbo > "$to/draw-prim-rate.txt"; true ;;
        optimum) DEVICE="$device" ENDURANCE=$share "$python" -m pytest -q -p no:cacheprovider \
            tests/benchmarks/test_gpu.py "${compared[@]}" --benchmark-enable -s \
            --benchmark-json="$to/optimum.json" ;;
    esac
}

scene_of() { # step
    local scene
    for scene in "${scenes[@]}"; do [ "${1#*-}" = "${scene%%:*}" ] && echo "$scene"; done
}

half() { "$python" -c "print($1 / 2)"; }

remaining() { echo $((${SECONDS_LIMIT:-540} - SECONDS)); }

plan() {
    local step total=0
    for step in "${steps[@]}"; do
        read -r name seconds result <<< "$step"
        printf '%-14s %4d s   %s\n' "$name" "$seconds" "$result"
        total=$((total + seconds))
    done
    printf '%-14s %4d s\n' "all" "$total"
}

measure() {
    local step failed=() bound code begun
    device=${DEVICE:-$("$python" -c \
        'from harness.rasterisers import find_device; print(find_device("opengl").name)')} || exit 3
    mkdir -p "$to"
    for step in "${steps[@]}"; do
        read -r name seconds result <<< "$step"
        [ $# -eq 0 ] || [[ " $* " == *" $name "* ]] || continue
        [ -e "$to/$result" ] && { printf '%s: already complete\n' "$name"; continue; }
        bound=$((factor * seconds))
        [ "$bound" -gt "$(remaining)" ] && bound=$(remaining)
        [ "$bound" -gt 5 ] || { failed+=("$name (no time left)"); continue; }
        printf '\n== %s %s, at most %d s\n' "$name" "$(date +%T)" "$bound"
        begun=$SECONDS
        # Remove the output of an interrupted step.
        [[ "$result" != */* ]] || rm -rf "${to:?}/${result%/*}"
        # A subshell of this script, so that `timeout` ends the step and all of its processes.
        timeout --signal INT --kill-after 5 "$bound" bash "$0" step "$name" "$to" "$device"
        code=$?
        [ $code -eq 0 ] || failed+=("$name (exit code $code)")
        printf -- '-- %s: %d of %d s\n' "$name" $((SECONDS - begun)) "$seconds"
    done
    if [ ${#failed[@]} -gt 0 ]; then
        printf '\nfailed: %s\n' "$(IFS=,; echo "${failed[*]}")"
        exit 1
    fi
    printf '\nall done: %s\n' "$to"
}

# Counters of the CPU reference, and of llvmpipe, whose index lists have vertex batches.
prepare() {
    local scene
    mkdir -p "$to"
    for scene in "${scenes[@]}"; do
        [ -e "$to/reference-${scene%%:*}/summary.csv" ] || run_scene "reference-${scene%%:*}" \
            "$scene" $sizes 0.001 --rasterisers reference,opengl --device llvmpipe --precision 1 \
            --order $orders || exit
    done
    "$python" scripts/studies/gpu.py predict "$to"
}

command=${1:-}
case "$command" in
    plan) plan ;;
    step) to=$3 device=$4; perform "$2" ;;
    prepare | measure) to=${2:?folder}; $command "${@:3}" ;;
    judge) "$python" scripts/studies/gpu.py judge "${2:?folder}" ;;
    *) sed -n '2,22s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac
