//! Faults by the thousand in a closed loop, and what must hold after each step of the controller.
//!
//! The loop runs in this process, on the quick sky of [`crate::quick`], through the same
//! [`Controller`] as on a board. [`Mishap`]s come at random; an operator closes the loop again whenever
//! it has been given up or opened.
//!
//! | what | holds if |
//! |---|---|
//! | codes | inside the actuators' limits and the slew limit, in every step |
//! | state | inside its formats |
//! | mode | reached by a legal way; a closed loop has high voltage and laser |
//! | configuration | the one that runs is the one that was last switched to, whatever the link and the flash go through |
//! | counters | those of the controller are those counted here, kind by kind |
//! | recovery | the loop closes again within [`RECOVERY`] frames of the operator's first attempt |
//! | correction | a loop that has been closed and whole for [`WHOLE`] frames keeps its spots in place |
//! | repeatability | the same seed gives the same digest |

mod desk;
mod invariants;
mod ledger;
mod mishap;
mod operator;
mod plant;

pub use ledger::Line;
pub use mishap::{MISHAPS, Mishap};

use crate::error::Error;
use crate::instrument::Instrument;
use crate::reconstructor::Reconstructor;
use crate::summary::CodeDigest;
use desk::Desk;
use invariants::Invariants;
use ledger::Ledger;
use operator::Operator;
use plant::Plant;
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use splash_firmware::banks::{Banks, DraftState};
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, Start};
use splash_firmware::fault::Fault;
use splash_firmware::gate::GateStamp;
use splash_firmware::interlock::{Inputs, Times};
use splash_firmware::link::Request;
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::RowError;
use splash_firmware::store::Store;

/// Mean number of frames between two mishaps.
const GAP: f64 = 30.0;
/// Longest that something stays broken, frames.
const LONGEST: u32 = 60;
/// Frames within which the operator closes the loop again once nothing keeps it open: the mirror ramps to
/// flat, the high voltage settles, and attempts come every few frames.
pub const RECOVERY: u64 = 200;
/// Frames after which a closed loop without mishaps has converged.
pub const WHOLE: u64 = 40;
/// Spots of such a loop are as far from their reference at most, rms, px: three times what seeing twice as
/// good to twice as bad as nominal leaves.
const IN_PLACE_PX: f64 = 1.0;
/// Ticks of the board's clock in a frame: microseconds of the default instrument.
const FRAME_TICKS: u64 = 1000;
/// Steps of a store, and some: an image of the default instrument in words of 32 bytes, and pages.
const STEPS: usize = 4000;
/// Rows that come at once.
const BLOCK: usize = 16;

const CELLS: usize = 64;
const PIXELS: usize = 16_384;

type Bank = Config<CELLS, PIXELS, PIXELS>;

/// Why there are banks.
const THERE: &str = "banks are taken only to be put back";

/// The memory of both banks.
pub struct Memory([Box<Bank>; 2]);

impl Default for Memory {
    fn default() -> Self {
        Self([(); 2].map(|()| Box::new(Bank::new())))
    }
}

/// The campaign.
pub struct FaultCampaign<'a> {
    /// `None` only while the board starts anew.
    banks: Option<Banks<'a, CELLS, PIXELS, PIXELS>>,
    desk: Desk,
    /// Hash of the configuration that must run.
    runs: u32,
    /// One that must run from the next frame boundary on.
    ordered: Option<u32>,
    /// Hashes of which one must be in flash; `None`: nothing needs to be.
    stored: Option<[u32; 2]>,
    controller: Box<Controller<CELLS, PIXELS>>,
    plant: Plant,
    operator: Operator,
    invariants: Invariants,
    ledger: Ledger,
    random: Xoshiro256PlusPlus,
    digest: CodeDigest,
    /// Until when an input is missing, frames.
    no_permit: u64,
    no_voltage: u64,
    /// Frames so far, and the detector's number of the next one.
    frame: u64,
    number: u32,
    /// Frames since anything was wrong.
    whole: u64,
}

