#!/usr/bin/env bash
# Installs packages of a Debian-like distribution unless all are there. Asks nothing; says nothing
# on stdout; on failure shows the last lines of apt's output.
set -euo pipefail

if dpkg -s "$@" >/dev/null 2>&1; then exit; fi
command -v apt-get >/dev/null || { echo "no apt-get here; install by hand: $*" >&2; exit 1; }
sudo=()
[ "$(id -u)" = 0 ] || sudo=(sudo -n)
apt() { "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 "$@"; }

echo "apt-get install $*" >&2
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# An index that is partly out of reach may still have the packages: only the install must succeed.
apt update </dev/null >"$log" 2>&1 || true
apt install -y --no-install-recommends "$@" </dev/null >>"$log" 2>&1 || {
  tail -5 "$log" >&2
  echo "cannot install: $*" >&2
  exit 1
}
