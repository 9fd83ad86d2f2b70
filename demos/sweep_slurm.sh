#!/usr/bin/env bash
# A sweep as an array job of Slurm, sixteen shares of one rank each: sbatch demos/sweep_slurm.sh; submit it again to do what is missing.
#SBATCH --job-name=tongue --array=1-16 --ntasks=1 --cpus-per-task=1 --mem=2G --time=08:00:00 --signal=TERM@120
set -euo pipefail
export OMP_NUM_THREADS=1
exec tongue sweep demos/sweep.toml -o runs/sweep --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_MAX"
