//! `host-sim link`: an operator's actions, one after the other.

use super::output::report;
use super::progress;
use crate::board::{self, image};
use crate::cli::{Action, LinkArgs, Place};
use crate::error::{Error, refuse};
use crate::instrument::Instrument;
use crate::link::Transport;
use crate::link::calibrate::{Calibrated, CalibratedGate, Effort, calibrate};
use crate::link::light::{Light, Simulated};
use crate::link::operator::{Frames, Operator};
use crate::link::parameters::ulp_m;
use crate::link::recording::{Recording, Source, variant};
use crate::link::serial::Serial;
use crate::link::thread::Threaded;
use crate::reconstructor::Reconstructor;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use splash_firmware::fault::NAMES;
use splash_firmware::link::Identity;
use splash_firmware::mirror::Serials;
use splash_firmware::store::Stored;
use splash_firmware::telemetry::Decimation;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

/// Seconds without an answer after which a board is given up.
const PATIENCE: u32 = 60;
const SERIAL_PATIENCE: u32 = 5;

/// A board and what it is told.
struct Session {
    operator: Operator,
    identity: Identity,
    /// The description's.
    reconstructor: Reconstructor,
}

/// What an action found.
struct Found {
    table: Vec<(&'static str, String)>,
    json: Value,
}

/// Runs it.
///
/// # Errors
/// [`Error`] with the exit code that fits.
pub fn run(args: &LinkArgs) -> Result<(), Error> {
    let actions = args.actions()?;
    let reconstructor = described(&Instrument::described(args.config.as_deref())?)?;
    let mut session = open(args, reconstructor)?;
    let mut results = Vec::new();
    for action in &actions {
        let Found { table, json } = session.act(action)?;
        if !args.json {
            report(false, &(), &table)?;
        }
        results.push(json);
    }
    if args.json {
        let result = json!({ "board": session.operator.board(), "results": results });
        writeln!(std::io::stdout().lock(), "{result}")?;
    }
    Ok(())
}

/// The configuration of what is described, without a calibration.
fn described(instrument: &Instrument) -> Result<Reconstructor, Error> {
    instrument.check()?;
    progress::combine_gates(Reconstructor::new(instrument)?)
}

/// The board, with the description's configuration if it is emulated.
fn open(args: &LinkArgs, reconstructor: Reconstructor) -> Result<Session, Error> {
    let usual = if matches!(args.board, Place::Serial(_)) { SERIAL_PATIENCE } else { PATIENCE };
    let patience = Duration::from_secs(args.patience.unwrap_or(usual).into());
    let options = board::Options { patience, marks: false };
    let (name, transport): (_, Box<dyn Transport>) = match &args.board {
        Place::Serial(device) => {
            let line = Serial::open(device, args.baud, patience).map_err(|error| {
                Error::Config(format!("--board serial:{}: {error}", device.display()))
            })?;
            ("serial", Box::new(line))
        }
        Place::Host => ("host", Box::new(Threaded::start(&reconstructor.spec(), patience)?)),
        Place::Qemu => ("qemu", Box::new(board::qemu::start(options)?)),
        Place::Ibex => ("ibex", Box::new(board::ibex::start(options)?)),
    };
    let frames = match &args.board {
        Place::Serial(_) => Frames::There(Box::new(ask_for_light)),
        _ => Frames::Here(Box::new(Simulated::new(reconstructor.clone(), args.seed)?)),
    };
    let (operator, identity) = Operator::new(name, transport, frames)?;
    let mut session = Session { operator, identity, reconstructor };
    if session.operator.is_emulated() {
        let (image, count) = (session.uncalibrated()?, session.reconstructor.mask().count());
        session.operator.start(&image, count)?;
    }
    Ok(session)
}

/// Waits until whoever operates the instrument has seen to the light.
fn ask_for_light(light: Light) -> Result<(), Error> {
    eprint!("{light}, please; then Enter: ");
    std::io::stderr().flush()?;
    if std::io::stdin().read_line(&mut String::new())? == 0 {
        return Err(Error::Run(format!("nobody saw to it that there is {light}")));
    }
    Ok(())
}

impl Session {
    /// The image of the description's configuration, without a calibration.
    fn uncalibrated(&self) -> Result<Vec<u8>, Error> {
        Ok(image(&self.reconstructor.spec(), &[], 0)?)
    }

