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
output=${2:-results/reference}

run_study() { # folder, command that writes it
    [[ "$1" == *"$only"* ]] || return 0
    [ -e "$1/correlations.csv" ] || [ -e "$1/summary.csv" ] || [ -e "$1/pareto.csv" ] && return
    printf "\n== %s %s\n" "$1" "$(date +%T)"
    rm -rf "$1"
    "${@:2}" --out "$1" --quiet
    [[ "$1" != */regret-* ]] || "${python[@]}" scripts/studies/trim_regret.py "$1"
}

write_csv() { # file, program that prints it
    [[ "$1" == *"$only"* ]] && [ ! -e "$output/$1" ] || return 0
    printf "\n== %s %s\n" "$1" "$(date +%T)"
    PYTHONPATH=. "${python[@]}" "${@:2}" >"$output/$1.part"
    mv "$output/$1.part" "$output/$1"
}

timed_polygons() { # scene, polygons: fewer for counties, which have hundreds of vertices
    if [ "$1" = counties ]; then echo 8; else echo "$2"; fi
}
counted_polygons() { # scene: more where one of few polygons would dominate
    case "$1" in counties) echo 8 ;; glyphs) echo 24 ;; *) echo 96 ;; esac
}

# The profile with the coefficients for optimal:calibrated.
profile=results/reference/profiles/opengl-llvmpipe.json

# Table in the README.
run_study $output/llvmpipe/city "${harness[@]}" run --scene city --device llvmpipe

# Gain from the choice of a triangulator, in native order.
peers=ear-clipping,earcut-refine,delaunay,sweep,manifold,max-area,greedy,flips:beauty,flips:l1,refined
peers+=,flips:expected-quads,refined:expected-quads
peers+=,optimal:overdraw,optimal:shape,optimal:edge-length,optimal:half-perimeter,optimal:expected-quads,optimal:calibrated
for scene in city helsinki glyphs counties; do
    run_study $output/llvmpipe/gains-$scene "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 256,512,1024,4096 --triangulators $peers --profile $profile \
        --budget $([ $scene = counties ] && echo 3 || echo 1) # one draw takes 20 ms and more
done

