"""All Triton kernels compile to machine code for GPUs: the compiler and its assembler come with Triton."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMPILE = """
import re
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource, compile
from plnerf.ops import cuda_adam, cuda_kernels, cuda_lens, cuda_rays, cuda_stepfun, cuda_volume
HASH = {"L": 8, "F": 4, "F_UP": 4, "CUBIC": True, "BLOCK": 128}
RAY = {"BLOCK": 64, "EPS": 1e-7, "AT_ONCE": 16, "PADDING": 0.01}
SAMPLE = {"A0": 1.0, "A1": 1.0, "A2": 1.0, "CONTRACTION": True, "OCTAVES": 6, "TINY": 1e-38, "BLOCK": 128,
          "LOW": 0.0, "SPAN": 1.0, "BEYOND": 0.0, "KNEE": 1.0}
ADAM = {"F": 4, "F_UP": 4, "BETA1": 0.9, "BETA2": 0.99, "LOG_BETA1": -0.1, "LOG_BETA2": -0.01, "EPS": 1e-15,
        "BLOCK": 256}
LENS = {"ITERATIONS": 16, "LONGEST_STEP": 1.0, "WIDTH": 0.577, "BLOCK": 128}
KERNELS = [
    (cuda_kernels, ("encode", "table_gradient", "position_gradient", "position_gradient_backward"), HASH),
    (cuda_volume, ("_weights", "_weights_backward", "_render", "_render_backward"), RAY),
    (cuda_stepfun, ("_resample", "_interlevel", "_distortion"), RAY),
    (cuda_rays, ("_distances", "_features"), SAMPLE),
    (cuda_adam, ("step_rows",), ADAM),
    (cuda_lens, ("_cast",), LENS),
]
WHOLE = ("S", "P", "count", "rays", "rows", "samples", "points", "cameras")
TYPES = {"layout": "*i64", "camera": "*i64", "table": "*fp16", **dict.fromkeys(WHOLE, "i32")}
for module, names, sizes in KERNELS:
    for name in names:
        kernel = getattr(module, name)
        here = {k: value for k, value in sizes.items() if k in kernel.arg_names}
        signature = {k: "constexpr" if k in here else TYPES.get(k, "*fp32") for k in kernel.arg_names}
        aligned = {(i,): [["tt.divisibility", 16]] for i, k in enumerate(signature) if signature[k][0] == "*"}
        source = ASTSource(kernel, signature, here, aligned)
        ptx = compile(source, target=GPUTarget("cuda", 90, 32)).asm["ptx"]
        print(name, *sorted(set(re.findall(r"ld\\.global[.\\w]*|atom\\.global[.\\w]*", ptx))))
"""


@pytest.mark.slow
def test_kernels_compile_for_a_gpu(tmp_path: Path) -> None:
    """One of capability 9.0.  A vertex of a table is read at once, and added to at once."""
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    environment["TRITON_CACHE_DIR"] = str(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", COMPILE], env=environment, text=True, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = {line.split()[0]: line for line in done.stdout.splitlines()}
    assert len(lines) == 15
    assert "atom.global.gpu.relaxed.add.v4.f32" in lines["table_gradient"]
    assert "ld.global.v2.b32" in lines["encode"]  # four features of 16 bits
