#!/usr/bin/env bash
# Submits the verification of many flight logs to Slurm, as one job array; a log takes one processor.
#
#   verify-slurm.sh FOLDER LOG.mcap...
#
# FOLDER, the logs and `plumbline` (or what PLUMBLINE says) are on a disk that all nodes share. `sacct -j JOB -X -n -o
# state | sort | uniq -c` counts what passed; FOLDER/slurm-K.out has what was said of log K of FOLDER/logs.txt.
set -euo pipefail
plumbline=${PLUMBLINE:-plumbline}
folder=$(realpath -m "$1")
shift

mkdir -p "$folder"
realpath "$@" | grep -Ev '\.[1-9][0-9]*\.mcap$' > "$folder/logs.txt"
last=$(($(wc -l < "$folder/logs.txt") - 1))
# Line K + 1 of the list is the log of job K.
verify=$(printf '%q verify "$(sed -n "$((SLURM_ARRAY_TASK_ID + 1))p" %q)"' "$plumbline" "$folder/logs.txt")
sbatch --job-name plumbline-verify --array "0-$last%${AT_ONCE:-500}" --cpus-per-task 1 --mem 1G --time 1:00:00 \
    --output "$folder/slurm-%a.out" --wrap "$verify"
