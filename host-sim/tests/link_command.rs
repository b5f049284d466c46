//! `host-sim link`, on the host and at the end of a serial line, which is a pseudo-terminal with the
//! server of the emulated boards behind it: its frames come by themselves.

use host_sim::files::fits::FitsReader;
use host_sim::instrument::Instrument;
use host_sim::link::light::{Light, Scene, Simulated};
use host_sim::reconstructor::Reconstructor;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;
use splash_firmware::banks::Banks;
use splash_firmware::config::Config;
use splash_firmware::link::{Message, Receiver, Request, Response, Stack, WIRE, encode};
use splash_firmware::telemetry::Ring;
use splash_server::{NoFlash, Port, controller, serve};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Error, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Four subapertures across, little windows: quick.
const SMALL: &str = "[telescope]\nsubapertures = 4\n[windows]\nsize = 8\nspacing_px = 8\n";
/// More than any wait that is to end.
const BOUND: Duration = Duration::from_secs(20);
/// Number of the requests by which the board's frames come: the PC's are lower.
const OWN: u16 = u16::MAX;

fn small(directory: &Path) -> PathBuf {
    let file = directory.join("small.toml");
    std::fs::write(&file, SMALL).unwrap();
    file
}

fn two_gates(directory: &Path) -> PathBuf {
    let file = directory.join("two_gates.toml");
    std::fs::write(&file, format!("{SMALL}[second_gate]\nheight_m = 6000\n")).unwrap();
    file
}

fn link(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command.arg("link").args(arguments).stdin(Stdio::null());
    command
}

fn run(arguments: &[&str]) -> Output {
    link(arguments).output().unwrap()
}

