//! The controller: frame path, modes, ladder, interlock and gate as one thing that a board drives.
//!
//! A board owns one [`Controller`] and two banks of configuration, and lends the running one to every
//! call. For each exposure, in the order of its frames:
//!
//! ```text
//! begin -> push_rows x n -> finish        a frame came
//! missing                                 none came in a frame's time
//! codes() to the DACs                     after either; `fault(Fault::Dacs)` if they do not take them
//! gate().running() to the gate's timer    after `begin` and `missing`: changes come to run there
//! ```
//!
//! and beside them, in its main loop:
//!
//! ```text
//! interlock(inputs)   -> outputs, to be set at once
//! request(..)         what the operator asks for
//! exchange(old, new)  before the other bank is lent: at a frame boundary
//! fault(..)           what the board finds by itself
//! ```
//!
//! A panic or fault handler calls [`Controller::emergency`], and the next start tells of it by
//! `fault(Fault::Crash)` ([`crate::last_words`]). `finish` and `missing` move the mirror by one step of
//! the guard ([`crate::mirror`]) at most; nothing else moves it. What an operator asks for over the link is
//! a [`Command`]:
//!
//! | the operator wants | call |
//! |---|---|
//! | another mode | [`Command::Enter`] |
//! | high voltage and laser on, off | [`Command::Arm`], [`Command::Disarm`] |
//! | a segment, an actuator, everything flat | [`Command::Position`], [`Command::Heights`], [`Command::Flat`] |
//! | another beacon altitude or zenith angle | [`Command::Gate`] |
//! | counters at zero | [`Command::ClearFaults`] |
//! | another configuration | [`Controller::exchange`] |
//! | status, telemetry | [`FrameResult`], [`Controller::mode`], [`Controller::faults`], [`Controller::modes`], [`Controller::gate`] |
//!
//! What is refused is a [`Refusal`] and changes nothing. Whether the running configuration's calibration
//! fits it is for the caller to say (`calibrated`).

use crate::centroid::Measurement;
use crate::config::Config;
use crate::fault::{Fault, Faults, Moment};
use crate::frame_counter::{Counted, FrameCounter};
use crate::gate::{Gate, GateStamp, Range, ShortFrame};
use crate::interlock::{Inputs, Interlock, Outputs, Times};
use crate::ladder::{Ladder, Rung};
use crate::mirror::Serials;
use crate::mode::{Conditions, Mode, Modes, Refusal};
use crate::pipeline::{Measured, Pipeline};
use crate::probe::{Probe, Stage};
use crate::report::{GlobalTilt, Hold, Progress, Report, RowError};
use crate::segments::{ACTUATORS, Position};
use serde::{Deserialize, Serialize};

/// Missed frames that are held one by one, so that the mirror's past is right: it goes back by no more.
const HELD: u32 = 4;

/// A frame's beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// Its number, as the detector or the laser's pulses count.
    pub number: u32,
    /// Laser pulses in its exposure.
    pub pulses: u32,
    /// The board's clock.
    pub ticks: u64,
}

/// What an operator asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Another mode.
    Enter(Mode),
    /// High voltage, and when it has settled the laser.
    Arm,
    /// Safe; the laser off at once, the high voltage when the mirror is flat.
    Disarm,
    /// One segment to a position, in calibrate and test pattern.
    Position {
        /// The subaperture.
        subaperture: u16,
        /// Where to.
        position: Position,
    },
    /// The actuators of one segment to heights, in calibrate and test pattern.
    Heights {
        /// The subaperture.
        subaperture: u16,
        /// Height of each actuator over its height per piston, relative to flat, ulp.
        heights_ulp: [i32; ACTUATORS],
    },
    /// All segments to the flat map, in calibrate and test pattern.
    Flat,
    /// Another range, from the next frame boundary on.
    Gate(Range),
    /// Counts faults from zero.
    ClearFaults,
    /// States what mirror and detector are there, in safe and without high voltage: what a board cannot
    /// read from them. What runs need not fit, but is armed and leaves safe only if it does.
    Hardware(Serials),
}

