//! The programs of the boards, built where they are needed: in the source tree.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Why there is no program for a board.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// This program was moved away from the sources that it was made from.
    #[error("{} is not there: board programs are built from the source tree", .0.display())]
    Sources(PathBuf),
    /// Cargo cannot be run.
    #[error("cargo: {0}")]
    Cargo(std::io::Error),
    /// Cargo failed; it has said why.
    #[error(
        "cargo build in {} failed, see above; if {target} is missing: \
         tests/toolchain.sh >target/embedded-toolchain",
        folder.display()
    )]
    Failed {
        /// Where.
        folder: PathBuf,
        /// The target of the program.
        target: &'static str,
    },
}

/// The top of the source tree.
pub(super) fn tree() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package)
}

/// Where results of [`cargo_build`] are.
fn built() -> PathBuf {
    tree().join("target/boards")
}

/// `cargo build --release` in `folder` of the source tree, with the result in `target/boards` at its top.
#[must_use]
pub fn cargo_build(folder: &Path) -> Command {
    let mut cargo = Command::new("cargo");
    // What tests/toolchain.sh said: nothing, or the toolchain that has the targets.
    let toolchain = std::fs::read_to_string(tree().join("target/embedded-toolchain"));
    cargo.args(toolchain.ok().as_deref().map(str::trim).filter(|name| !name.is_empty()));
    cargo.args(["build", "--release", "--target-dir"]).arg(built());
    // The same program, whatever the caller builds his own with.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        cargo.env_remove(variable);
    }
    cargo.current_dir(folder);
    cargo
}

/// Runs it.
fn build(folder: PathBuf, arguments: &[&str], target: &'static str) -> Result<PathBuf, BuildError> {
    if !folder.exists() {
        return Err(BuildError::Sources(folder));
    }
    let status = cargo_build(&folder).args(arguments).status().map_err(BuildError::Cargo)?;
    if status.success() { Ok(built()) } else { Err(BuildError::Failed { folder, target }) }
}

/// Builds program `name` of the board in `firmware/boards/BOARD`, which takes no time if it is up
/// to date, and returns its path.
pub(super) fn program(
    board: &str,
    target: &'static str,
    name: &str,
) -> Result<PathBuf, BuildError> {
    let folder = tree().join("firmware/boards").join(board);
    let built = build(folder, &["--bin", name], target)?;
    Ok(built.join(target).join("release").join(name))
}

/// Builds the instruction counter of the board in `firmware/boards/BOARD`, which QEMU loads.
pub(super) fn plugin(board: &str) -> Result<PathBuf, BuildError> {
    let folder = tree().join("firmware/boards").join(board).join("icount");
    if !folder.exists() {
        return Err(BuildError::Sources(folder));
    }
    let manifest = folder.join("Cargo.toml");
    let manifest = manifest.to_string_lossy();
    // From the top: in its folder, the board's target would be that of the plugin, too.
    let built = build(tree().to_path_buf(), &["--manifest-path", &manifest], "the PC itself")?;
    Ok(built.join("release").join("libicount.so"))
}