    fn upload(&mut self, image: &[u8]) -> Result<u32, Error> {
        let (bar, mut progress) = progress::fraction("upload");
        let hash = self.operator.upload(image, &mut progress);
        bar.finish_and_clear();
        Ok(hash?)
    }

    fn act(&mut self, action: &Action) -> Result<Found, Error> {
        let operator = &mut self.operator;
        match action {
            Action::Status => self.status(),
            Action::Counters => self.counters(),
            Action::Faults => self.faults(),
            Action::Get { name, index } => self.get(name, *index),
            Action::Set { name, values, index } => {
                let hash = operator.set(name, &values.0, *index)?;
                Ok(runs("set", hash))
            }
            Action::Upload { file } => {
                self.reconstructor = described(&Instrument::load(file)?)?;
                let image = self.uncalibrated()?;
                let hash = self.upload(&image)?;
                Ok(runs("upload", hash))
            }
            Action::ReadBack { file } => self.read_back(file),
            Action::Store => Ok(stored("store", operator.store()?)),
            Action::Stored => Ok(stored("stored", operator.stored()?)),
            Action::Restore => Ok(runs("restore", operator.restore()?)),
            Action::Mode { mode } => {
                operator.enter(mode.mode())?;
                Ok(done("mode", mode.mode().to_string()))
            }
            Action::Arm => {
                operator.arm()?;
                Ok(done("arm", "high voltage and laser on".into()))
            }
            Action::Disarm => {
                operator.disarm()?;
                Ok(done("disarm", "safe".into()))
            }
            Action::Poke { subaperture, piston, tip, tilt } => {
                operator.poke(*subaperture, [*piston, *tip, *tilt])?;
                Ok(done("poke", format!("segment {subaperture}: {piston}, {tip}, {tilt} m")))
            }
            Action::Gate { altitude, depth, zenith_angle } => {
                operator.gate([*altitude, *depth, *zenith_angle])?;
                Ok(done("gate", format!("{altitude} m, {depth} m, {zenith_angle} degrees")))
            }
            Action::Hardware { mirror, detector } => {
                operator.state_hardware(Serials { mirror: *mirror, detector: *detector })?;
                Ok(done("hardware", format!("mirror {mirror}, detector {detector}")))
            }
            Action::Light { light } => {
                if !operator.is_emulated() {
                    return Err(refuse("light", light.light(), "that of an emulated board"));
                }
                operator.set_light(light.light())?;
                Ok(done("light", light.light().to_string()))
            }
            Action::Frames { frames } => {
                operator.wait_for_frames(*frames)?;
                Ok(done("frames", frames.to_string()))
            }
            Action::Record { file, frames, seconds } => self.record(file, *frames, *seconds),
            Action::Calibrate { frames, averaged } => {
                self.calibrate(Effort { frames: *frames, averaged: *averaged })
            }
            Action::Calibration => {
                let calibration = operator.calibration()?;
                let quality = f64::from(calibration.quality_q16) / 65535.0;
                Ok(Found {
                    table: vec![
                        ("fingerprint", format!("{:08x}", calibration.fingerprint)),
                        ("quality", format!("{quality:.4}")),
                    ],
                    json: json!({
                        "action": "calibration",
                        "fingerprint": format!("{:08x}", calibration.fingerprint),
                        "quality": quality,
                    }),
                })
            }
        }
    }

