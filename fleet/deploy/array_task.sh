#!/bin/sh
# One task of an array job: judges the directories of an archive whose turn it is, by the plain command line.
#   array_task.sh TASK TASKS ARCHIVE DESIGN OUT
# TASK from 0 to TASKS-1: of Slurm $SLURM_ARRAY_TASK_ID with --array=0-99, of others their own. Each directory below
# ARCHIVE goes to a directory of OUT with its own journal.jsonl, run.json and lock, so that tasks share nothing; begun
# again, a task goes on where it stopped. INKLING names the program where it is not on the path.
set -u
task=$1 tasks=$2 archive=$3 design=$4 out=$5
worst=0 at=0
for directory in "$archive"/*/; do
    turn=$((at % tasks))
    at=$((at + 1))
    [ "$turn" -eq "$task" ] || continue
    "${INKLING:-inkling}" replay "$directory" --design "$design" --out "$out/$(basename "$directory")" --quiet
    status=$?
    # 3 (some input was damaged) beats 0, 4 (something was not judged) beats 3, a failure beats all
    case $status in
        0) ;;
        3) [ $worst -eq 0 ] && worst=3 ;;
        4) [ $worst -eq 0 ] || [ $worst -eq 3 ] && worst=4 ;;
        *) worst=$status ;;
    esac
done
exit $worst