impl<'a> FaultCampaign<'a> {
    /// A campaign of a seed, with an instrument that the default capacities hold.
    ///
    /// # Errors
    /// [`Error`] for an instrument that cannot be.
    pub fn new(
        memory: &'a mut Memory,
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        seed: u64,
    ) -> Result<Self, Error> {
        let [running, other] = memory.0.each_mut();
        let mut campaign = Self {
            banks: Some(Banks::new(running, other)),
            desk: Desk::new(reconstructor, seed)?,
            runs: 0,
            ordered: None,
            stored: None,
            controller: controller(),
            plant: Plant::new(instrument, reconstructor, seed)?,
            operator: Operator::new(),
            invariants: Invariants::new(instrument),
            ledger: Ledger::new(),
            random: Xoshiro256PlusPlus::seed_from_u64(seed),
            digest: CodeDigest::default(),
            no_permit: 0,
            no_voltage: 0,
            frame: 0,
            number: 0,
            whole: 0,
        };
        campaign.start()?;
        Ok(campaign)
    }

    /// A board that has just been switched on, or has started anew: it runs what is stored, or what
    /// it is sent.
    fn start(&mut self) -> Result<(), Error> {
        self.controller = controller();
        if let Some(banks) = self.banks.take() {
            let [running, other] = banks.into_banks();
            (*running, *other) = (Bank::new(), Bank::new());
            self.banks = Some(Banks::new(running, other));
        }
        self.desk.flash.steps = None;
        self.send(&desk::wire(Request::Restore));
        let restored = matches!(self.banks().draft.state(), DraftState::Checked { .. });
        if restored {
            self.send(&desk::wire(Request::Switch));
        } else {
            let (image, _) = self.desk.image(&mut self.random);
            for message in desk::upload(&image) {
                self.send(&message);
            }
        }
        let DraftState::Ordered { hash } = self.banks().draft.state() else {
            let state = self.banks().draft.state();
            return self.holds(Err(format!("the board does not start: {state:?}")));
        };
        let expected = match self.stored {
            Some(hashes) => restored && hashes.contains(&hash),
            None => !restored && self.desk.knows(hash),
        };
        if !expected {
            return self.holds(Err(format!("the board starts with {hash:#x}: {:x?}", self.stored)));
        }
        if restored {
            self.stored = Some([hash; 2]);
        }
        self.ordered = Some(hash);
        self.boundary()?;
        self.invariants.start(self.controller.codes());
        self.plant.move_to(self.controller.codes(), self.frame);
        self.ledger.start();
        Ok(())
    }

