#!/usr/bin/env bash
# Measures HEAD, compares it and writes every report, as action.yml and the GitLab example do. Ends
# with the exit code of `raster-harness compare`.
#
#   scripts/ci-compare.sh BASELINE OUT [options of compare...] -- [options of run...]
#
# BASELINE    a folder that holds a run, or will; OUT  a folder for HEAD's run and the reports
# BESIDE=REF  compare with the commit REF of the current repository instead, measured in the same
#             rounds as HEAD: only so can times be told from the machine's
# KEEP=yes    afterwards HEAD becomes the baseline, as on the branch that others are compared with
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
# 5: some cases failed, which the comparison names
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
