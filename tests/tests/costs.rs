//! What frames and programs cost on the emulated boards, against what was accepted.
//!
//! `golden/costs.csv` has a line a figure; more than 2 % above it fails. `SPLASH_ACCEPT=1 cargo test
//! -p splash-tests --test costs` accepts what is measured. A board that cannot be had is skipped, or
//! fails where SPLASH_BOARDS is set.

use host_sim::board::{Board, BoardError, Options, ibex, qemu};
use host_sim::instrument::Instrument;
use host_sim::profile::{Profile, SecondGate, Sizes, every_flux, measure};
use host_sim::reconstructor::Reconstructor;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Growth that passes.
const GROWTH: f64 = 0.02;
/// Subapertures across, window, bits, sweeps, and modes of a second gate.
const INSTRUMENTS: [[u32; 5]; 6] = [
    [8, 16, 12, 4, 0],
    [16, 8, 12, 8, 0],
    [8, 16, 16, 4, 0],
    [16, 8, 16, 8, 0],
    [8, 16, 12, 4, 12],
    [16, 8, 12, 8, 25],
];

type Costs = BTreeMap<String, u64>;

fn profile(name: &str, [n, window, bits, sweeps, modes]: [u32; 5]) -> Result<Profile, BoardError> {
    let description = Instrument::parse(
        &format!(
            "[telescope]\nsubapertures = {n}\n[windows]\nsize = {window}\nspacing_px = {window}\n\
             [detector]\nbits = {bits}\n[control]\nsweeps = {sweeps}"
        ),
        "costs",
    );
    let reconstructor = Reconstructor::new(&description.expect("valid")).expect("valid");
    let alone = every_flux(reconstructor.spec());
    let second = SecondGate::new(&alone, modes as usize);
    let spec = if modes > 0 { second.beside(alone) } else { alone };
    let options = Options { marks: true, ..Options::default() };
    let mut board: Box<dyn Board> = match name {
        "qemu" => Box::new(qemu::open(&spec, options)?),
        _ => Box::new(ibex::open(&spec, options)?),
    };
    Ok(measure(board.as_mut(), &spec, 1, &mut || ()).expect("complete frames"))
}

/// Everything about a board, or why it cannot be had.
fn costs(name: &str, program: PathBuf) -> Result<Costs, BoardError> {
    let mut costs = Costs::new();
    let mut stack = 0;
    for instrument in INSTRUMENTS {
        let [n, window, bits, sweeps, modes] = instrument;
        let gates = if modes > 0 { format!(" {modes} modes") } else { String::new() };
        let profile = profile(name, instrument)?;
        let (least, most) = profile.range();
        assert_eq!(
            least, most,
            "{name}, N = {n}, {bits} bits{gates}: the content shows in the time"
        );
        let stages = profile.stages().into_iter().chain([("frame", most)]);
        for (stage, count) in stages {
            let key = format!("{name},N={n} W={window} {bits} bits {sweeps} sweeps{gates},{stage}");
            costs.insert(key, count);
        }
        stack = stack.max(profile.stack.expect("a board's").used);
    }
    let sizes = Sizes::of(&program).expect("a program");
    for (what, size) in [("flash", sizes.flash), ("RAM", sizes.ram), ("stack", stack.into())] {
        costs.insert(format!("{name},bytes,{what}"), size);
    }
    Ok(costs)
}

/// The lines that grew, or are not in both.
fn grown(accepted: &Costs, found: &Costs) -> Vec<String> {
    let mut grown = Vec::new();
    for (key, &count) in found {
        match accepted.get(key) {
            Some(&before) if count as f64 <= before as f64 * (1.0 + GROWTH) => {}
            Some(&before) => {
                let percent = 100.0 * (count as f64 / before as f64 - 1.0);
                grown.push(format!("{key}: {count}, {percent:.1} % above {before}"));
            }
            None => grown.push(format!("{key}: {count}, not accepted yet")),
        }
    }
    grown
}

fn read(text: &str) -> Costs {
    let line = |line: &str| {
        let (key, count) = line.rsplit_once(',').expect("a count");
        (key.to_string(), count.parse().expect("a whole number"))
    };
    text.lines().map(line).collect()
}

#[test]
fn frames_and_programs_cost_what_was_accepted() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/costs.csv");
    let accepted = read(&std::fs::read_to_string(file).unwrap_or_default());
    let mut found = Costs::new();
    for (name, program) in [("qemu", qemu::program("server")), ("ibex", ibex::program("server"))] {
        match program.and_then(|program| costs(name, program)) {
            Ok(costs) => found.extend(costs),
            Err(error) if std::env::var_os("SPLASH_BOARDS").is_none() => {
                println!("skipped: {error}");
            }
            Err(error) => panic!("{error}"),
        }
    }
    if std::env::var_os("SPLASH_ACCEPT").is_some() {
        let all = accepted.into_iter().chain(found).collect::<Costs>();
        let lines = all.iter().map(|(key, count)| format!("{key},{count}\n"));
        return std::fs::write(file, lines.collect::<String>()).expect("a file");
    }
    let grown = grown(&accepted, &found);
    assert!(grown.is_empty(), "{grown:#?}\nSPLASH_ACCEPT=1 accepts them");
}

#[test]
fn growth_is_told_beyond_two_percent() {
    let accepted = read("a,frame,1000\nb,frame,1000\nc,frame,1000\n");
    let found = read("a,frame,1020\nb,frame,1021\nd,frame,1\n");
    let told = ["b,frame: 1021, 2.1 % above 1000", "d,frame: 1, not accepted yet"];
    assert_eq!(grown(&accepted, &found), told);
}