    fn banks(&mut self) -> &mut Banks<'a, CELLS, PIXELS, PIXELS> {
        self.banks.as_mut().expect(THERE)
    }

    /// What runs.
    fn bank(&self) -> &Bank {
        running(&self.banks)
    }

    /// Bytes come over the link.
    fn send(&mut self, bytes: &[u8]) {
        let mode = self.controller.mode();
        let banks = self.banks.as_mut().expect(THERE);
        self.desk.receive(bytes, banks, mode);
    }

    /// Between two frames: what was switched to runs, and nothing else.
    fn boundary(&mut self) -> Result<(), Error> {
        let Self { banks, controller, .. } = self;
        let banks = banks.as_mut().expect(THERE);
        let exchanged = banks.frame_boundary(|before, next| {
            controller.exchange(before, next, next.calibration().is_ok())
        });
        let held = match (exchanged, self.ordered.take()) {
            (Some(Ok(found)), Some(expected)) if found == expected => {
                self.runs = found;
                Ok(())
            }
            (None, None) => Ok(()),
            (found, expected) => Err(format!("{found:x?} was to run, expected {expected:x?}")),
        };
        let (runs, found) = (self.runs, self.banks().hash());
        let hash = self.bank().hash();
        let same = held.and_then(|()| {
            let same = runs == found && runs == hash;
            if same { Ok(()) } else { Err(format!("{found:#x} ({hash:#x}) runs, not {runs:#x}")) }
        });
        self.holds(same)
    }

    /// What happens on the link, or to the flash.
    fn link(&mut self, mishap: Option<Mishap>, ticks: u64) -> Result<(), Error> {
        let refused = self.desk.refused;
        match mishap {
            Some(Mishap::Garbage) => {
                let bytes = Desk::garbage(&mut self.random);
                self.send(&bytes);
            }
            Some(Mishap::Truncated) => {
                let whole = desk::wire(Request::Copy);
                let cut = self.random.random_range(1..whole.len());
                self.send(&whole[..cut]);
                // Cut short, it takes the next one with it; the one behind arrives.
                self.send(&desk::wire(Request::Discard));
                self.send(&desk::wire(Request::Discard));
                if self.banks().draft.state() != DraftState::Empty {
                    return self.holds(Err("the message behind a cut one is lost".into()));
                }
            }
            Some(Mishap::Replayed | Mishap::Upload) => {
                let (image, hash) = self.desk.image(&mut self.random);
                let messages = desk::upload(&image);
                let twice = self.random.random_range(0..messages.len());
                for (i, message) in messages.iter().enumerate() {
                    self.send(message);
                    // The first one twice only begins anew.
                    if mishap == Some(Mishap::Replayed) && i == twice {
                        self.send(message);
                    }
                }
                self.ordered = Some(hash);
            }
            Some(Mishap::BrokenUpload) => {
                let (mut image, _) = self.desk.image(&mut self.random);
                let mut messages = if self.random.random_bool(0.5) {
                    let place = self.random.random_range(0..image.len());
                    image[place] ^= 1 << self.random.random_range(0..8);
                    desk::upload(&image)
                } else {
                    let mut messages = desk::upload(&image);
                    messages.remove(self.random.random_range(0..messages.len() - 1));
                    messages
                };
                if self.random.random_bool(0.3) {
                    messages.truncate(self.random.random_range(1..messages.len()));
                }
                messages.iter().for_each(|message| self.send(message));
                self.send(&desk::wire(Request::Switch));
                if self.desk.refused == refused {
                    return self.holds(Err("a broken upload was not refused".into()));
                }
            }
            Some(Mishap::StoreCut) => {
                // A loop that is closed must not wait for a flash.
                if self.random.random_bool(0.7) && self.controller.mode() != Mode::Safe {
                    self.command(Command::Enter(Mode::Standby), ticks)?;
                }
                let may = matches!(self.controller.mode(), Mode::Safe | Mode::Standby);
                let steps = self.random.random_range(0..STEPS);
                self.desk.flash.steps = Some(steps);
                self.desk.flash.taken = 0;
                self.send(&desk::wire(Request::Store));
                let whole = self.desk.refused == refused;
                if !may {
                    let held = if whole || self.desk.flash.taken > 0 {
                        Err(format!("stored in mode {}", self.controller.mode()))
                    } else {
                        Ok(())
                    };
                    return self.holds(held);
                }
                let before = self.stored.map(|[before, _]| before);
                self.desk.flash.steps = None;
                // Cut before its end, it is there or it is not; the one before is kept until it is.
                self.stored = match (whole, before) {
                    (true, _) => Some([self.runs; 2]),
                    (false, Some(before)) => Some([before, self.runs]),
                    (false, None) => None,
                };
                let held = self.in_flash();
                self.holds(held)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// What would be restored is what was stored.
    fn in_flash(&mut self) -> Result<(), String> {
        let found = Store::new(&mut self.desk.flash).newest_stored();
        let found = found.map_err(|error| error.to_string())?.map(|stored| stored.hash);
        match (found, self.stored) {
            (Some(hash), Some(hashes)) if hashes.contains(&hash) => {
                self.stored = Some([hash; 2]);
                Ok(())
            }
            // The very first store, cut in its last step, may be whole.
            (Some(hash), None) if hash == self.runs => {
                self.stored = Some([hash; 2]);
                Ok(())
            }
            (None, None) => Ok(()),
            (found, stored) => Err(format!("{found:x?} is in flash, expected {stored:x?}")),
        }
    }

    /// Goes on until the next mishap has happened, and returns its kind.
    ///
    /// # Errors
    /// [`Error::Run`] with what does not hold, in which frame.
    pub fn step(&mut self) -> Result<Mishap, Error> {
        let pause = -GAP * f64::ln(1.0 - self.random.random::<f64>());
        for _ in 0..pause as u32 {
            self.pass(None)?;
        }
        let mishap = MISHAPS[self.random.random_range(0..MISHAPS.len())];
        self.ledger.happens(mishap);
        self.pass(Some(mishap))?;
        Ok(mishap)
    }

    /// A frame's time, in which `mishap` happens.
    fn pass(&mut self, mishap: Option<Mishap>) -> Result<(), Error> {
        self.frame += 1;
        let ticks = self.frame * FRAME_TICKS;
        self.prepare(mishap);
        self.look_at_inputs(ticks)?;
        if mishap == Some(Mishap::Crash) {
            return self.crash();
        }
        let (mode, outputs) = (self.controller.mode(), self.controller.outputs());
        if let Some(command) = self.operator.next(self.frame, mode, outputs) {
            self.command(command, ticks)?;
        }
        if mishap == Some(Mishap::Commands) {
            for _ in 0..self.random.random_range(1..6) {
                let subapertures = self.bank().subapertures() as u16;
                let command = operator::any(&mut self.random, subapertures);
                self.command(command, ticks)?;
            }
        }
        self.link(mishap, ticks)?;
        self.boundary()?;
        self.expose(mishap, ticks)?;
        if mishap == Some(Mishap::Dacs) {
            self.controller.fault(Fault::Dacs, ticks);
            self.ledger.expect(Fault::Dacs, 1);
            self.mode()?;
        } else {
            self.plant.move_to(self.controller.codes(), self.frame);
        }
        self.look(mishap)
    }

    /// What an operator asks for; a refusal leaves the mode and the codes.
    fn command(&mut self, command: Command, ticks: u64) -> Result<(), Error> {
        let before = (self.controller.mode(), self.controller.codes().to_vec());
        match self.request(command, ticks) {
            Ok(()) => self.operator.took(&command),
            Err(refusal) if self.controller.mode() != before.0 => {
                return self.holds(Err(format!("{command:?} refused ({refusal}), and done")));
            }
            Err(_) => {}
        }
        if self.controller.codes() != before.1 {
            return self.holds(Err(format!("{command:?} moved the mirror between frames")));
        }
        self.mode()
    }

    fn request(&mut self, command: Command, ticks: u64) -> Result<(), Refusal> {
        let Self { banks, controller, .. } = self;
        let bank = running(banks);
        controller.request(bank, command, bank.calibration().is_ok(), ticks)
    }

    /// The mode is legal after the one that was last looked at.
    fn mode(&mut self) -> Result<(), Error> {
        let (mode, outputs) = (self.controller.mode(), self.controller.outputs());
        let held = self.invariants.mode(mode, outputs);
        self.holds(held)
    }

    /// What breaks for a while.
    fn prepare(&mut self, mishap: Option<Mishap>) {
        let until = self.frame + u64::from(self.random.random_range(1..=LONGEST));
        let random = &mut self.random;
        match mishap {
            Some(Mishap::DeadSubapertures) => {
                let share = random.random_range(0.0..0.6);
                for dead in self.plant.dead.iter_mut().filter(|_| random.random_bool(share)) {
                    *dead = until;
                }
            }
            Some(Mishap::StuckActuators) => {
                for stuck in self.plant.stuck.as_flattened_mut() {
                    if random.random_bool(0.03) {
                        *stuck = until;
                    }
                }
            }
            Some(Mishap::FluxDropout) => self.plant.dropout = until,
            Some(Mishap::LaserPermit) => self.no_permit = until,
            Some(Mishap::HighVoltage) => self.no_voltage = until,
            _ => {}
        }
    }

    fn look_at_inputs(&mut self, ticks: u64) -> Result<(), Error> {
        let before = self.controller.outputs();
        let inputs = Inputs {
            laser_permit: self.frame >= self.no_permit,
            high_voltage_ready: self.frame >= self.no_voltage,
        };
        self.controller.interlock(inputs, ticks);
        // What was on, or coming, is lost once.
        let permit = self.operator.has_armed() && !inputs.laser_permit;
        let voltage = before.high_voltage && !inputs.high_voltage_ready;
        self.ledger.expect(Fault::LaserPermit, permit.into());
        self.ledger.expect(Fault::HighVoltage, voltage.into());
        if permit || voltage {
            self.operator.lost();
        }
        self.mode()
    }

    /// The mirror comes to flat by the handler of the panic, and the board starts anew.
    fn crash(&mut self) -> Result<(), Error> {
        let Self { controller, banks, invariants, .. } = self;
        let bank = running(banks);
        let mut held = Ok(());
        controller.emergency(bank, |codes| {
            if held.is_ok() {
                held = invariants.codes(codes);
            }
        });
        if held.is_ok() && !controller.is_flat() {
            held = Err("the handler of a panic did not bring the mirror to flat".into());
        }
        self.holds(held)?;
        self.start()?;
        self.controller.fault(Fault::Crash, self.frame * FRAME_TICKS);
        self.ledger.expect(Fault::Crash, 1);
        self.operator = Operator::new();
        self.number = self.random.next_u32();
        self.whole = 0;
        Ok(())
    }

    /// The frame, as it comes to the controller.
    fn expose(&mut self, mishap: Option<Mishap>, ticks: u64) -> Result<(), Error> {
        let asked = self.bank().timing().pulses_per_frame;
        let (mut number, mut pulses) = (self.number, asked);
        match mishap {
            Some(Mishap::Dropped) => {
                self.number = number.wrapping_add(1);
                return self.missing(ticks);
            }
            Some(Mishap::Skipped) => {
                let skipped = self.random.random_range(1..=4);
                self.ledger.expect(Fault::FrameMissing, skipped);
                number = number.wrapping_add(skipped);
                self.number = number;
            }
            Some(Mishap::WrongCounter) => number = number.wrapping_sub(1 << 20),
            Some(Mishap::MissedPulses) => pulses = self.random.random_range(0..asked),
            _ => {}
        }
        self.number = self.number.wrapping_add(1);
        let laser = self.controller.outputs().laser;
        let light = if laser { f64::from(pulses) / f64::from(asked) } else { 0.0 };
        let lit = light == 1.0 && !self.plant.is_dim(self.frame);
        let (height, width) = (usize::from(self.bank().height()), usize::from(self.bank().width()));
        let top = ((1u32 << self.bank().bits()) - 1) as u16;
        let pixels = self.plant.expose(self.frame, light);
        let mut rows = height;
        match mishap {
            Some(Mishap::Saturated) => pixels.fill(top),
            Some(Mishap::Corrupted) => {
                for pixel in pixels.iter_mut() {
                    *pixel ^= (self.random.next_u32() & self.random.next_u32()) as u16 & 0xfff;
                }
            }
            Some(Mishap::Short) => rows = self.random.random_range(0..height),
            _ => {}
        }
        let mut start = Start { number, pulses, ticks };
        let bank = running(&self.banks);
        let controller = &mut *self.controller;
        let before = controller.mode();
        controller.begin(bank, start);
        if before == Mode::ClosedLoop && controller.mode() == Mode::Safe {
            self.ledger.expect(Fault::FramesLost { frames: 0 }, 1);
        }
        if mishap == Some(Mishap::Restarted) {
            push(controller, bank, &pixels[..width * self.random.random_range(1..height)]);
            start.number = start.number.wrapping_add(1);
            self.number = self.number.wrapping_add(1);
            controller.begin(bank, start);
            self.ledger.expect(Fault::FrameUnfinished, 1);
        }
        if mishap == Some(Mishap::WrongRow) {
            let _: Result<_, RowError> = controller.push_rows(bank, &pixels[1..width], 1);
        }
        push(controller, bank, &pixels[..width * rows]);
        let again = (mishap == Some(Mishap::Doubled)).then(|| pixels.to_vec());
        self.finish(mishap, mishap, lit)?;
        if let Some(pixels) = again {
            let bank = running(&self.banks);
            self.controller.begin(bank, start);
            push(&mut self.controller, bank, &pixels);
            // Its number says what it is.
            self.finish(mishap, Some(Mishap::WrongCounter), lit)?;
        }
        Ok(())
    }

    /// Ends the frame, which must have been found to be what `as_found` is.
    fn finish(
        &mut self,
        mishap: Option<Mishap>,
        as_found: Option<Mishap>,
        lit: bool,
    ) -> Result<(), Error> {
        let before = self.controller.mode();
        let bank = running(&self.banks);
        let result = self.controller.finish(bank, &mut ());
        let GateStamp { asked, seen, .. } = result.gate;
        self.ledger.expect(Fault::PulsesMissed { asked, seen }, (seen < asked).into());
        self.ledger.frame(mishap, before, &result);
        let mut held = self.invariants.codes(self.controller.codes());
        if !ledger::explains(as_found, lit, result.fault) {
            held = held.and(Err(format!("{as_found:?} was found to be {:?}", result.fault)));
        }
        self.holds(held)?;
        self.mode()
    }

    /// No frame came, and the board's timer said so.
    fn missing(&mut self, ticks: u64) -> Result<(), Error> {
        let before = self.controller.mode();
        let due = matches!(before, Mode::Standby | Mode::OpenLoop | Mode::ClosedLoop);
        self.ledger.expect(Fault::FrameMissing, due.into());
        // Seen or not, the sky goes on.
        self.plant.expose(self.frame, 0.0);
        let bank = running(&self.banks);
        let result = self.controller.missing(bank, ticks);
        self.ledger.frame(Some(Mishap::Dropped), before, &result);
        let held = self.invariants.codes(self.controller.codes());
        self.holds(held)?;
        self.mode()
    }

    /// Looks at everything else after a frame.
    fn look(&mut self, mishap: Option<Mishap>) -> Result<(), Error> {
        let pipeline = self.controller.pipeline();
        let mut held = self.invariants.formats(pipeline.positions(), pipeline.commands());
        held = held.and_then(|()| self.ledger.check(self.controller.faults()));
        self.digest.add(self.controller.codes());
        let closed = self.controller.mode() == Mode::ClosedLoop;
        let quiet = mishap.is_none() && !self.plant.is_broken(self.frame);
        self.whole = if closed && quiet { self.whole + 1 } else { 0 };
        if self.whole > WHOLE && self.plant.offset_px() > IN_PLACE_PX {
            held = held.and(Err(format!("spots are {:.2} px off", self.plant.offset_px())));
        }
        let kept_open = self.frame < self.no_permit.max(self.no_voltage);
        let recovery = self.ledger.recovery(closed, kept_open || !quiet, RECOVERY);
        self.holds(held.and(recovery))
    }

    /// Frames without mishaps until the loop is closed and whole.
    ///
    /// # Errors
    /// [`Error::Run`] if it does not come to that, or something else does not hold.
    pub fn settle(&mut self) -> Result<(), Error> {
        while self.whole <= WHOLE {
            self.pass(None)?;
        }
        Ok(())
    }

    fn holds(&self, held: Result<(), String>) -> Result<(), Error> {
        held.map_err(|what| Error::Run(format!("frame {}: {what}", self.frame)))
    }

    /// Frames so far.
    pub fn frames(&self) -> u64 {
        self.frame
    }

    /// What came of each kind.
    pub fn lines(&self) -> Vec<Line> {
        self.ledger.lines()
    }

    /// The digest of all codes so far.
    pub fn digest(&self) -> String {
        self.digest.hex()
    }
}

/// What runs.
fn running<'b>(banks: &'b Option<Banks<'_, CELLS, PIXELS, PIXELS>>) -> &'b Bank {
    banks.as_ref().expect(THERE).running()
}

/// A controller that has just been switched on.
fn controller() -> Box<Controller<CELLS, PIXELS>> {
    let times = Times { settle_ticks: 5 * FRAME_TICKS, fall_ticks: 200 * FRAME_TICKS };
    let serials = Serials { mirror: 0, detector: 0 };
    // A microsecond is too coarse for a gate: its timer has its own ticks.
    Box::new(Controller::new(serials, times, 240_000_000))
}

fn push(controller: &mut Controller<CELLS, PIXELS>, bank: &Bank, pixels: &[u16]) {
    for rows in pixels.chunks(BLOCK * usize::from(bank.width())) {
        let count = (rows.len() / usize::from(bank.width())) as u16;
        // Refused behind a row of the wrong length: `finish` says so.
        let _: Result<_, RowError> = controller.push_rows(bank, rows, count);
    }
}
