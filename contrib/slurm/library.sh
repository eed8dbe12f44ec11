#!/bin/sh
# Processes, checks and compresses a library of sessions, each session by one task of a job array.
#
# usage: sbatch --array=1-$(wc -l <LIST) library.sh LIST [OPTION of mesorig compress …]
#   LIST  a file with the path of one session per line, on a file system that all machines share
#SBATCH --job-name=library
#SBATCH --cpus-per-task=2
#SBATCH --mem=2G
#SBATCH --time=02:00:00
#SBATCH --requeue
#SBATCH --output=%x-%A-%a.log
set -eu
list=$1
shift
session=$(sed -n "${SLURM_ARRAY_TASK_ID}p" "$list")
if [ ! -d "$session" ]; then
    echo "$list:$SLURM_ARRAY_TASK_ID: there is no session \"$session\"" >&2
    exit 1
fi
[ $# -gt 0 ] || set -- -q 8bit-weights --memory 1GB

if find "$session/frames" -type f | grep -q .; then # an imported session has its products already
    mesorig process "$session"
fi
mesorig verify "$session"
mesorig check "$session"
mesorig compress "$session" "$@"