/// The results of a script that works.
fn results(board: &str, config: &Path, lines: &str) -> Vec<Value> {
    let script = config.with_extension("script");
    std::fs::write(&script, lines).unwrap();
    let (config, script) = (config.to_str().unwrap(), script.to_str().unwrap());
    let output = run(&["--board", board, "--config", config, "--script", script, "--json"]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    json["results"].as_array().unwrap().clone()
}

/// Exit code and message of a command that fails.
fn failure(arguments: &[&str]) -> (Option<i32>, String) {
    let start = Instant::now();
    let output = run(arguments);
    assert!(start.elapsed() < BOUND, "{arguments:?}: {:?}", start.elapsed());
    assert!(output.stdout.is_empty(), "{arguments:?}");
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    (output.status.code(), text.trim().into())
}

#[test]
fn arguments_that_cannot_be_are_named() {
    let cases = [
        (&["--board", "moon", "status"][..], "must be host, qemu, ibex or serial:DEVICE"),
        (&["--board", "host"], "an action or --script FILE"),
        (&["--board", "serial:/nowhere", "status"], "--board serial:/nowhere: No such file"),
        (&["--board", "serial:/dev/null", "status"], "--board serial:/dev/null: "),
        (&["--board", "host", "get", "gain"], "parameter \"gain\": there is none of that name"),
        (
            &["--board", "host", "set", "control.gain", "2.5"],
            "control.gain[0] = 2.5: must be from 0.0001220703125 to 1.9998779296875",
        ),
        (&["--board", "host", "set", "sor.sweeps", "1.5"], "sor.sweeps = 1.5: must be a whole"),
        (
            &["--board", "host", "set", "sor.sweeps", "1001"],
            "sor.sweeps = 1001: must be from 1 to 1000",
        ),
        (
            &["--board", "host", "set", "sor.omega", "NaN"],
            "sor.omega = NaN: must be from 1 to 1.99",
        ),
        (
            &["--board", "host", "set", "slopes.reference_px", "1"],
            "slopes.reference_px[0] = 1 values: must be 2",
        ),
        (&["--board", "host", "get", "control.gain", "52"], "52"),
        (
            &["--board", "host", "get", "modal.reference_px"],
            "modal.reference_px: the running configuration has none",
        ),
        (&["--board", "host", "set", "modal.flux_min_adu", "1", "0"], "modal.flux_min_adu: the"),
        (&["--board", "host", "get", "sor.omega", "0"], "without an index"),
        (
            &["--board", "host", "record", "x.fits", "--seconds", "-1"],
            "--seconds = -1: must be above 0",
        ),
        (&["--board", "host", "gate", "0", "100", "0"], "gate altitude = 0 mm: must be from 1"),
        (&["--board", "host", "upload", "/nowhere.toml"], "/nowhere.toml"),
    ];
    for (arguments, expected) in cases {
        let (code, text) = failure(arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {text}");
        assert!(text.contains(expected), "{arguments:?}: {text}");
    }
}

#[test]
fn a_script_is_read_before_the_board_is_started() {
    let directory = tempfile::TempDir::new().unwrap();
    let script = directory.path().join("script");
    std::fs::write(&script, "status # how is it\n\nmode flying\n").unwrap();
    let (code, text) = failure(&["--board", "qemu", "--script", script.to_str().unwrap()]);
    assert_eq!(code, Some(2));
    assert!(text.contains("line 3: invalid value 'flying'"), "{text}");
}

#[test]
fn the_loop_is_not_closed_without_a_calibration() {
    let directory = tempfile::TempDir::new().unwrap();
    let script = directory.path().join("script");
    std::fs::write(&script, "mode standby\narm\nmode closed-loop\n").unwrap();
    let (code, text) =
        failure(&["--board", "host", "--json", "--script", script.to_str().unwrap()]);
    assert_eq!(code, Some(1));
    let expected = "error: board host: configuration without a calibration";
    assert!(text.starts_with(expected), "{text}");
}

/// Parameters come back as they were set, to the step of their format.
#[test]
fn parameters_are_set_in_physical_units() {
    let directory = tempfile::TempDir::new().unwrap();
    let set = [
        ("control.gain", "0.3", "", 1.0 / 8192.0),
        ("control.lever_arm", "1.13", "3", 1.0 / 2457.0),
        ("control.delay_frames", "2", "", 0.0),
        ("estimator.peak_fraction", "0.1", "", 1.0 / 65536.0),
        ("segments.slew_m_per_frame", "1e-6", "", 1e-12),
        ("safety.leak", "0.05", "", 1.0 / 65536.0),
        ("safety.flux_min_adu", "12345", "", 1.0),
        ("sor.omega", "1.5", "", 0.0),
        ("slopes.reference_px", "0.25,-1.5", "7", 1.0 / 65536.0),
        ("slopes.flux_min_adu", "321", "", 1.0),
        // Both gates' gains have one exponent, by the second's wider pixels: half a step of 2^9 ulp of 8 um / 2^25.
        ("slopes.gain_m_per_px", "1e-7,-2e-8,3e-8,-1.1e-7", "0", 6.11e-11),
        ("modal.reference_px", "-0.75,0.5", "7", 1.0 / 65536.0),
        ("modal.flux_min_adu", "123", "", 1.0),
        ("modal.gain_m_per_px", "2e-7,-2e-8,3e-8,-1.1e-7", "0", 6.11e-11),
    ];
    let mut lines = String::new();
    for (name, values, index, _) in set {
        lines += &format!("set {name} {values} {index}\nget {name} {index}\n");
    }
    let found = results("host", &two_gates(directory.path()), &lines);
    for ((name, values, _, step), pair) in set.iter().zip(found.chunks(2)) {
        let first = pair[1]["values"][0].as_array().unwrap();
        let expected = values.split(',').map(|value| value.parse::<f64>().unwrap());
        for (found, expected) in first.iter().zip(expected) {
            let error = (found.as_f64().unwrap() - expected).abs();
            assert!(error <= *step, "{name} = {found}: {expected}");
        }
        assert_ne!(pair[0]["configuration"], "00000000");
    }
}

/// The configuration of an emulated board can be stored, changed, restored; its hash says which runs.
#[test]
fn a_stored_configuration_comes_back() {
    let directory = tempfile::TempDir::new().unwrap();
    let image = directory.path().join("image");
    let lines = format!(
        "stored\nstore\nset control.gain 0.25\nrestore\nread-back {}\nget control.gain 0\n",
        image.display()
    );
    let found = results("host", &small(directory.path()), &lines);
    assert_eq!(found[0]["stored"], Value::Null);
    let stored = &found[1]["stored"]["configuration"];
    assert_ne!(&found[2]["configuration"], stored);
    assert_eq!(&found[3]["configuration"], stored);
    assert_eq!(&found[4]["configuration"], stored);
    let bytes = std::fs::read(image).unwrap();
    assert_eq!(found[4]["bytes"], bytes.len());
    // The hash is the checksum at the image's end.
    let hash = u32::from_le_bytes(*bytes.last_chunk().unwrap());
    assert_eq!(stored, &format!("{hash:08x}"));
    assert_eq!(found[5]["values"][0][0], 0.5);
}

#[test]
fn telemetry_is_recorded_with_hashes_and_serials() {
    let directory = tempfile::TempDir::new().unwrap();
    let config = small(directory.path());
    std::fs::write(&config, format!("{SMALL}[serials]\nmirror = 17\ndetector = 4711\n")).unwrap();
    let file = directory.path().join("run.fits");
    let lines = format!(
        "calibrate --averaged 2\nlight sky\nmode closed-loop\nrecord {} --frames 20\nstatus\n",
        file.display()
    );
    let found = results("host", &config, &lines);
    assert!(found[0]["quality"].as_f64().unwrap() > 0.9, "{}", found[0]);
    assert_eq!((&found[3]["frames"], &found[3]["fluxes"]), (&20.into(), &20.into()));
    assert_eq!((&found[3]["dropped"], &found[3]["cut"]), (&0.into(), &0.into()));
    let reader = FitsReader::open(&file).unwrap();
    for hdu in reader.hdus() {
        let text = |key| hdu.header.text(key).map(str::to_owned);
        assert_eq!(text("BUILD").as_deref(), found[4]["build"].as_str());
        assert_eq!(text("CONFHASH").as_deref(), found[4]["configuration"].as_str());
        assert_eq!(hdu.header.int("CFMIRROR"), Some(17));
        assert_eq!(hdu.header.int("CFDETECT"), Some(4711));
    }
    let script = r#"
import sys
import numpy as np
from astropy.io import fits
with fits.open(sys.argv[1], checksum=True) as hdus:
    hdus.verify("exception")
    assert [h.name for h in hdus] == ["CONFIG", "FRAMES", "SLOPES", "COMMANDS", "CODES", "FLUXES", "FAULTS"]
    frames = hdus["FRAMES"].data
    assert len(frames) == 20 and np.all(np.diff(frames["FRAME"]) == 1)
    assert np.all(frames["MODE"] == "closed loop") and np.all(frames["UPDATED"])
    assert np.all(frames["ALTITUDE"] == 12000.0) and np.all(frames["SEEN"] == 10)
    assert np.all(frames["CONFIG"] == int(hdus[0].header["CONFHASH"], 16))
    slopes = hdus["SLOPES"].data
    assert slopes["SLOPE"].shape == (20, 24) and slopes["VALID"].all()
    assert 1e-10 < np.std(slopes["SLOPE"]) < 1e-6
    assert hdus["CODES"].data["CODE"].shape == (20, 36)
    assert hdus["COMMANDS"].data["POSITION"].shape == (20, 36)
    fluxes = hdus["FLUXES"].data
    assert np.all(np.abs(fluxes["CENTROID"]) < 4) and np.all(fluxes["FLUX"] > 100)
"#;
    in_python(script, &file);
}

/// What is recorded of two gates has a row a frame as well, the second's windows behind the first's.
#[test]
fn telemetry_of_two_gates_is_recorded() {
    let directory = tempfile::TempDir::new().unwrap();
    let file = directory.path().join("run.fits");
    let lines = format!(
        "calibrate --averaged 2\nlight sky\nmode closed-loop\nrecord {} --frames 10\n",
        file.display()
    );
    let found = results("host", &two_gates(directory.path()), &lines);
    let windows: Vec<usize> = (0..12).collect();
    for gate in [&found[0], &found[0]["second_gate"]] {
        assert_eq!(gate["windows"], Value::from(windows.clone()));
        assert!(gate["quality"].as_f64().unwrap() > 0.9, "{gate}");
    }
    assert_eq!((&found[3]["frames"], &found[3]["fluxes"]), (&10.into(), &10.into()));
    assert_eq!((&found[3]["dropped"], &found[3]["cut"]), (&0.into(), &0.into()));
    let script = r#"
import sys
import numpy as np
from astropy.io import fits
with fits.open(sys.argv[1], checksum=True) as hdus:
    hdus.verify("exception")
    assert hdus[0].header["NSUB"] == 12 and hdus[0].header["NWINDOWS"] == 24
    slopes, fluxes = hdus["SLOPES"].data, hdus["FLUXES"].data
    assert slopes["SLOPE"].shape == (10, 48) and slopes["VALID"].shape == (10, 24)
    assert slopes["VALID"].all()
    assert fluxes["CENTROID"].shape == (10, 48) and np.all(fluxes["FLUX"] > 100)
    # By the lidar equation the nearer gate is the brighter one.
    first, second = fluxes["FLUX"][:, :12], fluxes["FLUX"][:, 12:]
    assert second.mean() > first.mean()
    assert hdus["COMMANDS"].data["POSITION"].shape == (10, 36)
    assert hdus["CODES"].data["CODE"].shape == (10, 36)
"#;
    in_python(script, &file);
}

/// Runs a script on a file, where there is astropy.
fn in_python(script: &str, file: &Path) {
    let python = std::env::var("SPLASH_PYTHON").ok();
    let interpreter = python.as_deref().unwrap_or("python3");
    let astropy = Command::new(interpreter).args(["-c", "import astropy.io.fits"]).output();
    if !astropy.is_ok_and(|output| output.status.success()) {
        assert!(python.is_none(), "SPLASH_PYTHON={interpreter} cannot import astropy");
        println!("skipped: {interpreter} has no astropy (set SPLASH_PYTHON)");
        return;
    }
    let output = Command::new(interpreter).arg("-c").arg(script).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Whoever has put another mirror in says so; what was made for the one before is not armed.
#[test]
fn hardware_is_stated_and_compared() {
    let directory = tempfile::TempDir::new().unwrap();
    let config = small(directory.path());
    std::fs::write(&config, format!("{SMALL}[serials]\nmirror = 17\n")).unwrap();
    let found = results("host", &config, "hardware 17 4\nstore\nstatus\n");
    assert_eq!(
        (&found[1]["stored"]["mirror"], &found[1]["stored"]["detector"]),
        (&17.into(), &4.into())
    );
    assert_eq!((&found[2]["mirror"], &found[2]["detector"]), (&17.into(), &4.into()));
    let script = directory.path().join("other.script");
    std::fs::write(&script, "hardware 18 4\narm\n").unwrap();
    let [config, script] = [&config, &script].map(|path| path.to_str().unwrap());
    let (code, message) =
        failure(&["--board", "host", "--config", config, "--script", script, "--json"]);
    assert_eq!(code, Some(1), "{message}");
    assert!(message.contains("serials.mirror = 17: must be 18, or 0 for any"), "{message}");
    let again = "hardware 18 4\nhardware 17 4\narm\n";
    assert_eq!(results("host", Path::new(config), again).len(), 3);
}

/// The board's end of a serial line. Where no request comes, a frame does.
struct Line {
    master: File,
    inbox: VecDeque<u8>,
    /// The last byte ended a message.
    between: bool,
    scene: Simulated,
    light: Arc<Mutex<Light>>,
    codes: Vec<[u16; 3]>,
    frame: Vec<u16>,
    read: usize,
    width: usize,
    number: u32,
    receiver: Receiver,
}

impl Line {
    /// What has come on the line within a moment.
    fn listen(&mut self) -> Result<(), Error> {
        let mut fds = [PollFd::new(&self.master, PollFlags::IN)];
        let moment = Timespec { tv_sec: 0, tv_nsec: 200_000 };
        if poll(&mut fds, Some(&moment)).map_err(Error::from)? > 0 {
            let mut bytes = [0; 4096];
            let read = self.master.read(&mut bytes)?;
            self.inbox.extend(&bytes[..read]);
        }
        Ok(())
    }
}

impl Port for Line {
    type Error = Error;
    type Flash = NoFlash;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Error> {
        for byte in bytes {
            while self.inbox.is_empty() {
                self.listen()?;
                if self.inbox.is_empty() && self.between {
                    let (number, pixels) = (self.number, self.frame.len() as u32);
                    self.number += 1;
                    let request = Request::Frame { number, pixels };
                    let mut wire = [0; WIRE];
                    let message = Message { sequence: OWN, body: request };
                    self.inbox.extend(encode(&message, &mut wire).unwrap());
                }
            }
            *byte = self.inbox.pop_front().unwrap();
            self.between = *byte == 0;
        }
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Error> {
        // What its own frames leave is nobody's business.
        for &byte in bytes {
            if let Some(Ok(message)) = self.receiver.push::<Response>(byte)
                && message.sequence == OWN
            {
                return Ok(());
            }
        }
        self.master.write_all(bytes)
    }

    fn expose(&mut self, _: usize, width: usize) -> Result<(), Error> {
        self.scene.set_light(*self.light.lock().unwrap()).unwrap();
        self.frame = self.scene.expose(&self.codes).unwrap().to_vec();
        (self.read, self.width) = (0, width);
        Ok(())
    }

    fn rows(&mut self) -> Result<Option<&[u16]>, Error> {
        let start = self.read;
        self.read = self.frame.len().min(start + self.width);
        Ok(self.frame.get(start..self.read).filter(|row| !row.is_empty()))
    }

    fn actuate(&mut self, codes: &[[u16; 3]]) -> Result<(), Error> {
        self.codes = codes.to_vec();
        Ok(())
    }

    fn stack(&self) -> Stack {
        Stack { used: 0, reserved: 0 }
    }

    fn mark() {}
}

/// A pseudo-terminal: the board's end, and the name of the PC's.
fn terminal() -> (File, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (File::from(master), name)
}

/// A board at the end of a serial line, with this light on its detector.
fn serial_board(light: &Arc<Mutex<Light>>) -> (String, File) {
    let (master, name) = terminal();
    // Held open, so that the board does not see the line end between two commands.
    let held = File::options().read(true).write(true).open(&name).unwrap();
    let light = Arc::clone(light);
    let serve_it = move || {
        let instrument = Instrument::parse(SMALL, "small").unwrap();
        let mut line = Line {
            master,
            inbox: VecDeque::new(),
            between: true,
            scene: Simulated::new(Reconstructor::new(&instrument).unwrap(), 1).unwrap(),
            light,
            codes: Vec::new(),
            frame: vec![0; 32 * 32],
            read: 0,
            width: 1,
            number: 0,
            receiver: Receiver::new(),
        };
        let [mut running, mut other] = [(); 2].map(|()| Box::new(Config::<64, 4096, 0>::new()));
        let (mut control, mut ring) = (Box::new(controller()), Box::new(Ring::<18>::new()));
        let banks = Banks::new(&mut running, &mut other);
        serve(&mut line, "line", banks, &mut control, &mut ring);
    };
    std::thread::Builder::new().stack_size(64 << 20).spawn(serve_it).unwrap();
    (format!("serial:{name}"), held)
}

#[test]
fn a_serial_line_is_operated_as_any_board() {
    let directory = tempfile::TempDir::new().unwrap();
    let config = small(directory.path());
    let light = Arc::new(Mutex::new(Light::Bench));
    let (board, _held) = serial_board(&light);
    let (image, file) = (directory.path().join("image"), directory.path().join("run.fits"));
    let lines = format!(
        "status\nupload {}\nset control.gain 0.4\nget control.gain 2\nread-back {}\n\
         # Safe, the mirror goes to flat.\ndisarm\nframes 20\nmode standby\narm\nmode test-pattern\npoke 3 1e-7 2e-8 -3e-8\nframes 5\n\
         record {} --frames 10\ncounters\nfaults\nstatus\ndisarm\n",
        config.display(),
        image.display(),
        file.display()
    );
    let found = results(&board, &config, &lines);
    assert_eq!(found[0]["configuration"], "00000000");
    let gain = found[3]["values"][0][0].as_f64().unwrap();
    assert!((gain - 0.4).abs() < 1.0 / 8192.0, "{gain}");
    assert_eq!(found[4]["bytes"], std::fs::metadata(&image).unwrap().len());
    let [recorded, _, _, status, _] = found.last_chunk().unwrap();
    assert!(recorded["frames"].as_u64() >= Some(10), "{recorded}");
    assert_eq!(status["mode"], "test pattern");
    assert_eq!(status["configuration"], found[4]["configuration"]);
    assert_eq!((&status["laser"], &status["high_voltage"]), (&true.into(), &true.into()));
}

/// Whoever operates the instrument is asked for the light.
#[test]
fn a_board_on_a_serial_line_is_calibrated() {
    let directory = tempfile::TempDir::new().unwrap();
    let config = small(directory.path());
    let light = Arc::new(Mutex::new(Light::Bench));
    let (board, _held) = serial_board(&light);
    let script = directory.path().join("script");
    let lines = format!(
        "upload {}\ncalibrate --frames 4 --averaged 2\ncalibration\nmode closed-loop\nstatus\n",
        config.display()
    );
    std::fs::write(&script, lines).unwrap();
    let (config, script) = (config.to_str().unwrap(), script.to_str().unwrap());
    let mut child = link(&["--board", &board, "--config", config, "--script", script, "--json"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = String::new();
    let (mut stderr, mut stdin) = (child.stderr.take().unwrap(), child.stdin.take().unwrap());
    let asked = [
        (Light::Dark, "no light on the detector"),
        (Light::Even, "even light on the detector"),
        (Light::Bench, "the spots on the detector"),
    ];
    for (asked, words) in asked {
        let mut byte = [0];
        while !said.ends_with("then Enter: ") {
            assert_eq!(stderr.read(&mut byte).unwrap(), 1, "{said}");
            said.push(char::from(byte[0]));
        }
        assert!(said.contains(words), "{said}");
        said.clear();
        *light.lock().unwrap() = asked;
        // A frame or two with the light as it was.
        std::thread::sleep(Duration::from_millis(50));
        writeln!(stdin).unwrap();
    }
    let output = child.wait_with_output().unwrap();
    stderr.read_to_string(&mut said).unwrap();
    assert!(output.status.success(), "{said}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [_, calibrated, _, _, status] = json["results"].as_array().unwrap().as_slice() else {
        panic!("{json}");
    };
    let windows: Vec<u64> = (0..12).collect();
    assert_eq!(calibrated["windows"], Value::from(windows));
    assert!(calibrated["quality"].as_f64().unwrap() > 0.9, "{calibrated}");
    assert_eq!(status["mode"], "closed loop");
}

/// Has nobody at the other end of the line.
fn silent(_: &mut File) -> Result<(), Error> {
    std::thread::sleep(BOUND);
    Ok(())
}

/// Talks nonsense.
fn babbling(line: &mut File) -> Result<(), Error> {
    loop {
        line.write_all(&[1, 2, 3, 0])?;
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Hangs up when it is spoken to.
fn leaving(line: &mut File) -> Result<(), Error> {
    line.read_exact(&mut [0; 4])
}

#[test]
fn a_line_without_a_board_ends_in_bounded_time() {
    type Manner = fn(&mut File) -> Result<(), Error>;
    let cases: [(Manner, &str); 3] = [
        (silent, "no answer within 1 s, when it was asked what it is"),
        (babbling, "messages that cannot be read, when it was asked what it is"),
        (leaving, "it closed the link, when it was asked what it is"),
    ];
    for (manner, expected) in cases {
        let (mut master, name) = terminal();
        std::thread::spawn(move || manner(&mut master));
        let board = format!("serial:{name}");
        let (code, text) = failure(&["--board", &board, "--patience", "1", "status"]);
        assert_eq!(code, Some(1), "{text}");
        assert!(text.starts_with("error: board serial: ") && text.ends_with(expected), "{text}");
    }
}
