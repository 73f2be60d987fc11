#!/usr/bin/env bash
# The whole GPU measurement in one run, below 10 minutes: takes the JAX that sees a GPU, or makes an
# environment with one, checks the answers, measures, and writes the table and the JSON to
# benchmarks/results, and to OUT if given.
#
#     OUT=somewhere benchmarks/gpu.sh [poses] [seconds for compiling]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=python3
if ! "$python" -c 'import jax; jax.devices("gpu")' 2>/dev/null; then
    environment=$(mktemp -d)
    trap 'rm -rf "$environment"' EXIT
    python3 -m venv "$environment"
    python="$environment/bin/python"
    "$python" -m pip install --quiet "jax[cuda12]" .
fi
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader || true
# Programs are compiled side by side on one GPU: each process takes memory as it needs it.
export XLA_PYTHON_CLIENT_PREALLOCATE=false PYTHONUNBUFFERED=1
status=0
"$python" -m benchmarks.accelerator --poses "${1:-1048576}" --patience "${2:-300}" --save || status=$?
if [ -n "${OUT:-}" ]; then
    mkdir -p "$OUT"
    cp benchmarks/results/*-device-*.{json,md} "$OUT"
fi
exit "$status"
