#!/usr/bin/env bash
# Flies a sweep with GNU parallel, here or on several machines over ssh, and prints its table.
#
#   sweep-parallel.sh LOGINS FOLDER SWEEP_ARGUMENTS...
#
# LOGINS: `:` is this machine; `8/hawk,16/eagle` are two others over ssh, with 8 and 16 flights at a time.
# FOLDER: gets cell-K.json of every cell, jobs.log of parallel, and results.csv.
# Every machine needs `plumbline` (or what PLUMBLINE says) and the data at the same place as here. Cells that are
# there already are not flown again: the same command goes on after an interruption.
set -euo pipefail
plumbline=${PLUMBLINE:-plumbline}
logins=$1 folder=$2
shift 2

mkdir -p "$folder"
# What a machine wrote comes back to FOLDER, unless it shares the disk or is this one.
fetch=()
[ "$logins" = : ] || [ "${SHARED_DISK:-0}" = 1 ] || fetch=(--return "$folder/cell-{}.json" --cleanup)

"$plumbline" sweep "$@" --list | cut -f1 |
    parallel --quote --sshlogin "$logins" --workdir . --joblog "$folder/jobs.log" --retries 2 "${fetch[@]}" \
        "$plumbline" sweep "$@" --cells "$folder" --cell {} || echo "some cells failed; see $folder/jobs.log" >&2

"$plumbline" sweep --collect "$folder" --out "$folder/results.csv"
