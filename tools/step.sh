#!/bin/sh
# Takes a step of the set-up: says which, and every half minute that it still lasts.
#   sh tools/step.sh 'installing what it needs' COMMAND [ARGUMENT ...]
# Called by the Makefile and the other scripts of the set-up.
set -eu

what=$1
shift
every_s=${SET_UP_LINE_EVERY_S:-30}

say_that_it_lasts() {
  began_s=$(date +%s)
  # The last sleep outlives the step: it must not keep open what the step writes to.
  while sleep "$every_s" > /dev/null 2>&1 && kill -0 "$$" 2> /dev/null; do
    echo "set-up: still ${what%% (*}, for $(($(date +%s) - began_s)) s"
  done
}

# Who is asked to end ends all that runs for the step, too: make alone would leave it running.
end_step() {
  trap '' TERM INT HUP
  if [ -n "$step" ]; then
    kill -TERM "-$step" 2> /dev/null || kill -TERM "$step" 2> /dev/null || true
  fi
  exit "$1"
}

echo "set-up: $what"
say_that_it_lasts &
clock=$!
step=
trap 'kill "$clock" 2> /dev/null || true' EXIT
trap 'end_step 129' HUP
trap 'end_step 130' INT
trap 'end_step 143' TERM
exec 3<&0  # what a shell runs in the background reads nothing, unless it is asked to
setsid "$@" <&3 3<&- &
step=$!
wait "$step"
