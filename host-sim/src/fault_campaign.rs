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
//! | counters | those of the controller are those counted here, kind by kind |
//! | recovery | the loop closes again within [`RECOVERY`] frames of the operator's first attempt |
//! | correction | a loop that has been closed and whole for [`WHOLE`] frames keeps its spots in place |
//! | repeatability | the same seed gives the same digest |

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
use invariants::Invariants;
use ledger::Ledger;
use operator::Operator;
use plant::Plant;
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use splash_firmware::config::Config;
use splash_firmware::controller::{Command, Controller, Start};
use splash_firmware::fault::Fault;
use splash_firmware::gate::GateStamp;
use splash_firmware::interlock::{Inputs, Times};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::Mode;
use splash_firmware::pipeline::RowError;

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
/// Rows that come at once.
const BLOCK: usize = 16;

const CELLS: usize = 64;
const PIXELS: usize = 16_384;

type Bank = Config<CELLS, PIXELS, PIXELS>;

/// The campaign.
pub struct FaultCampaign {
    bank: Box<Bank>,
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

impl FaultCampaign {
    /// A campaign of a seed, with an instrument that the default capacities hold.
    ///
    /// # Errors
    /// [`Error`] for an instrument that cannot be.
    pub fn new(
        instrument: &Instrument,
        reconstructor: &Reconstructor,
        seed: u64,
    ) -> Result<Self, Error> {
        let mut bank = Box::new(Bank::new());
        bank.build(&reconstructor.spec())?;
        let mut campaign = Self {
            bank,
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

    /// A board that has just been switched on, or has started anew.
    fn start(&mut self) -> Result<(), Error> {
        self.controller = controller();
        let none = Box::new(Bank::new());
        let exchanged = self.controller.exchange(&none, &self.bank, true);
        exchanged.map_err(|refusal| Error::Run(format!("the first configuration: {refusal}")))?;
        self.invariants.start(self.controller.codes());
        self.plant.move_to(self.controller.codes(), self.frame);
        self.ledger.start();
        Ok(())
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
                let subapertures = self.bank.subapertures() as u16;
                let command = operator::any(&mut self.random, subapertures);
                self.command(command, ticks)?;
            }
        }
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
        match self.controller.request(&self.bank, command, true, ticks) {
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
        let Self { controller, bank, invariants, .. } = self;
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
        let asked = self.bank.timing().pulses_per_frame;
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
        let (height, width) = (usize::from(self.bank.height()), usize::from(self.bank.width()));
        let pixels = self.plant.expose(self.frame, light);
        let mut rows = height;
        match mishap {
            Some(Mishap::Saturated) => pixels.fill(((1u32 << self.bank.bits()) - 1) as u16),
            Some(Mishap::Corrupted) => {
                for pixel in pixels.iter_mut() {
                    *pixel ^= (self.random.next_u32() & self.random.next_u32()) as u16 & 0xfff;
                }
            }
            Some(Mishap::Short) => rows = self.random.random_range(0..height),
            _ => {}
        }
        let mut start = Start { number, pulses, ticks };
        let (bank, controller) = (&*self.bank, &mut *self.controller);
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
            self.controller.begin(&self.bank, start);
            push(&mut self.controller, &self.bank, &pixels);
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
        let result = self.controller.finish(&self.bank, &mut ());
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
        let result = self.controller.missing(&self.bank, ticks);
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
