//! `host-sim`: see `host-sim --help`.

use host_sim::cli::Cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    match Cli::from_args().and_then(Cli::run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