# Gain and break-even of flips after ear clipping.
for scene in city helsinki glyphs counties:level=state counties; do
    name=flips-${scene#counties:level=}
    run_study $output/llvmpipe/$name "${harness[@]}" run --scene $scene \
        --device llvmpipe --resolution 64,512,1024 --budget 1 --triangulators \
        ear-clipping,earcut-refine,delaunay,flips:beauty,flips:l1,flips:euclidean,flips:expected-quads,refined,optimal:half-perimeter
    run_study $output/llvmpipe/$name-walk "${harness[@]}" run --scene $scene \
        --device llvmpipe --resolution 64,1024 --budget 1 --order walk --triangulators \
        ear-clipping,earcut-refine,flips:beauty,flips:l1,flips:expected-quads,refined
done

# Times of flips in three languages, for docs/flips.md. EARCUT_HPP: folder of mapbox/earcut.hpp, for C++.
times=(scripts/flips_times.py ${EARCUT_HPP:+--earcut-hpp "$EARCUT_HPP"})
write_csv flips-times.csv "${times[@]}"
write_csv quads-flips-times.csv "${times[@]}" --languages JavaScript,C++ \
    --scenes city,helsinki,glyphs,counties:level=state

# Accuracy of criteria, twice, to check that results repeat.
for name in validate-city validate-city-again; do
    run_study $output/llvmpipe/$name "${harness[@]}" study validate --scene city --resolution 512 \
        --rasterisers opengl,bounding-box,scanline --device llvmpipe --budget 0.05
done
for device in llvmpipe zink softpipe; do # softpipe's compute shaders take some minutes
    run_study $output/$device/validate-paper "${harness[@]}" study validate --scene paper --resolution 512 \
        --rasterisers opengl,bounding-box,scanline --device $device
done
run_study $output/osmesa/validate-paper "${harness[@]}" study validate --scene paper --resolution 512 \
    --rasterisers osmesa,pyrender --device osmesa

# Rotation, with triangulations made at 0 degrees (@0) or at each angle; fragment arithmetic and
# samples per pixel.
run_study $output/llvmpipe/gains-rotation "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 512 --fit circle --budget 0.4 \
    --rotation 0,5,10,15,20,25,30,35,40,45,50,55,60,65,70,75,80,85,90 --triangulators \
    ear-clipping,delaunay,optimal:overdraw,optimal:overdraw@0,optimal:half-perimeter,optimal:half-perimeter@0,optimal:edge-length
run_study $output/llvmpipe/gains-work "${harness[@]}" run --scene city --device llvmpipe \
    --resolution 1024 --work 0,1,4,16,64 --samples 1,4 --triangulators $peers --profile $profile --budget 0.5
for scene in helsinki glyphs; do
    run_study $output/llvmpipe/gains-$scene-walk "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 256,1024 --triangulators $peers --profile $profile --budget 1 --order walk
done

# Gain from the order of triangles and from diagonals, with break-even.
some=ear-clipping,delaunay,greedy,refined,optimal:overdraw,optimal:expected-quads
some+=,optimal:half-perimeter
for scene in city helsinki glyphs counties; do
    run_study $output/llvmpipe/orders-$scene "${harness[@]}" run --scene $scene --device llvmpipe \
        --resolution 1024 --order native,walk,vertex-cache --triangulators $some --budget 1
done
if [[ orders == *"$only"* ]]; then
    "${harness[@]}" study gains $output/llvmpipe/orders-*/ --bases ear-clipping,delaunay \
        --out $output/llvmpipe/orders
fi

run_study $output/llvmpipe/gains-glyphs-shuffled "${harness[@]}" run --scene glyphs --device llvmpipe \
    --resolution 256 --triangulators $peers --profile $profile --budget 1 --order shuffled

# Gain on other devices.
run_study $output/llvmpipe/gains-city-boxes "${harness[@]}" run --scene city --device llvmpipe \
    --rasterisers bounding-box,scanline --resolution 256,1024 --triangulators $peers --profile $profile --budget 0.5
run_study $output/zink/gains-city "${harness[@]}" run --scene city --device zink \
    --resolution 256,1024 --triangulators $peers --budget 0.5 \
    --profile $profile
run_study $output/osmesa/gains-city "${harness[@]}" run --scene city --device osmesa \
    --rasterisers osmesa --resolution 256,1024 --triangulators $peers --budget 0.5 \
    --profile $profile

# The same triangulations on every device, with a summary of each run (SwiftShader is measured by
# the page in Chromium: scripts/in_chromium.py).
devices() { # rasteriser, device, name of the summary
    [[ devices == *"$only"* ]] && [ ! -e "$output/devices/$3.json" ] || return 0
    mkdir -p "$output/devices"
    for scene in city helsinki; do
        run_study "$output/devices/$3-$scene" "${harness[@]}" run --scene $scene --rasterisers "$1" \
            --device "$2" --resolution 1024 --budget 1 --triangulators \
            ear-clipping,delaunay,greedy,refined,optimal:half-perimeter,optimal:overdraw,optimal:expected-quads
        "${harness[@]}" import "$output/devices/$3-$scene" --summary "$output/devices/$3.json"
    done
}
devices opengl llvmpipe opengl-llvmpipe
devices opengl zink opengl-zink
devices opengl softpipe opengl-softpipe
devices osmesa osmesa osmesa
devices webgpu llvmpipe webgpu-llvmpipe
devices webgpu lavapipe webgpu-lavapipe

run_study $output/osmesa/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers osmesa --device osmesa --budget 0.05
run_study $output/zink/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers opengl,bounding-box --device zink --budget 0.05
run_study $output/softpipe/validate-city "${harness[@]}" study validate --scene city --resolution 512 \
    --polygons 12 --work 0 --rasterisers opengl --device softpipe --budget 0.05

# Weighing A against D.
for scene in paper city; do
    run_study $output/llvmpipe/pareto-$scene "${harness[@]}" study pareto --scene $scene --resolution 512 \
        --rasterisers opengl,bounding-box --device llvmpipe --budget 0.3
done

# Regret of criteria, timed on two devices.
for scene in city helsinki glyphs counties; do
    for device in llvmpipe zink; do
        run_study $output/$device/regret-$scene "${harness[@]}" study validate --scene $scene --work 0 \
            --rasterisers opengl --device $device --resolution 256,1024 --budget 0.05 \
            --polygons $(timed_polygons $scene 12)
    done
done

if [[ gains == *"$only"* ]]; then
    "${harness[@]}" study gains $output/llvmpipe/gains-*/ --out $output/llvmpipe/gains
fi
if [[ validate-city-again == *"$only"* ]]; then
    "${python[@]}" -m scripts.repeated_runs $output/llvmpipe/validate-city $output/llvmpipe/validate-city-again
fi

# Regret of criteria, counted by the CPU reference.
for scene in city helsinki glyphs counties; do
    run_study $output/cpu/regret-$scene "${harness[@]}" study validate --scene $scene --work 0 \
        --rasterisers reference --resolution 256,1024 --polygons $(counted_polygons $scene) --budget 0.004
done

# Accuracy of H by resolution, counted by the CPU reference; it depends on the size of slivers.
for scene in city helsinki; do
    run_study $output/cpu/validate-$scene-sizes "${harness[@]}" study validate --scene $scene --work 0 \
        --rasterisers reference --resolution 64,256,1024 --polygons 12 --budget 0.001
done

# Savings by flips, on all data sets.
write_csv quads-flips.csv scripts/studies/quads_flips.py
write_csv expected-quads.csv scripts/studies/expected_quads.py
write_csv flips-lanes.csv scripts/flips_lanes.py
