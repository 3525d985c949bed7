#!/usr/bin/env bash
# Run the studies behind docs/findings.md into results/reference/<device>/. They take more than an
# hour on a quiet machine; complete studies are retained, so the same call resumes an interrupted
# one. `scripts/study.sh gains` runs only the studies with "gains" in the name of their folder.
# `scripts/study.sh "" FOLDER` writes to FOLDER, so that the working tree stays clean. Timed studies
# come first; the last three parts only count and do not need a quiet machine.
set -euo pipefail
cd "$(dirname "$0")/.."
python=(.venv/bin/python)
harness=("${python[@]}" -m harness)
only=${1:-}
to=${2:-results/reference}

once() { # folder, command that writes it
    [[ "$1" == *"$only"* ]] || return 0
    [ -e "$1/correlations.csv" ] || [ -e "$1/summary.csv" ] || [ -e "$1/pareto.csv" ] && return
    printf "\n== %s %s\n" "$1" "$(date +%T)"
    rm -rf "$1"
    "${@:2}" --out "$1" --quiet
    [[ "$1" != */regret-* ]] || "${python[@]}" scripts/studies/trim_regret.py "$1"
}

few() { # scene, polygons: fewer for counties, which have hundreds of vertices
    if [ "$1" = counties ]; then echo 8; else echo "$2"; fi
}
many() { # scene: more where one of few polygons would dominate
    case "$1" in counties) echo 8 ;; glyphs) echo 24 ;; *) echo 96 ;; esac
}

# The profile with the coefficients for optimal:calibrated.
profile=results/reference/profiles/opengl-llvmpipe.json

# Table in the README.
once $to/llvmpipe/city "${harness[@]}" run --scene city --device llvmpipe

# Gain from the choice of a triangulator, in native order.
peers=ear-clipping,earcut-refine,delaunay,sweep,manifold,max-area,greedy,flips:beauty,flips:l1,refined
peers+=,optimal:overdraw,optimal:shape,optimal:edge-length,optimal:half-perimeter,optimal:expected-quads,optimal:calibrated
for scene in city helsinki glyphs counties; do
    once $to/llvmpipe/gains-$scene "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 256,512,1024,4096 --triangulators $peers --profile $profile \
        --budget $([ $scene = counties ] && echo 3 || echo 1) # one draw takes 20 ms and more
done

