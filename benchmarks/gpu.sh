#!/usr/bin/env bash
# The whole GPU measurement in one run, below 8 minutes: makes an environment, checks the answers,
# measures, and writes the table and the JSON to OUT (benchmarks/results if not given).
#
#     OUT=somewhere benchmarks/gpu.sh [poses]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
poses=${1:-10000000}
environment=$(mktemp -d)
trap 'rm -rf "$environment"' EXIT
python3 -m venv "$environment"
"$environment/bin/pip" install --quiet "jax[cuda12]" .
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader || true
"$environment/bin/python" -m benchmarks.devices --here --poses "$poses" --rounds 5 --save
if [ -n "${OUT:-}" ]; then
    mkdir -p "$OUT"
    cp benchmarks/results/*-device-*.{json,md} "$OUT"
fi
