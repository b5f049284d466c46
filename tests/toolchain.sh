#!/usr/bin/env bash
# Provides the two bare-metal targets and prints on stdout what to give cargo before the
# subcommand: nothing where the active toolchain has them, `+embedded` where the distribution's
# compiler had to stand in. Everything else goes to stderr. A second run changes nothing.
set -euo pipefail

targets=(thumbv7em-none-eabihf riscv32imc-unknown-none-elf)
home=${XDG_CACHE_HOME:-$HOME/.cache}/splash-embedded
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { echo "toolchain: $*" >&2; }
die() { say "$*"; exit 1; }

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
"$(dirname "${BASH_SOURCE[0]}")/apt.sh" rustc-web rust-web-src rust-web-clippy lld-19 ||
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
