#!/usr/bin/env bash
# Measure HEAD, compare it with a baseline and write all reports, for action.yml and the GitLab
# example. The exit code is that of `raster-harness compare`.
#
#   scripts/ci-compare.sh BASELINE OUT [options of compare...] -- [options of run...]
#
# BASELINE    folder of the baseline's run; OUT  folder for the run of HEAD and the reports
# BESIDE=REF  compare with the commit REF of the current repository instead, measured in the same
#             rounds as HEAD: only then is a change in time not due to the machine
# KEEP=yes    make the run of HEAD the new baseline afterwards, e.g. on the main branch
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-$root/.venv/bin/python}
export PYTHONPATH="$PWD:$root${PYTHONPATH:+:$PYTHONPATH}"

usage() { sed -n '5,10s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ $# -ge 2 ] || usage
baseline=$1 out=$2
shift 2
compare=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do compare+=("$1"); shift; done
[ $# -gt 0 ] && shift
base=$baseline beside=()
if [ -n "${BESIDE:-}" ]; then base=$out/head/base beside=(--beside "$BESIDE"); fi

rm -rf "$out/head"
mkdir -p "$out"
# Exit code 5: some cases failed; the comparison lists them.
"$python" -m harness run --out "$out/head" --quiet "${beside[@]}" "$@" || [ $? = 5 ]
code=0
"$python" -m harness compare "$base" "$out/head" --allow-missing-baseline \
    --markdown "$out/compare.md" --junit "$out/compare.xml" --json "$out/compare.json" \
    --html "$out/compare.html" "${compare[@]}" || code=$?
if [ "${KEEP:-}" = yes ]; then
    rm -rf "$baseline"
    mkdir -p "$(dirname "$baseline")"
    cp -r "$out/head" "$baseline"
    rm -rf "$baseline/base"
fi
exit "$code"