    fn status(&mut self) -> Result<Found, Error> {
        let status = self.operator.status()?;
        let Identity { board, version, .. } = &self.identity;
        let (build, configuration) =
            (format!("{:08x}", status.build), format!("{:08x}", status.configuration));
        let draft = variant(&status.draft);
        let gate = status.gate;
        let [altitude_m, depth_m, zenith_deg] =
            [gate.range.altitude_mm, gate.range.depth_mm, gate.range.zenith_mdeg]
                .map(|thousandths| f64::from(thousandths) / 1e3);
        let on = |on: bool| if on { "on" } else { "off" };
        let table = vec![
            ("board", format!("{board}, version {version}")),
            ("build", build.clone()),
            ("configuration", configuration.clone()),
            ("mirror", format!("serial number {}", status.serials.mirror)),
            ("detector", format!("serial number {}", status.serials.detector)),
            ("mode", status.mode.to_string()),
            ("high voltage", on(status.outputs.high_voltage).into()),
            ("laser", on(status.outputs.laser).into()),
            ("other bank", draft.clone()),
            ("last frame", status.at.frame.to_string()),
            ("gate", format!("{altitude_m} m, {depth_m} m deep, {zenith_deg} degrees from zenith")),
            ("pulses", format!("{} of {}", gate.seen, gate.asked)),
            ("tilts", format!("{:.1} nm rms", status.tilt_rms_nm)),
        ];
        let json = json!({
            "action": "status", "board": board.as_str(), "version": version.as_str(),
            "build": build, "configuration": configuration,
            "mirror": status.serials.mirror, "detector": status.serials.detector,
            "mode": status.mode.to_string(), "high_voltage": status.outputs.high_voltage,
            "laser": status.outputs.laser, "other_bank": draft,
            "frame": status.at.frame, "ticks": status.at.ticks,
            "ticks_per_second": status.ticks_per_second,
            "gate": {
                "altitude_m": altitude_m, "depth_m": depth_m, "zenith_deg": zenith_deg,
                "delay_ticks": gate.delay, "width_ticks": gate.width,
                "pulses_asked": gate.asked, "pulses_seen": gate.seen,
            },
            "tilt_rms_nm": status.tilt_rms_nm,
        });
        Ok(Found { table, json })
    }

    fn counters(&mut self) -> Result<Found, Error> {
        let counters = self.operator.counters()?;
        let totals = counters.totals;
        let mut faults = serde_json::Map::new();
        let mut table = vec![
            ("frames that moved", totals.updated.to_string()),
            ("refused transitions", counters.refused_transitions.to_string()),
            ("unreadable messages", counters.unreadable_messages.to_string()),
        ];
        for (name, &count) in NAMES.into_iter().zip(&counters.faults) {
            faults.insert(name.into(), count.into());
            if count > 0 {
                table.push((name, count.to_string()));
            }
        }
        let json = json!({
            "action": "counters",
            "frames": {
                "updated": totals.updated, "cut_short": totals.cut_short,
                "wrong_row": totals.wrong_row, "no_light": totals.no_light,
            },
            "faults": faults,
            "refused_transitions": counters.refused_transitions,
            "unreadable_messages": counters.unreadable_messages,
        });
        Ok(Found { table, json })
    }

    fn faults(&mut self) -> Result<Found, Error> {
        let (faults, transitions) = self.operator.history()?;
        let mut table = Vec::new();
        for record in &faults {
            let text = format!("frame {}: {:?}", record.at.frame, record.fault);
            table.push(("fault", text));
        }
        for change in &transitions {
            let (from, to) = (change.from, change.to);
            let text = format!("frame {}: {from} to {to}, {:?}", change.at.frame, change.reason);
            table.push(("transition", text));
        }
        let json = json!({
            "action": "faults",
            "faults": faults.iter().map(|record| json!({
                "fault": NAMES[record.fault.kind()], "detail": format!("{:?}", record.fault),
                "frame": record.at.frame, "ticks": record.at.ticks,
            })).collect::<Vec<_>>(),
            "transitions": transitions.iter().map(|change| json!({
                "from": change.from.to_string(), "to": change.to.to_string(),
                "reason": format!("{:?}", change.reason),
                "frame": change.at.frame, "ticks": change.at.ticks,
            })).collect::<Vec<_>>(),
        });
        Ok(Found { table, json })
    }

