#!/usr/bin/env bash
# A sweep on this machine: in processes, or under mpiexec; either goes on where the other was left.
set -euo pipefail
tongue sweep demos/sweep.toml -o runs/sweep --jobs "$(nproc)"
# mpiexec -n 4 tongue sweep demos/sweep.toml -o runs/sweep
# mpiexec -n 8 tongue sweep demos/sweep.toml -o runs/sweep --ranks-per-run 4     # large meshes
