#!/usr/bin/env bash
# Flies a sweep with GNU parallel, here or on several machines over ssh, and prints its table.
#
#   sweep-parallel.sh LOGINS FOLDER SWEEP_ARGUMENTS...
#
# LOGINS: `:` is this machine; `8/hawk,16/eagle` are two others over ssh, with 8 and 16 flights at a time.
# FOLDER: gets cell-K.json of every cell, jobs.log of parallel, and results.csv.
# Every machine needs `plumbline` (or what PLUMBLINE says) and the data at the same absolute path as here, and rsync,
# which brings the results back; with SHARED_DISK=1 FOLDER is on a disk that all of them share, at the same path.
# Cells that are there already are not flown again: the same command goes on after an interruption.
set -euo pipefail
if ! command -v parallel > /dev/null; then
    echo "sweep-parallel.sh: GNU parallel is not installed; install it (Debian, Ubuntu: apt install parallel)" >&2
    exit 2
fi
if [ $# -lt 3 ]; then
    echo "usage: sweep-parallel.sh LOGINS FOLDER SWEEP_ARGUMENTS..." >&2
    exit 2
fi
plumbline=${PLUMBLINE:-plumbline}
logins=$1
mkdir -p "$2"
folder=$(realpath "$2")
shift 2

cells=$("$plumbline" sweep "$@" --list | cut -f1)
fly=(parallel --quote --sshlogin "$logins" --joblog "$folder/jobs.log" --retries 2)
if [ "$logins" = : ] || [ "${SHARED_DISK:-0}" = 1 ]; then
    "${fly[@]}" --workdir . "$plumbline" sweep "$@" --cells "$folder" --cell {} <<< "$cells" || failed=1
else
    # A cell is flown in a folder of its own there, and its file fetched into FOLDER.
    is_there() { grep -qs '"error": null' "$folder/cell-$1.json"; }
    missing=$(for cell in $cells; do is_there "$cell" || echo "$cell"; done)
    cd "$folder"
    [ -z "$missing" ] || "${fly[@]}" --workdir ... --return cell-{}.json --cleanup \
        "$plumbline" sweep "$@" --cells . --cell {} <<< "$missing" || failed=1
fi
[ -z "${failed:-}" ] || echo "some cells failed: see the column Exitval of $folder/jobs.log" >&2
"$plumbline" sweep --collect "$folder" --out "$folder/results.csv"
