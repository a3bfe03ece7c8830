#!/usr/bin/env bash
#SBATCH --job-name=smalto
#SBATCH --array=1-8
#SBATCH --gpus=1
#SBATCH --requeue

# One shard per task of the array: sbatch slurm.sh SCENE CAMERAS FOLDER. A task that failed is submitted again by
# sbatch --array=3 slurm.sh ...; the number of shards stays as it is then, so it is not SLURM_ARRAY_TASK_COUNT.
set -euo pipefail
shards=${SHARDS:-8} # as many as in --array

smalto render "$1" --cameras "$2" --camera all -o "$3/" --shard "$SLURM_ARRAY_TASK_ID/$shards" --resume
