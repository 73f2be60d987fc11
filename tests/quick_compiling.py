"""Options of XLA with which programs are made for the compiler's speed, not the machine's."""

from __future__ import annotations

import importlib.metadata

# Since jaxlib 0.11 a process ends where it meets the second option. The third is for workers that
# keep all cores busy by themselves: no program is cut into parts to be compiled side by side.
XLA_FLAGS = (
    "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    " --xla_cpu_parallel_codegen_split_count=1"
    if [int(x) for x in importlib.metadata.version("jaxlib").split(".")[:2]] < [0, 11]
    else "--xla_backend_optimization_level=0"
)
