# shellcheck shell=bash
# Sourced by .ci/run, .ci/build, .ci/nightly, .ci/pip and .ci/dolfinx-0.11: a signal ends the script and the command that it is
# running, which in turn ends its own descendants. A shell that waits for a foreground command would defer the signal, or
# leave the command running.
#
# The folder $temporary is deleted at the end, also after a signal, for which bash may leave out a trap on EXIT.
temporary=

delete_temporary() {
  [ -z "$temporary" ] || rm -rf "$temporary"
}
trap delete_temporary EXIT

end_by() {
  echo "== ${0##*/}: interrupted by SIG$1" >&2
  # shellcheck disable=SC2046
  { kill -s TERM $(jobs -p) && wait; } 2>/dev/null || :
  delete_temporary
  trap - "$1" EXIT
  kill -s "$1" $$
}
for signal in HUP INT TERM; do
  # shellcheck disable=SC2064
  trap "end_by $signal" $signal
done

# Runs a command, and returns its status
wait_for() {
  "$@" &
  wait $!
}
