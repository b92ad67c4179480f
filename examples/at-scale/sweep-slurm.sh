#!/usr/bin/env bash
# Submits a sweep to Slurm: one job array for the cells, and one job after it for the table.
#
#   sweep-slurm.sh FOLDER SWEEP_ARGUMENTS...
#
# FOLDER, the data and `plumbline` (or what PLUMBLINE says) are on a disk that all nodes share. A cell takes one
# processor. SBATCH_... variables choose partition, account and so on; AT_ONCE limits the cells in flight.
set -euo pipefail
plumbline=${PLUMBLINE:-plumbline}
folder=$(realpath -m "$1")
shift

mkdir -p "$folder"
last=$(($("$plumbline" sweep "$@" --list | wc -l) - 1))
command=$(printf '%q ' "$plumbline" sweep "$@" --cells "$folder")
array=$(sbatch --parsable --job-name plumbline-cells --array "0-$last%${AT_ONCE:-500}" --requeue \
    --cpus-per-task 1 --mem 1G --time 1:00:00 --output "$folder/slurm-%a.out" \
    --wrap "$command --cell \$SLURM_ARRAY_TASK_ID")
table=$(printf '%q ' "$plumbline" sweep --collect "$folder" --out "$folder/results.csv")
sbatch --job-name plumbline-table --dependency "afterany:${array%%;*}" --output "$folder/table.txt" \
    --wrap "$table"
