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

echo "set-up: $what"
say_that_it_lasts &
clock=$!
trap 'kill "$clock" 2> /dev/null || true' EXIT
"$@"
