#!/usr/bin/env bash
# What is to be measured on a GPU, and how.  docs/gpu.md says which of it was run, and where.
#
#     bash benchmarks/gpu.sh FOX OUT [PEER_BIN]
#
# FOX is instant-ngp's fox at full size, OUT a new folder, PEER_BIN the bin folder of an environment with nerfstudio
# (and tinycudann), which then trains on the same GPU in the same hour.  About an hour and a half with the peer.
set -euo pipefail

fox=$1 out=$2 peer=${3:-}
steps=30000 rays=4096
# The preset is sized for a CPU's cache; these are nerfacto's table and samples, so that both do the same work.
sizes=(--train.rays $rays --model.field.grid.levels 16 --model.field.grid.features 2
    --model.field.grid.log2-table 19 --model.sampler.proposals 256 96 --model.sampler.final 48)
mkdir "$out"
nvidia-smi --query-gpu=name,driver_version,clocks.sm,clocks.mem,memory.total --format=csv | tee "$out/gpu.csv"

# The twins on the device itself, and graphs against plain steps: a figure of a wrong kernel is no figure.
pytest -m gpu -ra | tee "$out/pytest.txt"

# Each op: time, share of the measured ceilings of memory and arithmetic (roofline), speed-up over plain torch.
plnerf bench --suite ops --device cuda -o "$out/ops"

# Steps a second by size, on the bundled span, and through a lens that distorts.
python "$(dirname "$0")/gpu_steps.py" "$out/steps" | tee "$out/steps.txt"
python "$(dirname "$0")/gpu_steps.py" "$out/steps-lens" --lens | tee "$out/steps-lens.txt"

# Steps a second, seconds to 25 dB, and seconds for a megapixel (fox is 1080x1920: 2.07 megapixels a view).
plnerf bench --suite train render --scene "$fox" --device cuda --seconds 120 --targets 20 25 28 -o "$out/train" \
    "${sizes[@]}"

# PSNR after 30k steps, of whole held-out images.
plnerf train "$fox" -o "$out/plnerf-30k" --device cuda --steps $steps "${sizes[@]}"
plnerf eval "$out/plnerf-30k"

# The peer: same photos at full size, every 8th image held out, poses fixed; twice, since its two
# implementations differ in speed by much.
if [[ -n $peer ]]; then
    for implementation in torch tcnn; do
        run=$out/nerfacto-$implementation
        { time "$peer/ns-train" nerfacto --output-dir "$run" --experiment-name fox --timestamp run --vis tensorboard \
            --max-num-iterations $steps --pipeline.model.implementation $implementation \
            --pipeline.datamanager.train-num-rays-per-batch $rays --pipeline.model.camera-optimizer.mode off \
            nerfstudio-data --data "$fox" --downscale-factor 1 --eval-mode interval --eval-interval 8; } \
            2>&1 | tee "$run.log"
        "$peer/ns-eval" --load-config "$run/fox/nerfacto/run/config.yml" --output-path "$run.json"
    done
fi
