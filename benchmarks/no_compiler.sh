#!/usr/bin/env bash
# That no compiler is needed: trains the bundled span for a few steps, all kernels compiled anew, in a process whose
# PATH holds Python and nothing else.  Prints how long the wait for the first step was.
#
#     bash benchmarks/no_compiler.sh [PYTHON]
set -euo pipefail

python=$(command -v "${1:-python}")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/bin"
ln -s "$python" "$scratch/bin/python"
scene=$("$python" -c 'from plnerf.pipeline import bundled_span; print(bundled_span())')

for name in cc gcc g++ c++ clang cl nvcc ld as cmake ninja make; do
    if PATH="$scratch/bin" command -v "$name"; then
        echo "there is a $name on the PATH" >&2
        exit 1
    fi
done
env -u CC -u CXX PATH="$scratch/bin" NUMBA_CACHE_DIR="$scratch/numba" OMP_WAIT_POLICY=PASSIVE \
    "$python" -m plnerf train "$scene" -o "$scratch/run" --downscale 4 --steps 20 --device cpu --backend numba
