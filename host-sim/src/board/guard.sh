# Runs a board's program: sh -c GUARD guard DIRECTORY PROGRAM ARGUMENT...
# Standard input is a pipe that ends with host-sim, however that ends: then nothing stays behind,
# neither the program, hung or not, nor the directory. The exit code is the program's.
directory=$1
shift
exec 3<&0
"$@" 3<&- </dev/null &
program=$!
(
  read -r _ <&3
  rm -rf -- "$directory"
  # The process group: program, guard and this.
  kill -KILL 0
) >/dev/null 2>&1 &
exec 3<&-
wait "$program"
