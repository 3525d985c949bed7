#!/usr/bin/env bash
# The studies behind docs/findings.md, each into results/reference/. Half an hour and a quiet
# machine; a study that is there already is kept, so an interrupted call goes on where it was.
set -euo pipefail
cd "$(dirname "$0")/.."
harness=(.venv/bin/python -m harness)
to=results/reference

once() { # folder, then the command that makes it
    [ -e "$1/correlations.csv" ] || [ -e "$1/summary.csv" ] && return
    printf '\n== %s\n' "$1"
    rm -rf "$1"
    "${@:2}" --out "$1" --quiet
}

[ -e results/calibration/llvmpipe.json ] ||
    "${harness[@]}" calibrate --device llvmpipe --resolution 256 --budget 0.4 --quiet

# Does a criterion predict what was measured?
once $to/llvmpipe/validate-city "${harness[@]}" validate --scene city --resolution 512 \
    --rasterisers opengl,bounding-box,scanline --device llvmpipe
once $to/zink/validate-city "${harness[@]}" validate --scene city --resolution 512 \
    --rasterisers opengl,bounding-box --device zink
once $to/softpipe/validate-city "${harness[@]}" validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers opengl --device softpipe
once $to/osmesa/validate-city "${harness[@]}" validate --scene city --resolution 512 \
    --polygons 12 --rasterisers osmesa
once $to/llvmpipe/validate-paper "${harness[@]}" validate --scene paper --resolution 512 \
    --rasterisers opengl,bounding-box,scanline --device llvmpipe

# What does the choice buy?
peers=ear-clipping,delaunay,sweep,greedy,optimal:overdraw,optimal:half-perimeter,optimal:calibrated
for scene in city helsinki counties glyphs; do
    once $to/llvmpipe/gains-$scene "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 256,512,1024,2048 --triangulators $peers --budget 1
done
once $to/llvmpipe/gains-rotation "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 512 --fit circle --budget 0.4 \
    --rotation 0,5,10,15,20,25,30,35,40,45,50,55,60,65,70,75,80,85,90 --triangulators \
    ear-clipping,delaunay,optimal:overdraw,optimal:overdraw@0,optimal:half-perimeter,optimal:half-perimeter@0,optimal:edge-length
once $to/llvmpipe/gains-work "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 1024 --work 0,1,4,16,64 --samples 1,4 --triangulators $peers --budget 0.5
"${harness[@]}" gains $to/llvmpipe/gains-* --out $to/llvmpipe/gains