    fn get(&mut self, name: &str, index: Option<u16>) -> Result<Found, Error> {
        let (parameter, values) = self.operator.get(name, index)?;
        let first = usize::from(index.unwrap_or(0));
        let mut table = Vec::new();
        for (i, values) in values.iter().enumerate() {
            let values: Vec<String> = values.iter().map(f64::to_string).collect();
            let place =
                if parameter.is_indexed() { format!("[{}]", first + i) } else { String::new() };
            table.push((parameter.name, format!("{place} {}", values.join(","))));
        }
        let json = json!({
            "action": "get", "name": parameter.name, "unit": parameter.unit, "first": first,
            "values": values,
        });
        Ok(Found { table, json })
    }

    fn read_back(&mut self, file: &Path) -> Result<Found, Error> {
        let image = self.operator.read_back()?;
        let hash = self.operator.status()?.configuration;
        std::fs::write(file, &image)
            .map_err(|error| Error::Run(format!("{}: {error}", file.display())))?;
        let sha256: String = Sha256::digest(&image).iter().map(|b| format!("{b:02x}")).collect();
        Ok(Found {
            table: vec![
                ("file", format!("{}, {} bytes", file.display(), image.len())),
                ("configuration", format!("{hash:08x}")),
                ("sha256", sha256.clone()),
            ],
            json: json!({
                "action": "read-back", "file": file.display().to_string(), "bytes": image.len(),
                "configuration": format!("{hash:08x}"), "sha256": sha256,
            }),
        })
    }

    fn calibrate(&mut self, effort: Effort) -> Result<Found, Error> {
        let bar = progress::share("calibration".into());
        let reconstructor = self.reconstructor.clone();
        let found = calibrate(&mut self.operator, reconstructor, effort, &mut |what, done| {
            bar.set_message(what);
            bar.set_position((1000.0 * done) as u64);
        });
        bar.finish_and_clear();
        let Calibrated { hash, bad_pixels, dark_adu, noise_adu, gain_e_per_adu, gates } = found?;
        let mut table = vec![
            ("dark level", format!("{dark_adu:.2} ADU, noise {noise_adu:.3} ADU")),
            ("detector's gain", format!("{gain_e_per_adu:.3} electrons per ADU")),
            ("bad pixels", bad_pixels.to_string()),
        ];
        let mut json = json!({
            "action": "calibrate", "dark_adu": dark_adu, "noise_adu": noise_adu,
            "gain_e_per_adu": gain_e_per_adu, "bad_pixels": bad_pixels,
            "configuration": format!("{hash:08x}"),
        });
        for (i, gate) in gates.iter().enumerate() {
            if i > 0 {
                table.push(("second gate", String::new()));
                json["second_gate"] = gate_json(gate);
            } else if let (Value::Object(all), Value::Object(gate)) = (&mut json, gate_json(gate)) {
                all.extend(gate);
            }
            table.extend(gate_table(gate));
        }
        table.push(("configuration", format!("{hash:08x}")));
        Ok(Found { table, json })
    }

