//! The suite on the host, as a board runs it: lines on the console, to be compared with
//! `tests/golden/suite.txt`.

use splash_suite::{BUFFER, MODES, PIXELS, WINDOWS, Workspace};

static WORKSPACE: std::sync::Mutex<Workspace<WINDOWS, PIXELS, BUFFER, MODES>> =
    std::sync::Mutex::new(Workspace::new());

fn main() {
    let mut workspace = WORKSPACE.lock().expect("nobody else has it");
    if let Err(error) = workspace.run(&mut |line| println!("{line}")) {
        eprintln!("{error}");
        std::process::exit(1);
    }
}
