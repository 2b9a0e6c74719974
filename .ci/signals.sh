# shellcheck shell=bash
# Sourced by .ci/run, .ci/nightly, .ci/pip and .ci/dolfinx-0.11: a signal ends the script and the command that it is
# running, which in turn ends its own descendants. A shell that waits for a foreground command would defer the signal, or
# leave the command running.
running=

end_by() {
  echo "== ${0##*/}: interrupted by SIG$1" >&2
  [ -z "$running" ] || { kill -s TERM "$running" && wait "$running"; } 2>/dev/null
  trap - "$1"
  kill -s "$1" $$
}
for signal in HUP INT TERM; do
  # shellcheck disable=SC2064
  trap "end_by $signal" $signal
done

# Runs a command, and returns its status
wait_for() {
  local status=0
  "$@" &
  running=$!
  wait "$running" || status=$?
  running=
  return $status
}