    fn record(&mut self, file: &Path, frames: u32, seconds: Option<f64>) -> Result<Found, Error> {
        let limit = "above 0 and at most 1e6";
        if let Some(seconds) = seconds.filter(|seconds| !(*seconds > 0.0 && *seconds <= 1e6)) {
            return Err(refuse("--seconds", seconds, limit));
        }
        let operator = &mut self.operator;
        let mut recording = Recording::new(operator.subapertures()?, operator.windows()?);
        // A pipe carries everything.
        let all = Decimation { frames: 1, slopes: 1, commands: 1, codes: 1, fluxes: 1 };
        let streams = operator.subscribe(operator.is_emulated().then_some(all))?;
        let until = seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let bar = progress::bar(u64::from(frames), "recording", "frames");
        loop {
            let finished = match until {
                Some(until) => Instant::now() >= until,
                None => recording.frames().len() >= frames as usize,
            };
            if finished {
                break;
            }
            operator.listen()?.into_iter().for_each(|record| recording.take(record));
            bar.set_position(recording.frames().len() as u64);
        }
        bar.finish_and_clear();
        let dropped = operator.dropped()?;
        operator.subscribe(Some(Decimation::OFF))?;
        let (status, head, image) = (operator.status()?, operator.head()?, operator.read_back()?);
        let source = Source {
            identity: &self.identity,
            status: &status,
            head: &head,
            image: &image,
            dropped,
        };
        recording.write(file, &source)?;
        let [frames, slopes, commands, codes, fluxes] = recording.counts();
        let faults = recording.faults().len();
        let dropped: u32 = dropped.iter().fold(0, |sum, &dropped| sum.saturating_add(dropped));
        let every =
            [streams.frames, streams.slopes, streams.commands, streams.codes, streams.fluxes];
        Ok(Found {
            table: vec![
                ("file", file.display().to_string()),
                ("frames", frames.to_string()),
                (
                    "streams",
                    format!(
                        "slopes {slopes}, commands {commands}, codes {codes}, fluxes {fluxes} frames"
                    ),
                ),
                ("faults", faults.to_string()),
                ("dropped", format!("{dropped} records, {} frames cut", recording.cut())),
            ],
            json: json!({
                "action": "record", "file": file.display().to_string(), "frames": frames,
                "slopes": slopes, "commands": commands, "codes": codes, "fluxes": fluxes,
                "faults": faults, "every": every, "dropped": dropped, "cut": recording.cut(),
                "build": format!("{:08x}", status.build),
                "configuration": format!("{:08x}", status.configuration),
                "ulp_m": ulp_m(&head),
            }),
        })
    }
}

fn gate_table(gate: &CalibratedGate) -> Vec<(&'static str, String)> {
    let arrangement = match gate.arrangement {
        Some((0, false)) => "each window has its segment's spot".into(),
        Some((degrees, false)) => format!("turned by {degrees} degrees"),
        Some((degrees, true)) => format!("x reflected, then turned by {degrees} degrees"),
        None => "no turn or reflection of the pupil".into(),
    };
    let reflected = if gate.reflected { ", x reflected before" } else { "" };
    vec![
        ("spots", arrangement),
        ("motion", format!("turned by {:.2} degrees{reflected}", gate.rotation_deg)),
        ("centroid gain", format!("{:.4}", gate.centroid_gain)),
        ("centroid noise", format!("{:.5} px", gate.noise_px)),
        ("pistons", format!("{:.5} px for a quarter wavelength", gate.piston_px)),
        ("quality", format!("{:.4}", gate.quality)),
    ]
}

fn gate_json(gate: &CalibratedGate) -> Value {
    json!({
        "windows": gate.windows,
        "turned_deg": gate.arrangement.map(|(degrees, _)| degrees),
        "x_reflected": gate.arrangement.map(|(_, reflected)| reflected),
        "motion_deg": gate.rotation_deg, "motion_reflected": gate.reflected,
        "centroid_gain": gate.centroid_gain, "noise_px": gate.noise_px,
        "piston_px": gate.piston_px, "quality": gate.quality,
    })
}

fn done(action: &'static str, what: String) -> Found {
    let json = json!({ "action": action, "done": what });
    Found { table: vec![(action, what)], json }
}

fn runs(action: &'static str, hash: u32) -> Found {
    let hash = format!("{hash:08x}");
    let json = json!({ "action": action, "configuration": hash });
    Found { table: vec![("configuration", hash)], json }
}

fn stored(action: &'static str, stored: Option<Stored>) -> Found {
    let Some(Stored { sequence, hash, length, serials: Serials { mirror, detector } }) = stored
    else {
        return Found {
            table: vec![(action, "nothing".into())],
            json: json!({ "action": action, "stored": null }),
        };
    };
    let hash = format!("{hash:08x}");
    Found {
        table: vec![
            (action, format!("configuration {hash}, {length} bytes, store {sequence}")),
            ("with it", format!("mirror {mirror}, detector {detector}")),
        ],
        json: json!({
            "action": action,
            "stored": {
                "configuration": hash, "bytes": length, "sequence": sequence,
                "mirror": mirror, "detector": detector,
            },
        }),
    }
}