/// What became of a frame, or of its absence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameResult {
    /// What the frame path says.
    pub report: Report,
    /// The mode after it.
    pub mode: Mode,
    /// What a closed loop did; `None` in any other mode.
    pub rung: Option<Rung>,
    /// Why the frame could not be followed.
    pub fault: Option<Fault>,
    /// The gate that it was exposed through.
    pub gate: GateStamp,
    /// When it began.
    pub at: Moment,
}

/// Everything that decides. `M` and `B` are the capacities of [`Config`].
#[derive(Debug)]
pub struct Controller<const M: usize, const B: usize, const K: usize = 0> {
    pipeline: Pipeline<M, B, K>,
    modes: Modes,
    ladder: Ladder,
    faults: Faults,
    interlock: Interlock,
    inputs: Inputs,
    gate: Gate,
    serials: Serials,
    numbers: FrameCounter,
    /// Of the frame being read: when, through which gate, and what its number says.
    at: Moment,
    stamp: GateStamp,
    counter: Option<Fault>,
    /// Where calibrations and patterns want the segments.
    wanted: [Position; M],
}

impl<const M: usize, const B: usize, const K: usize> Controller<M, B, K> {
    /// Safe, without a configuration. `serials` are those of the hardware that is there, 0 where the
    /// board does not know; `ticks_per_second` those of the gate's timer.
    #[must_use]
    pub const fn new(serials: Serials, times: Times, ticks_per_second: u32) -> Self {
        Self {
            pipeline: Pipeline::new(),
            modes: Modes::new(),
            ladder: Ladder::new(),
            faults: Faults::new(),
            interlock: Interlock::new(times),
            inputs: Inputs { laser_permit: false, high_voltage_ready: false },
            gate: Gate::new(ticks_per_second),
            serials,
            numbers: FrameCounter::new(),
            at: Moment { frame: 0, ticks: 0 },
            stamp: GateStamp {
                range: Range { altitude_mm: 0, depth_mm: 0, zenith_mdeg: 0 },
                delay: 0,
                width: 0,
                asked: 0,
                seen: 0,
            },
            counter: None,
            wanted: [Position { piston_ulp: 0, tilt_ulp: [0; 2] }; M],
        }
    }

    /// A frame has been exposed and its rows will come.
    ///
    /// Frames between the last one and this one are missing and told to the ladder; the mirror does not
    /// move for them. With a configuration that was not taken over by [`Controller::exchange`] nothing
    /// begins.
    pub fn begin<const P: usize>(&mut self, config: &Config<M, P, B, K>, start: Start) {
        let Start { number, pulses, ticks } = start;
        self.at = Moment { frame: number, ticks };
        self.counter = match self.numbers.count(number) {
            Counted::Next { missing } => {
                self.missed(config, number, missing);
                None
            }
            Counted::Wrong(fault) => Some(fault),
        };
        self.stamp = self.gate.frame(pulses);
        let GateStamp { asked, seen, .. } = self.stamp;
        if seen < asked {
            self.faults.book(Fault::PulsesMissed { asked, seen }, self.at);
        }
        self.begin_frame(config, number);
        if config.short_frame() == ShortFrame::Scale {
            self.pipeline.scale_flux(seen, asked);
        }
    }

    /// Lets the pipeline begin, which would set the flat map's codes at once for a configuration that does
    /// not drive the mirror.
    fn begin_frame<const P: usize>(&mut self, config: &Config<M, P, B, K>, number: u32) {
        if self.pipeline.mirror().is_driven(config.subapertures()) {
            self.pipeline.begin(config, number);
        }
    }

    /// Frames that never came before `number`.
    fn missed<const P: usize>(&mut self, config: &Config<M, P, B, K>, number: u32, missing: u32) {
        if missing == 0 {
            return;
        }
        self.faults.book_times(Fault::FrameMissing, missing, self.at);
        for back in (1..=missing.min(HELD)).rev() {
            self.begin_frame(config, number.wrapping_sub(back));
            let Measured { report, hold } = self.pipeline.measure(config);
            self.pipeline.keep(report, hold.unwrap_or(Hold::Mode));
        }
        if self.modes.mode() == Mode::ClosedLoop {
            let frames = missing.min(u16::MAX.into()) as u16;
            if let Rung::GiveUp(fault) = self.ladder.bad_frames(frames, &config.ladder()) {
                self.give_up(fault);
            }
        }
    }

