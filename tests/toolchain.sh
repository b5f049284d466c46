#!/usr/bin/env bash
# Provides what the boards are built and run with, and prints on stdout what to give cargo before
# the subcommand: nothing where the active toolchain has the bare-metal targets, `+embedded` where
# the distribution's compiler had to stand in. Everything else goes to stderr. A second run changes
# nothing and takes a second.
#
# | what | from | where to |
# |---|---|---|
# | targets thumbv7em-none-eabihf, riscv32imc-unknown-none-elf | rustup, else packages rustc-web rust-web-src rust-web-clippy lld-19 | rustup, else toolchain `embedded` in the cache |
# | QEMU (Cortex-M7) | package qemu-system-arm | the system |
# | Verilator and what it builds with | packages verilator g++ make | the system |
# | Ibex (soft core) | Python package pythondata-cpu-ibex, unpacked | the cache |
#
# The cache is ${XDG_CACHE_HOME:-~/.cache}/splash-embedded. Only packages need root, or sudo that asks
# nothing.
set -euo pipefail

targets=(thumbv7em-none-eabihf riscv32imc-unknown-none-elf)
ibex_version=0.0.post2937
cache=${XDG_CACHE_HOME:-$HOME/.cache}/splash-embedded
home=$cache/toolchain
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { echo "toolchain: $*" >&2; }
die() { say "$*"; exit 1; }

# --- emulator, simulator and soft core ---

# A program of the system, from a package of its name unless others are given.
program() { # program COMMAND [PACKAGE...]
  local command=$1
  shift
  if command -v "$command" >/dev/null; then return; fi
  say "$command is missing: it comes with the package(s) ${*:-$command}"
  "$here/apt.sh" "${@:-$command}" || die "cannot install ${*:-$command}, which bring $command"
}

program qemu-system-arm
program verilator
program g++
program make

# The sources are data: nothing is installed in Python, and any Python can fetch them.
ibex=$cache/ibex
if [ "$(cat "$ibex/version" 2>/dev/null)" != "$ibex_version" ]; then
  say "Ibex $ibex_version into $ibex"
  program python3
  python3 -m pip --version >/dev/null 2>&1 || "$here/apt.sh" python3-pip ||
    die "cannot install python3-pip, which fetches pythondata-cpu-ibex"
  python3 -m pip download -q --disable-pip-version-check --no-deps --dest "$work" \
    "pythondata-cpu-ibex==$ibex_version" >&2 || die "pip cannot fetch pythondata-cpu-ibex $ibex_version"
  rm -rf "$ibex"
  mkdir -p "$ibex"
  python3 -m zipfile -e "$work"/pythondata_cpu_ibex-*.whl "$ibex"
  echo "$ibex_version" >"$ibex/version"
fi

# --- bare-metal targets ---

# A compiled function is the stamp: it cannot outlive an upgrade of the compiler, as a file could.
works() {
  local target
  for target in "${targets[@]}"; do
    echo '#![no_std] pub fn f(x: u32) -> Option<u32> { x.checked_mul(3) }' |
      rustc ${1:+"$1"} --target "$target" --crate-type rlib --crate-name probe --out-dir "$work" - \
        >/dev/null 2>&1 || return 1
  done
}

if works ""; then exit; fi
command -v rustup >/dev/null || die "the bare-metal targets are missing and there is no rustup to add them"
if works +embedded; then echo +embedded; exit; fi

# One attempt with a time limit: without a network the answer is to come soon, not after retries.
say "rustup target add ${targets[*]}"
if RUSTUP_MAX_RETRIES=0 timeout 120 rustup target add "${targets[@]}" </dev/null >"$work/rustup.log" 2>&1 &&
  works ""; then
  exit
fi
say "rustup cannot provide them: $(grep -m1 -i error "$work/rustup.log" || echo 'no answer in time')"

# The fallback: the distribution's compiler, with its own source, builds `core` for the targets.
"$here/apt.sh" rustc-web rust-web-src rust-web-clippy lld-19 ||
  die "neither rustup nor the distribution provides ${targets[*]}"

say "building core for ${targets[*]} in $home"
rustc=/usr/bin/rustc
host=$("$rustc" -vV | sed -n 's/^host: //p')
mkdir "$work/src"
printf '[package]\nname = "seed"\nversion = "0.0.0"\nedition = "2021"\n[workspace]\n' >"$work/Cargo.toml"
echo '#![no_std]' >"$work/src/lib.rs"
# RUSTC_BOOTSTRAP opens -Zbuild-std for this one build; the linked toolchain needs no flag.
(cd "$work" && unset RUSTFLAGS CARGO_ENCODED_RUSTFLAGS &&
  RUSTC=$rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_DIR=$work/t CARGO_PROFILE_RELEASE_PANIC=abort \
    CARGO_PROFILE_RELEASE_CODEGEN_UNITS=1 RUSTFLAGS=-Cembed-bitcode=yes \
    cargo build -q --release -Zbuild-std=core,alloc,compiler_builtins \
    -Zbuild-std-features=compiler-builtins-mem "${targets[@]/#/--target=}") >&2

rm -rf "$home"
mkdir -p "$home/bin" "$home/lib/rustlib/$host/bin"
for target in "${targets[@]}"; do
  mkdir -p "$home/lib/rustlib/$target/lib"
  cp "$work/t/$target"/release/deps/*.r{lib,meta} "$home/lib/rustlib/$target/lib/"
  rm -f "$home/lib/rustlib/$target/lib"/libseed-*
done
ln -s "/usr/lib/rustlib/$host/lib" "$home/lib/rustlib/$host/lib"
ln -s /usr/lib/llvm-19/bin/lld "$home/lib/rustlib/$host/bin/rust-lld"
for tool in rustc rustdoc clippy-driver; do
  printf '#!/bin/sh\nexec /usr/bin/%s "$@" --sysroot %q\n' "$tool" "$home" >"$home/bin/$tool"
  chmod +x "$home/bin/$tool"
done
cp /usr/bin/cargo-clippy "$home/bin/"   # a copy: cargo-clippy looks for clippy-driver beside itself
ln -s "$(rustup which cargo)" "$home/bin/cargo"   # else rustup takes the cargo of any toolchain
rustup toolchain link embedded "$home" >&2
works +embedded || die "the toolchain built in $home does not compile for ${targets[*]}"
echo +embedded
