#!/usr/bin/env bash
# Verifies many flight logs with GNU parallel, here or on several machines over ssh: each is executed again, and every
# output compared bit for bit.
#
#   verify-parallel.sh LOGINS FOLDER LOG.mcap...     (or `-` in place of the logs: their names from standard input)
#
# LOGINS: `:` is this machine; `8/hawk,16/eagle` are two others over ssh. FOLDER: gets jobs.log of parallel, with the
# exit status of each log, and what was said of each. The machines need `plumbline` (or what PLUMBLINE says; bits are
# promised for one and the same binary) and the logs at the same place as here. Exit status 0 only if all pass.
set -euo pipefail
if ! command -v parallel > /dev/null; then
    echo "verify-parallel.sh: GNU parallel is not installed; install it (Debian, Ubuntu: apt install parallel)" >&2
    exit 2
fi
if [ $# -lt 3 ]; then
    echo "usage: verify-parallel.sh LOGINS FOLDER LOG.mcap..." >&2
    exit 2
fi
plumbline=${PLUMBLINE:-plumbline}
logins=$1 folder=$2
shift 2

mkdir -p "$folder"
names() { if [ "${1:-}" = - ]; then cat; else printf '%s\n' "$@"; fi; }
# Further parts of a log (flight.1.mcap) are read with its first.
names "$@" | grep -Ev '\.[1-9][0-9]*\.mcap$' > "$folder/logs.txt"

status=0
parallel --quote --sshlogin "$logins" --workdir . --joblog "$folder/jobs.log" --results "$folder/said/" \
    "$plumbline" verify {} < "$folder/logs.txt" > /dev/null 2>&1 || status=1

# The columns of jobs.log: the seventh is the exit status, the last the log.
awk -F'\t' 'NR > 1 { total++; if ($7 == 0) passed++; else print "FAILED (status " $7 "): " $9 }
    END { print passed + 0 " of " total + 0 " logs are bit-identical"; exit !total }' "$folder/jobs.log" || status=1
exit "$status"