    /// Takes the next detector rows. See [`Pipeline::push_rows`].
    ///
    /// # Errors
    /// A [`RowError`]; `finish` books what it makes of the frame.
    #[inline]
    pub fn push_rows<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        pixels: &[u16],
        rows: u16,
    ) -> Result<Progress, RowError> {
        self.pipeline.push_rows(config, pixels, rows)
    }

    /// Takes a frame as measurements made elsewhere. See [`Pipeline::push_measurements`].
    ///
    /// # Errors
    /// A [`RowError`]; `finish` books what it makes of the frame.
    pub fn push_measurements<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        measurements: &[Measurement],
    ) -> Result<Progress, RowError> {
        self.pipeline.push_measurements(config, measurements)
    }

    /// Ends the frame: the mirror takes a step, if the mode or the ladder wants one. `probe` is told of the
    /// stages as by [`Pipeline::finish_probed`], of a frame that is not followed only of the first.
    pub fn finish<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        probe: &mut impl Probe,
    ) -> FrameResult {
        let Measured { report, hold } = self.pipeline.measure(config);
        probe.after(Stage::Slopes);
        if report.restarted {
            self.faults.book(Fault::FrameUnfinished, self.at);
        }
        let fault = self.fault_of(config, &report, hold);
        if let Some(fault) = fault
            // Booked when the frame began.
            && !matches!(fault, Fault::PulsesMissed { .. })
        {
            self.faults.book(fault, self.at);
        }
        self.act(config, Measured { report, hold }, fault, probe)
    }

    /// A frame's time has passed without a frame.
    pub fn missing<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        ticks: u64,
    ) -> FrameResult {
        let number = self.numbers.due();
        self.numbers.skip();
        self.at = Moment { frame: number, ticks };
        self.counter = None;
        self.gate.boundary();
        self.stamp = GateStamp { seen: 0, ..self.stamp };
        // Without the laser none is expected.
        if matches!(self.modes.mode(), Mode::Standby | Mode::OpenLoop | Mode::ClosedLoop) {
            self.faults.book(Fault::FrameMissing, self.at);
        }
        self.begin_frame(config, number);
        let measured = self.pipeline.measure(config);
        self.act(config, measured, Some(Fault::FrameMissing), &mut ())
    }

    /// Why a frame cannot be followed.
    fn fault_of<const P: usize>(
        &self,
        config: &Config<M, P, B, K>,
        report: &Report,
        hold: Option<Hold>,
    ) -> Option<Fault> {
        let GateStamp { asked, seen, .. } = self.stamp;
        let quality = config.quality();
        match hold {
            Some(Hold::CutShort { rows }) => return Some(Fault::FrameShort { rows }),
            Some(Hold::WrongRow) => return Some(Fault::WrongRow),
            Some(Hold::NoLight) => {
                return Some(Fault::TooFewValid { valid: 0, least: quality.valid_min.max(1) });
            }
            Some(Hold::NotBegun | Hold::NotConfigured) => return Some(Fault::FrameMissing),
            Some(Hold::Poor | Hold::Mode) | None => {}
        }
        if self.counter.is_some() {
            return self.counter;
        }
        if config.short_frame() == ShortFrame::Drop && seen < asked {
            return Some(Fault::PulsesMissed { asked, seen });
        }
        let pulses = match config.short_frame() {
            ShortFrame::Scale => [seen, asked],
            _ => [asked, asked],
        };
        let (lit, measurements) = (self.pipeline.lit(config), self.pipeline.measurements());
        quality.check(report, measurements, lit, pulses).err()
    }

    /// What the mode, and in a closed loop the ladder, makes of a frame.
    fn act<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        Measured { report, hold }: Measured,
        fault: Option<Fault>,
        probe: &mut impl Probe,
    ) -> FrameResult {
        let (report, rung) =
            if self.modes.mode() == Mode::ClosedLoop && fault.is_none() && hold.is_none() {
                let rung = self.ladder.good();
                (self.follow(config, report, probe), Some(rung))
            } else {
                self.not_follow(config, Measured { report, hold }, fault)
            };
        let (mode, gate, at) = (self.modes.mode(), self.stamp, self.at);
        FrameResult { report, mode, rung, fault, gate, at }
    }

    /// What becomes of a frame that the mirror does not follow.
    ///
    /// Not inlined: a board may keep what a closed loop does with a good frame in other memory.
    #[inline(never)]
    fn not_follow<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        Measured { report, hold }: Measured,
        fault: Option<Fault>,
    ) -> (Report, Option<Rung>) {
        let kept = hold.unwrap_or(if fault.is_some() { Hold::Poor } else { Hold::Mode });
        let unbegun = matches!(hold, Some(Hold::NotBegun | Hold::NotConfigured));
        let mut rung = None;
        let report = match self.modes.mode() {
            // No exposure has passed.
            _ if unbegun => self.pipeline.keep(report, kept),
            Mode::ClosedLoop => {
                let climbed = self.ladder.bad_frame(&config.ladder());
                rung = Some(climbed);
                match climbed {
                    Rung::Follow | Rung::Hold => self.pipeline.keep(report, kept),
                    Rung::Leak => {
                        let part = config.ladder().leak_q16;
                        self.pipeline.steer(config, (report, kept), false, |mirror| {
                            mirror.leak(config, part)
                        })
                    }
                    Rung::GiveUp(fault) => {
                        self.give_up(fault);
                        self.flatten(config, report, kept)
                    }
                }
            }
            Mode::Standby => self.pipeline.keep(report, kept),
            Mode::Safe | Mode::OpenLoop => self.flatten(config, report, kept),
            Mode::Calibrate | Mode::TestPattern => {
                let wanted = &self.wanted;
                self.pipeline.steer(config, (report, kept), true, |mirror| {
                    let ask = |i: usize, position| wanted.get(i).copied().unwrap_or(position);
                    mirror.steer(config, &mut { ask })
                })
            }
        };
        (report, rung)
    }

    fn follow<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        report: Report,
        probe: &mut impl Probe,
    ) -> Report {
        let report = self.pipeline.follow(config, report, probe);
        if let Some(fault) = self.ladder.saturated(report.saturated_actuators, &config.ladder()) {
            self.faults.book(fault, self.at);
            self.modes.open(fault, self.at);
        }
        report
    }

    fn flatten<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        report: Report,
        kept: Hold,
    ) -> Report {
        self.pipeline.steer(config, (report, kept), true, |mirror| mirror.flatten(config))
    }

    fn give_up(&mut self, fault: Fault) {
        self.faults.book(fault, self.at);
        self.modes.fall(fault, self.at);
    }

    /// Looks at the interlock's inputs; the outputs must be set to what this returns, at once.
    pub fn interlock(&mut self, inputs: Inputs, ticks: u64) -> Outputs {
        self.inputs = inputs;
        let lost = self.interlock.step(inputs, self.is_flat(), ticks);
        for (is_lost, fault) in
            [(lost.laser_permit, Fault::LaserPermit), (lost.high_voltage, Fault::HighVoltage)]
        {
            if is_lost {
                self.fault(fault, ticks);
            }
        }
        self.interlock.outputs()
    }

    /// Books a fault that the board found; a hard one leads to safe.
    pub fn fault(&mut self, fault: Fault, ticks: u64) {
        let at = Moment { ticks, ..self.at };
        self.faults.book(fault, at);
        if fault.is_hard() {
            self.modes.fall(fault, at);
        }
    }

    /// Does what an operator asks for. `calibrated`: the running configuration's calibration fits it.
    ///
    /// # Errors
    /// A [`Refusal`]; nothing has changed but the count of refusals.
    pub fn request<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        command: Command,
        calibrated: bool,
        ticks: u64,
    ) -> Result<(), Refusal> {
        let at = Moment { ticks, ..self.at };
        let done = match command {
            // It counts its refusals itself.
            Command::Enter(mode) => return self.enter(config, mode, calibrated, at),
            Command::Arm => self.admit(config).and_then(|()| {
                self.interlock.arm(self.inputs, ticks).map_err(|inputs| {
                    let Inputs { laser_permit, high_voltage_ready } = inputs;
                    Refusal::Interlock { laser_permit, high_voltage_ready }
                })
            }),
            Command::Disarm => {
                self.interlock.disarm(ticks);
                if self.modes.mode() != Mode::Safe {
                    return self.enter(config, Mode::Safe, calibrated, at);
                }
                Ok(())
            }
            Command::Position { subaperture, position } => {
                self.want(config, subaperture, Ok(position))
            }
            Command::Heights { subaperture, heights_ulp } => {
                let segment = config.segments.get(usize::from(subaperture));
                let bits = config.travel.ratio_bits;
                let position = segment.and_then(|segment| segment.position(heights_ulp, bits));
                self.want(config, subaperture, position.ok_or(Refusal::NoPosition { subaperture }))
            }
            Command::Flat => self.patterns().map(|wanted| wanted.fill(Position::default())),
            Command::Gate(range) => {
                self.gate.ask(range, &config.timing()).map(|_| ()).map_err(Refusal::Gate)
            }
            Command::ClearFaults => {
                self.faults.clear();
                Ok(())
            }
            Command::Hardware(serials) => self.replace_hardware(serials),
        };
        if done.is_err() {
            self.modes.refuse();
        }
        done
    }

    /// Whether a configuration was made for the hardware that is there.
    fn admit<const P: usize>(&self, config: &Config<M, P, B, K>) -> Result<(), Refusal> {
        self.serials.admit(config.serials()).map_err(Refusal::OtherHardware)
    }

    fn replace_hardware(&mut self, serials: Serials) -> Result<(), Refusal> {
        let mode = self.modes.mode();
        if mode != Mode::Safe {
            return Err(Refusal::WrongMode { mode });
        }
        if self.interlock.outputs().high_voltage {
            return Err(Refusal::HighVoltage);
        }
        self.serials = serials;
        Ok(())
    }

    fn enter<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        mode: Mode,
        calibrated: bool,
        at: Moment,
    ) -> Result<(), Refusal> {
        let have = Conditions {
            configured: config.subapertures() > 0,
            flat: self.is_flat(),
            high_voltage: self.interlock.keeps_voltage(),
            laser: self.interlock.outputs().laser,
            calibrated,
        };
        if mode != Mode::Safe
            && let Err(refusal) = self.admit(config)
        {
            self.modes.refuse();
            return Err(refusal);
        }
        self.modes.enter(mode, have, at)?;
        match mode {
            Mode::ClosedLoop => self.ladder = Ladder::new(),
            // From where it is.
            Mode::Calibrate | Mode::TestPattern => {
                let shown = self.pipeline.positions();
                self.wanted.iter_mut().zip(shown).for_each(|(wanted, shown)| *wanted = *shown);
            }
            Mode::Safe | Mode::Standby | Mode::OpenLoop => {}
        }
        Ok(())
    }

    /// Where the segments are wanted, in a mode in which an operator may say so.
    fn patterns(&mut self) -> Result<&mut [Position; M], Refusal> {
        match self.modes.mode() {
            Mode::Calibrate | Mode::TestPattern => Ok(&mut self.wanted),
            mode => Err(Refusal::WrongMode { mode }),
        }
    }

    fn want<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        subaperture: u16,
        position: Result<Position, Refusal>,
    ) -> Result<(), Refusal> {
        let subapertures = config.subapertures() as u16;
        let wanted = self.patterns()?;
        match wanted.get_mut(usize::from(subaperture)) {
            Some(place) if subaperture < subapertures => {
                *place = position?.bounded();
                Ok(())
            }
            _ => Err(Refusal::NoSubaperture { subaperture, subapertures }),
        }
    }

    /// Lets `config` be the one that is lent from now on, in place of `before`, at a frame boundary.
    ///
    /// For the same mask the mirror stays where it is, whatever the flat maps, and goes on from there, without
    /// what frames have left unless it [continues](Config::continues) the one before; for another mask it
    /// must be safe and flat. The first one sets the flat map's codes at once: nothing has
    /// driven the mirror before. The gate goes to the configuration's range, if that is another than
    /// that of the one before.
    ///
    /// # Errors
    /// A [`Refusal`]; go on with `before`, nothing has changed but the count of refusals.
    pub fn exchange<const P: usize>(
        &mut self,
        before: &Config<M, P, B, K>,
        config: &Config<M, P, B, K>,
        calibrated: bool,
    ) -> Result<(), Refusal> {
        let exchanged = self.try_exchange(before, config, calibrated);
        if exchanged.is_err() {
            self.modes.refuse();
        }
        exchanged
    }

    fn try_exchange<const P: usize>(
        &mut self,
        before: &Config<M, P, B, K>,
        config: &Config<M, P, B, K>,
        calibrated: bool,
    ) -> Result<(), Refusal> {
        self.admit(config)?;
        if config.mask().is_none() {
            return Err(Refusal::NotConfigured);
        }
        let mode = self.modes.mode();
        if mode == Mode::ClosedLoop && !calibrated {
            return Err(Refusal::NotCalibrated);
        }
        let driven = self.pipeline.mirror().is_driven(before.subapertures());
        let same_mask = driven && before.mask() == config.mask();
        if driven && !same_mask {
            if mode != Mode::Safe {
                return Err(Refusal::WrongMode { mode });
            }
            if !self.is_flat() {
                return Err(Refusal::NotFlat);
            }
        }
        // One that tracks the zenith angle goes on doing so; on a bench none was asked for yet.
        let tracked =
            same_mask && before.range() == config.range() && self.gate.asked() != Range::default();
        let range = if tracked { self.gate.asked() } else { config.range() };
        self.gate.ask(range, &config.timing()).map_err(Refusal::Gate)?;
        if !same_mask {
            self.pipeline.reset(config);
        } else if !config.continues(before) {
            self.pipeline.adopt(config);
        }
        self.wanted.fill(Position::default());
        if same_mask {
            let shown = self.pipeline.positions();
            self.wanted.iter_mut().zip(shown).for_each(|(wanted, shown)| *wanted = *shown);
        }
        Ok(())
    }

    /// Gives a global tilt. See [`Pipeline::set_global_tilt`].
    pub fn set_global_tilt(&mut self, tilt: GlobalTilt) {
        self.pipeline.set_global_tilt(tilt);
    }

    /// Ramps to the flat map from a panic or fault handler, whatever state this is in: no lock, no
    /// allocation, no panic, and no more steps than the slew limit asks for. `send` hands the codes out and
    /// lets a frame's time pass; the watchdog bounds it all.
    pub fn emergency<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        mut send: impl FnMut(&[[u16; ACTUATORS]]),
    ) {
        self.pipeline.mirror_mut().emergency(config, &mut send);
    }

    /// The frame path.
    #[must_use]
    pub const fn pipeline(&self) -> &Pipeline<M, B, K> {
        &self.pipeline
    }

    /// The frame path by itself, past modes, ladder and gate: for a bench without a mirror. What drives
    /// a mirror never calls this.
    pub const fn bench(&mut self) -> &mut Pipeline<M, B, K> {
        &mut self.pipeline
    }

    /// Opens the loop at once, past the guard, for a bench without a mirror: see [`Pipeline::reset`]. The next
    /// frame may have any number.
    pub fn reset_bench<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.numbers = FrameCounter::new();
        self.pipeline.reset(config);
    }

    /// The DAC codes: valid at any time.
    #[must_use]
    pub fn codes(&self) -> &[[u16; ACTUATORS]] {
        self.pipeline.codes()
    }

    /// Whether the mirror shows the flat map.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.pipeline.mirror().is_flat()
    }

    /// The mode.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.modes.mode()
    }

    /// The mode's history.
    #[must_use]
    pub const fn modes(&self) -> &Modes {
        &self.modes
    }

    /// Where a closed loop is on the ladder.
    #[must_use]
    pub const fn ladder(&self) -> Ladder {
        self.ladder
    }

    /// The faults since the start.
    #[must_use]
    pub const fn faults(&self) -> &Faults {
        &self.faults
    }

    /// The hardware that is there; 0 where nobody has said.
    #[must_use]
    pub const fn serials(&self) -> Serials {
        self.serials
    }

    /// The range gate.
    #[must_use]
    pub const fn gate(&self) -> &Gate {
        &self.gate
    }

    /// The enables.
    #[must_use]
    pub const fn outputs(&self) -> Outputs {
        self.interlock.outputs()
    }

    /// The frame that was the last to begin.
    #[must_use]
    pub const fn at(&self) -> Moment {
        self.at
    }
}