# Gain and break-even of flips after ear clipping.
for scene in city helsinki glyphs counties:level=state counties; do
    name=flips-${scene#counties:level=}
    once $to/llvmpipe/$name "${harness[@]}" run --scene $scene \
        --device llvmpipe --resolution 64,512,1024 --budget 1 --triangulators \
        ear-clipping,earcut-refine,delaunay,flips:beauty,flips:l1,flips:euclidean,refined,optimal:half-perimeter
    once $to/llvmpipe/$name-walk "${harness[@]}" run --scene $scene \
        --device llvmpipe --resolution 64,1024 --budget 1 --order walk --triangulators \
        ear-clipping,earcut-refine,flips:beauty,flips:l1,refined
done

# Accuracy of criteria, twice, to check that results repeat.
for name in validate-city validate-city-again; do
    once $to/llvmpipe/$name "${harness[@]}" study validate --scene city --resolution 512 \
        --rasterisers opengl,bounding-box,scanline --device llvmpipe --budget 0.05
done
for device in llvmpipe zink softpipe; do # softpipe's compute shaders take some minutes
    once $to/$device/validate-paper "${harness[@]}" study validate --scene paper --resolution 512 \
        --rasterisers opengl,bounding-box,scanline --device $device
done
once $to/osmesa/validate-paper "${harness[@]}" study validate --scene paper --resolution 512 \
    --rasterisers osmesa,pyrender --device osmesa

# Rotation, with triangulations made at 0 degrees (@0) or at each angle; fragment arithmetic and
# samples per pixel.
once $to/llvmpipe/gains-rotation "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 512 --fit circle --budget 0.4 \
    --rotation 0,5,10,15,20,25,30,35,40,45,50,55,60,65,70,75,80,85,90 --triangulators \
    ear-clipping,delaunay,optimal:overdraw,optimal:overdraw@0,optimal:half-perimeter,optimal:half-perimeter@0,optimal:edge-length
once $to/llvmpipe/gains-work "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 1024 --work 0,1,4,16,64 --samples 1,4 --triangulators $peers --profile $profile --budget 0.5
for scene in helsinki glyphs; do
    once $to/llvmpipe/gains-$scene-walk "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 256,1024 --triangulators $peers --profile $profile --budget 1 --order walk
done

# Gain from the order of triangles and from diagonals, with break-even.
some=ear-clipping,delaunay,greedy,refined,optimal:overdraw,optimal:expected-quads
some+=,optimal:half-perimeter
for scene in city helsinki glyphs counties; do
    once $to/llvmpipe/orders-$scene "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 1024 --order native,walk,vertex-cache --triangulators $some --budget 1
done
if [[ orders == *"$only"* ]]; then
    "${harness[@]}" study gains $to/llvmpipe/orders-*/ --bases ear-clipping,delaunay \
        --out $to/llvmpipe/orders
fi

once $to/llvmpipe/gains-glyphs-shuffled "${harness[@]}" run --scene glyphs --device llvmpipe \
    --resolution 256 --triangulators $peers --profile $profile --budget 1 --order shuffled

# Gain on other devices.
once $to/llvmpipe/gains-city-boxes "${harness[@]}" run --scene city --device llvmpipe \
    --rasterisers bounding-box,scanline --resolution 256,1024 --triangulators $peers --profile $profile --budget 0.5
once $to/zink/gains-city "${harness[@]}" run --scene city --device zink \
    --resolution 256,1024 --triangulators $peers --budget 0.5 \
    --profile $profile
once $to/osmesa/gains-city "${harness[@]}" run --scene city --device osmesa \
    --rasterisers osmesa --resolution 256,1024 --triangulators $peers --budget 0.5 \
    --profile $profile

# The same triangulations on every device, with a summary of each run (SwiftShader is measured by
# the page in Chromium: scripts/in_chromium.py).
devices() { # rasteriser, device, name of the summary
    [[ devices == *"$only"* ]] && [ ! -e "$to/devices/$3.json" ] || return 0
    mkdir -p "$to/devices"
    for scene in city helsinki; do
        once "$to/devices/$3-$scene" "${harness[@]}" run --scene $scene --rasterisers "$1" \
            --device "$2" --resolution 1024 --budget 1 --triangulators \
            ear-clipping,delaunay,greedy,refined,optimal:half-perimeter,optimal:overdraw,optimal:expected-quads
        "${harness[@]}" import "$to/devices/$3-$scene" --summary "$to/devices/$3.json"
    done
}
devices opengl llvmpipe opengl-llvmpipe
devices opengl zink opengl-zink
devices opengl softpipe opengl-softpipe
devices osmesa osmesa osmesa
devices webgpu llvmpipe webgpu-llvmpipe
devices webgpu lavapipe webgpu-lavapipe

once $to/osmesa/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers osmesa --device osmesa --budget 0.05
once $to/zink/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers opengl,bounding-box --device zink --budget 0.05
once $to/softpipe/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers opengl --device softpipe --budget 0.05

# Weighing A against D.
for scene in paper city; do
    once $to/llvmpipe/pareto-$scene "${harness[@]}" study pareto --scene $scene --resolution 512 \
        --rasterisers opengl,bounding-box --device llvmpipe --budget 0.3
done

# Regret of criteria, timed on two devices.
for scene in city helsinki glyphs counties; do
    for device in llvmpipe zink; do
        once $to/$device/regret-$scene "${harness[@]}" study validate --scene $scene --work 0 \
            --rasterisers opengl --device $device --resolution 256,1024 --budget 0.05 \
            --polygons $(few $scene 12)
    done
done

if [[ gains == *"$only"* ]]; then
    "${harness[@]}" study gains $to/llvmpipe/gains-*/ --out $to/llvmpipe/gains
fi
if [[ validate-city-again == *"$only"* ]]; then
    "${python[@]}" -m scripts.repeated_runs $to/llvmpipe/validate-city $to/llvmpipe/validate-city-again
fi

# Regret of criteria, counted by the CPU reference.
for scene in city helsinki glyphs counties; do
    once $to/cpu/regret-$scene "${harness[@]}" study validate --scene $scene --work 0 \
        --rasterisers reference --resolution 256,1024 --polygons $(many $scene) --budget 0.004
done

# Accuracy of H by resolution, counted by the CPU reference; it depends on the size of slivers.
for scene in city helsinki; do
    once $to/cpu/validate-$scene-sizes "${harness[@]}" study validate --scene $scene --work 0 \
        --rasterisers reference --resolution 64,256,1024 --polygons 12 --budget 0.001
done

# Savings of helper lanes by flips, on all data sets.
if [[ flips-lanes == *"$only"* ]] && [ ! -e $to/flips-lanes.csv ]; then
    PYTHONPATH=. "${python[@]}" scripts/flips_lanes.py >$to/flips-lanes.csv
fi
