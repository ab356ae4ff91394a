#!/bin/sh
# Called by sbatch with the command of a run: docs/clusters.md. Each job of an array works on its share
# of the devices; a job alone does what is left and makes the report. Snakemake runs within the job, with
# its cores and its memory, and takes up what an earlier job has left.
#SBATCH --job-name=imuloop
#SBATCH --cpus-per-task=2
#SBATCH --mem=4000
#SBATCH --time=120
#SBATCH --requeue
#SBATCH --open-mode=append

target=results/report.html
if [ -n "$SLURM_ARRAY_TASK_ID" ]; then target=devices; fi
# Snakemake itself takes 300 MB with 200 devices
exec "$@" \
  --cores "$SLURM_CPUS_PER_TASK" --resources mem_mb=$((SLURM_MEM_PER_NODE - 400)) \
  --keep-going --retries 2 --latency-wait 60 --nolock --max-jobs-per-timespan 1000/10s \
  -- $target
