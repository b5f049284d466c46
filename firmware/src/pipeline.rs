//! The frame path from end to end: detector rows in, DAC codes out.
//!
//! ```text
//! begin -> push_row x height -> finish
//! rows -> calibrated pixels -> moments -> centroids -> slopes -> control law -> SOR pistons
//!      -> segment piston/tip/tilt -> actuator heights -> DAC codes
//! ```
//!
//! Rows are consumed as they arrive; `finish` does what is left once the last pixel is in. Only
//! `finish` of a complete frame changes commands, pistons and codes. Whatever else happens, they stay
//! those of the last good frame and the [`Report`] says why:
//!
//! | what happens | what it does |
//! |---|---|
//! | fewer rows than the detector has | `finish` holds: [`Hold::CutShort`] |
//! | `begin` before `finish` | the unfinished frame is dropped, [`Report::restarted`] |
//! | a row of the wrong length | refused; `finish` holds: [`Hold::WrongRow`] |
//! | more rows than the detector has | refused and counted; the frame counts: [`Report::extra_rows`] |
//! | no subaperture with valid flux | `finish` holds: [`Hold::NoLight`] |
//! | no `begin` | rows are refused; `finish` holds: [`Hold::NotBegun`] |

use crate::centroid::Measurement;
use crate::config::Config;
use crate::control::Control;
#[cfg(target_arch = "riscv32")]
use crate::dsp::spots::Subapertures;
use crate::fixed::{self, TILT_LIMIT};
use crate::mirror::{Limits, Mirror};
use crate::modal::{Modal, Pair};
pub use crate::probe::{Probe, Stage};
use crate::readout::{Readout, Sink};
use crate::redblack::RedBlack;
pub use crate::report::{GlobalTilt, Hold, Outcome, Progress, Report, RowError, Totals};
use crate::schedule::Schedule;
use crate::segments::{ACTUATORS, Position};
use crate::slopes::{self, Slope};
use crate::sor::{Node, Sor, SorConfig};

/// All pulses that were asked for, Q16.
const WHOLE: u32 = 1 << 16;

/// Frames by which a global tilt may be ahead of the frame it is first used in.
const MAX_AHEAD: u32 = 1 << 16;

/// Where a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    Reading,
    Malformed,
}

/// The state of the reconstructor. `M` and `B` are the capacities of [`Config`].
#[derive(Debug)]
pub struct Pipeline<const M: usize, const B: usize, const K: usize = 0> {
    phase: Phase,
    frame: u32,
    extra_rows: u16,
    restarted: bool,
    /// The sub-cycle of a schedule that the frame is.
    colour: u8,
    /// Laser pulses, of those asked for, that its flux limits do without, Q16.
    lacking_q16: u32,
    /// Whether pistons are those of a frame.
    warm: bool,
    /// Of the last complete frame.
    windows: usize,
    global_tilt: Option<GlobalTilt>,
    totals: Totals,
    readout: Readout<M, B>,
    /// In subaperture order, the second gate's behind the first's: of the last complete frame and of
    /// the one being read, as in the readout.
    slopes: [[Slope; M]; 2],
    /// Of the frame being read.
    saturated_pixels: u32,
    control: Control<M>,
    modal: Modal<K>,
    /// In subaperture order: those of the control law, which has them on the grid. Where the mirror shows
    /// them as they are, what it shows.
    commands: [[i32; 2]; M],
    shows_commands: bool,
    sor: Sor<M>,
    mirror: Mirror<M>,
}

impl<const M: usize, const B: usize, const K: usize> Default for Pipeline<M, B, K> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const M: usize, const B: usize, const K: usize> Pipeline<M, B, K> {
    /// A pipeline that has seen nothing. Its codes become those of the flat mirror with the first
    /// [`Pipeline::reset`] or [`Pipeline::begin`].
    #[must_use]
    pub const fn new() -> Self {
        Self {
            phase: Phase::Idle,
            frame: 0,
            extra_rows: 0,
            restarted: false,
            colour: 0,
            lacking_q16: 0,
            warm: false,
            windows: 0,
            global_tilt: None,
            totals: Totals {
                updated: 0,
                cut_short: 0,
                wrong_row: 0,
                no_light: 0,
                not_ready: 0,
                restarted: 0,
                extra_rows: 0,
                stale_tilt: 0,
                saturated_actuators: 0,
                slewed_actuators: 0,
            },
            readout: Readout::new(),
            slopes: [[Slope { tilt_ulp: [0; 2], valid: false }; M]; 2],
            saturated_pixels: 0,
            control: Control::new(),
            modal: Modal::new(),
            commands: [[0; 2]; M],
            shows_commands: false,
            sor: Sor::new(),
            mirror: Mirror::new(),
        }
    }

    /// Opens the loop: forgets every frame, and sets the codes of the flat mirror at once, without the
    /// slew limit: for a start, a simulated mirror, or one whose drive is off. A mirror that is driven is
    /// ramped to the flat map by [`Controller`](crate::controller::Controller).
    pub fn reset<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.phase = Phase::Idle;
        self.extra_rows = 0;
        self.restarted = false;
        self.global_tilt = None;
        self.totals = Totals::default();
        self.flatten(config);
    }

    /// Forgets what frames have left in the loop, and sets the codes of the flat mirror.
    fn flatten<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.forget();
        self.mirror.cold_start(config);
    }

    /// Forgets what frames have left in the loop.
    fn forget(&mut self) {
        self.warm = false;
        self.windows = 0;
        self.readout.reset();
        self.control.reset();
        self.sor.reset();
        self.slopes.as_flattened_mut().fill(Slope::default());
        self.commands.fill([0; 2]);
        self.shows_commands = false;
    }

    /// Starts frame `frame`. An unfinished one is dropped and counted.
    ///
    /// The configuration may have been exchanged since the last frame for one that
    /// [continues](Config::continues) it; for any other call [`Pipeline::reset`] first. (Another number of
    /// subapertures is seen and starts from the flat mirror.) From here to the end of the frame it stays the same.
    ///
    /// Every exposure must be begun, since the mirror's past is counted in frames: one whose rows
    /// never came is begun and finished without them.
    pub fn begin<const P: usize>(&mut self, config: &Config<M, P, B, K>, frame: u32) {
        if !self.mirror.is_driven(config.subapertures()) {
            self.flatten(config);
        }
        self.restarted = self.phase != Phase::Idle;
        self.totals.restarted = self.totals.restarted.saturating_add(u32::from(self.restarted));
        if self.restarted {
            // The mirror kept its shape while that frame was exposed.
            self.control.hold();
        }
        self.frame = frame;
        self.extra_rows = 0;
        self.colour = config.schedule.colour_of(frame);
        self.lacking_q16 = 0;
        self.phase = Phase::Reading;
        self.readout.begin();
        self.control.begin();
        if config.modal.is_on() {
            self.modal.begin();
        }
        self.saturated_pixels = 0;
    }

    /// Lets the flux limits of the frame that has begun be for `seen` of `asked` laser pulses.
    #[inline(never)]
    pub(crate) fn scale_flux(&mut self, seen: u32, asked: u32) {
        let part = (u64::from(seen) << 16).checked_div(u64::from(asked));
        self.lacking_q16 =
            part.map_or(0, |part| WHOLE.saturating_sub(part.min(WHOLE.into()) as u32));
    }

    /// Takes the next detector row, raw ADU below 2^bits.
    ///
    /// # Errors
    /// A [`RowError`]; the row is then not used. A row of the wrong length makes the whole frame
    /// one to be held, since what follows can no longer be trusted to be in its place.
    #[inline]
    pub fn push_row<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        pixels: &[u16],
    ) -> Result<Progress, RowError> {
        self.push_rows(config, pixels, 1)
    }

    /// Takes the next `rows` detector rows at once, row-major: what they leave is what they leave one
    /// by one, in less time, since each window is fetched and put back once for all of them.
    ///
    /// # Errors
    /// As [`Pipeline::push_row`]. Of rows that are partly beyond the detector's last, those before it
    /// are used.
    #[inline]
    pub fn push_rows<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        pixels: &[u16],
        rows: u16,
    ) -> Result<Progress, RowError> {
        if self.phase == Phase::Idle {
            return Err(RowError::NotBegun);
        }
        let used = rows.min(config.height.saturating_sub(self.readout.rows()));
        let width = usize::from(config.width);
        if used > 0 {
            if pixels.len() != usize::from(rows).wrapping_mul(width) {
                self.phase = Phase::Malformed;
                return Err(RowError::Length {
                    found: pixels.len() as u32,
                    expected: config.width,
                });
            }
            let pixels = pixels.get(..usize::from(used).wrapping_mul(width)).unwrap_or_default();
            if let Some((readout, mut windows)) = self.windows(config) {
                readout.push(config, pixels, used, &mut windows);
            }
        }
        let extra = rows.wrapping_sub(used);
        if extra > 0 {
            self.extra_rows = self.extra_rows.saturating_add(extra);
            self.totals.extra_rows = self.totals.extra_rows.saturating_add(extra.into());
            return Err(RowError::Extra);
        }
        let complete = self.readout.rows() == config.height;
        Ok(if complete { Progress::Complete } else { Progress::More })
    }

    /// Takes a whole frame as measurements made elsewhere, in subaperture order, in place of rows:
    /// a sensor that centroids by itself, or a simulation without images. Those of a second gate
    /// come behind all of the first.
    ///
    /// # Errors
    /// [`RowError::NotBegun`], [`RowError::Extra`] if rows came before, [`RowError::Length`] if
    /// there is not one measurement a window.
    pub fn push_measurements<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        measurements: &[Measurement],
    ) -> Result<Progress, RowError> {
        let expected = config.windows();
        match self.phase {
            Phase::Idle => Err(RowError::NotBegun),
            _ if self.readout.rows() > 0 => Err(RowError::Extra),
            _ if measurements.len() != expected => {
                self.phase = Phase::Malformed;
                let found = measurements.len() as u32;
                Err(RowError::Length { found, expected: expected as u16 })
            }
            _ => {
                if let Some((readout, mut windows)) = self.windows(config) {
                    readout.supply(config, measurements, &mut windows);
                }
                Ok(Progress::Complete)
            }
        }
    }

    /// The readout, and what takes its measurements: always there.
    #[inline(always)]
    fn windows<'a, const P: usize>(
        &'a mut self,
        config: &'a Config<M, P, B, K>,
    ) -> Option<(&'a mut Readout<M, B>, Windows<'a, M, P, B, K>)> {
        let windows = Windows {
            config,
            slopes: self.slopes.get_mut(1 - self.readout.complete())?,
            control: &mut self.control,
            modal: &mut self.modal,
            colour: self.colour,
            lacking_q16: self.lacking_q16,
            saturated_pixels: &mut self.saturated_pixels,
        };
        Some((&mut self.readout, windows))
    }

    /// Ends the frame: new codes if it was complete, the old ones if not.
    pub fn finish<const P: usize>(&mut self, config: &Config<M, P, B, K>) -> Report {
        self.finish_probed(config, &mut ())
    }

    /// [`Pipeline::finish`], telling `probe` after each stage. A held frame ends after slopes.
    #[inline]
    pub fn finish_probed<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        probe: &mut impl Probe,
    ) -> Report {
        let Measured { mut report, hold } = self.measure(config);
        probe.after(Stage::Slopes);
        match hold {
            Some(hold) => {
                report.outcome = Outcome::Held(hold);
                self.hold(hold);
            }
            None => self.reconstruct(config, &mut report, probe),
        }
        report
    }

    /// Ends the readout of a frame: its measurements and slopes become those of the last complete one, if
    /// it is complete. What then becomes of it is for the caller to say: [`Pipeline::follow`],
    /// [`Pipeline::keep`] or [`Pipeline::steer`].
    #[inline(always)]
    pub(crate) fn measure<const P: usize>(&mut self, config: &Config<M, P, B, K>) -> Measured {
        let hold = self.reason_to_hold(config);
        self.phase = Phase::Idle;
        let mut report = Report {
            frame: self.frame,
            outcome: Outcome::Updated,
            valid: 0,
            saturated_pixels: 0,
            residual_squared: 0,
            saturated_actuators: 0,
            slewed_actuators: 0,
            extra_rows: self.extra_rows,
            restarted: self.restarted,
            global_tilt_age: None,
            global_tilt_stale: false,
        };
        self.restarted = false;
        let hold = hold.or_else(|| self.commit(config, &mut report));
        Measured { report, hold }
    }

    /// A complete frame moves the mirror.
    ///
    /// Not inlined: a board may keep it in other memory than what decides on it.
    #[inline(never)]
    pub(crate) fn follow<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        mut report: Report,
        probe: &mut impl Probe,
    ) -> Report {
        self.reconstruct(config, &mut report, probe);
        report
    }

    /// The mirror keeps what it shows.
    pub(crate) fn keep(&mut self, report: Report, hold: Hold) -> Report {
        self.hold(hold);
        Report { outcome: Outcome::Held(hold), ..report }
    }

    /// The mirror goes by `step` and not by the frame; commands become what it then shows, so that a loop
    /// that closes does so without a jump. `cold`: its pistons have nothing to do with the last frames'.
    pub(crate) fn steer<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        (report, hold): (Report, Hold),
        cold: bool,
        step: impl FnOnce(&mut Mirror<M>) -> Limits,
    ) -> Report {
        self.total(hold);
        let Limits { saturated, slewed } = step(&mut self.mirror);
        self.control.record(self.mirror.positions().iter().map(|position| position.tilt_ulp));
        self.show(config);
        if cold && self.warm {
            self.warm = false;
            self.sor.reset();
        }
        let add = |total: &mut u32, n: u16| *total = total.saturating_add(n.into());
        add(&mut self.totals.saturated_actuators, saturated);
        add(&mut self.totals.slewed_actuators, slewed);
        Report {
            outcome: Outcome::Held(hold),
            saturated_actuators: saturated,
            slewed_actuators: slewed,
            ..report
        }
    }

    /// The mirror and its guard.
    pub(crate) const fn mirror(&self) -> &Mirror<M> {
        &self.mirror
    }

    /// The mirror, for what is no frame.
    pub(crate) const fn mirror_mut(&mut self) -> &mut Mirror<M> {
        &mut self.mirror
    }

    /// Subapertures that the last frame's sub-cycle lights.
    pub(crate) fn lit<const P: usize>(&self, config: &Config<M, P, B, K>) -> usize {
        if !config.schedule.is_partial() {
            return config.subapertures();
        }
        config.schedule.colours.iter().filter(|&&colour| colour == self.colour).count()
    }

    /// Takes over a configuration of the same mask with another mirror, number of gates or size of windows:
    /// the codes stay, and all that frames have left is forgotten but what the mirror shows.
    pub(crate) fn adopt<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.phase = Phase::Idle;
        self.forget();
        self.mirror.adopt(config);
        self.control.fill_past(self.mirror.positions().iter().map(|position| position.tilt_ulp));
        self.show(config);
    }

    /// Commands become what the mirror shows.
    fn show<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        self.shows_commands = false;
        let shown = config.nodes.iter().zip(self.mirror.positions());
        for ((node, position), command) in shown.zip(&mut self.commands) {
            self.control.adopt(node.place, position.tilt_ulp);
            *command = position.tilt_ulp;
        }
    }

    fn reason_to_hold<const P: usize>(&self, config: &Config<M, P, B, K>) -> Option<Hold> {
        let rows = self.readout.rows();
        match self.phase {
            _ if config.subapertures() == 0 => Some(Hold::NotConfigured),
            Phase::Idle => Some(Hold::NotBegun),
            Phase::Malformed => Some(Hold::WrongRow),
            Phase::Reading if rows < config.height => Some(Hold::CutShort { rows }),
            Phase::Reading => None,
        }
    }

    fn hold(&mut self, hold: Hold) {
        // Without a frame no exposure has passed.
        if !matches!(hold, Hold::NotBegun | Hold::NotConfigured) {
            self.control.hold();
        }
        self.total(hold);
    }

    fn total(&mut self, hold: Hold) {
        let total = match hold {
            Hold::NotBegun | Hold::NotConfigured => &mut self.totals.not_ready,
            Hold::CutShort { .. } => &mut self.totals.cut_short,
            Hold::WrongRow => &mut self.totals.wrong_row,
            Hold::NoLight => &mut self.totals.no_light,
            // Whoever decided that counts it.
            Hold::Poor | Hold::Mode => return,
        };
        *total = total.saturating_add(1);
    }

    /// Measurements and slopes become those of the complete frame.
    fn commit<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        report: &mut Report,
    ) -> Option<Hold> {
        if config.schedule.is_partial() {
            self.retain(config);
        }
        self.readout.commit(config);
        if K > 0 {
            self.windows = config.windows();
        }
        report.valid = self.control.valid() as u16;
        report.saturated_pixels = self.saturated_pixels;
        (report.valid == 0).then_some(Hold::NoLight)
    }

    /// What this sub-cycle did not light stays as the last complete frame left it.
    #[cold]
    #[inline(never)]
    fn retain<const P: usize>(&mut self, config: &Config<M, P, B, K>) {
        let complete = self.readout.complete();
        let colours = &config.schedule.colours;
        let lit = |i: usize| colours.get(i) == Some(&self.colour);
        self.readout.retain(config, lit);
        if let Ok([done, new]) = self.slopes.get_disjoint_mut([complete, 1 - complete]) {
            let slopes = new.iter_mut().zip(done).enumerate();
            slopes.filter(|(i, _)| !lit(*i)).for_each(|(_, (new, done))| *new = *done);
        }
    }

    /// Control law, pistons, segments and codes.
    fn reconstruct<const P: usize>(
        &mut self,
        config: &Config<M, P, B, K>,
        report: &mut Report,
        probe: &mut impl Probe,
    ) {
        let global_tilt = self.current_tilt(config.tilt_max_age, report);
        let SorConfig { grid, warm_sweeps, cold_sweeps, .. } = &config.sor;
        let mut warm_sweeps = *warm_sweeps;
        if config.schedule.is_partial() {
            let part = config.nodes.iter().zip(&config.schedule.colours);
            let part = part.filter(|(_, colour)| **colour == self.colour);
            let places = part.map(|(node, _)| node.place);
            self.control.update_part(&config.control, grid, &config.changes, places);
            warm_sweeps = config.schedule.sweeps;
        } else {
            if config.modal.is_on() {
                self.modal.correct(&config.modal, &config.nodes, &mut self.control);
            }
            self.control.update(&config.control, grid, &config.changes);
        }
        probe.after(Stage::Control);

        self.sor.load(&config.sor, self.control.commands());
        let sweeps = if self.warm { warm_sweeps } else { *cold_sweeps };
        self.warm = true;
        let totals = self.sor.relax_and_total(&config.sor, sweeps);
        report.residual_squared = totals.residual_squared;
        let mean = self.sor.common_mean(&config.sor, &config.nodes, &totals);
        probe.after(Stage::Sor);

        // Most instruments' frames: nothing is added, and commands are within their limits.
        self.shows_commands = self.global_tilt.is_none() && config.travel.is_free();
        let Self { control, sor, commands, mirror, .. } = self;
        let (newest, applied) = control.recording();
        let step = match self.shows_commands {
            #[cfg(any(target_arch = "riscv32", armv7em))]
            true if config.travel.is_level => {
                mirror.reach(config, sor.unknowns_mut(), newest, applied, mean)
            }
            true => mirror.pass_freely(
                config,
                config.nodes.iter().zip(applied),
                move |(node, _)| asked(sor, newest, node, mean),
                |(_, applied), position| *applied = position.tilt_ulp,
            ),
            false => mirror.pass(
                config,
                config.nodes.iter().zip(commands).zip(applied),
                move |((node, command), _)| {
                    let asked = asked(sor, newest, node, mean);
                    **command = asked.tilt_ulp;
                    with_global(asked, node, global_tilt)
                },
                move |(_, applied), position| {
                    let ([tip, tilt], [global_tip, global_tilt]) = (position.tilt_ulp, global_tilt);
                    *applied = [tip.wrapping_sub(global_tip), tilt.wrapping_sub(global_tilt)];
                },
            ),
        };
        report.saturated_actuators = step.limits.saturated;
        report.slewed_actuators = step.limits.slewed;
        count(&mut self.totals, report);
        probe.after(Stage::Segments);

        step.drive(config);
        probe.after(Stage::Actuators);
    }

    /// The global tilt in use: the last one given, however old.
    fn current_tilt(&mut self, max_age: u32, report: &mut Report) -> [i32; 2] {
        let Some(tilt) = self.global_tilt else { return [0; 2] };
        let age = self.frame.wrapping_sub(tilt.frame);
        // A tilt may belong to a frame that is still to come, though not by far.
        let age = if age.wrapping_neg() <= MAX_AHEAD { 0 } else { age };
        report.global_tilt_age = Some(age);
        report.global_tilt_stale = age > max_age;
        tilt.tilt_ulp
    }

    /// Gives a global tilt; it is used from the next `finish` on, until the next one is given.
    pub fn set_global_tilt(&mut self, tilt: GlobalTilt) {
        let tilt_ulp = tilt.tilt_ulp.map(|t| t.clamp(-TILT_LIMIT, TILT_LIMIT));
        self.global_tilt = Some(GlobalTilt { tilt_ulp, ..tilt });
    }

    /// The DAC codes of every segment's actuators, in subaperture order: valid at any time.
    #[must_use]
    pub fn codes(&self) -> &[[u16; ACTUATORS]] {
        self.mirror.codes()
    }

    /// Centroids, fluxes and peaks of the last complete frame, in subaperture order.
    #[must_use]
    pub fn measurements(&self) -> &[Measurement] {
        self.readout.measurements().get(..self.mirror.subapertures()).unwrap_or_default()
    }

    /// Those of the second gate; none without one.
    #[must_use]
    pub fn second_measurements(&self) -> &[Measurement] {
        self.readout.measurements().get(self.second()).unwrap_or_default()
    }

    /// Those of all windows: the second gate's come behind the others.
    #[must_use]
    pub fn window_measurements(&self) -> &[Measurement] {
        self.readout.measurements().get(..self.second().end).unwrap_or_default()
    }

    /// The slopes of the last complete frame, in subaperture order.
    #[must_use]
    pub fn slopes(&self) -> &[Slope] {
        let complete = self.slopes.get(self.readout.complete());
        complete.and_then(|slopes| slopes.get(..self.mirror.subapertures())).unwrap_or_default()
    }

    /// Those of the second gate; none without one.
    #[must_use]
    pub fn second_slopes(&self) -> &[Slope] {
        let complete = self.slopes.get(self.readout.complete());
        complete.and_then(|slopes| slopes.get(self.second())).unwrap_or_default()
    }

    /// Those of all windows: the second gate's come behind the others.
    #[must_use]
    pub fn window_slopes(&self) -> &[Slope] {
        let complete = self.slopes.get(self.readout.complete());
        complete.and_then(|slopes| slopes.get(..self.second().end)).unwrap_or_default()
    }

    fn second(&self) -> core::ops::Range<usize> {
        let count = self.mirror.subapertures();
        count..self.windows.max(count)
    }

    /// The tip/tilt commands, without the global tilt, ulp, in subaperture order.
    #[must_use]
    pub fn commands(&self) -> &[[i32; 2]] {
        let commands = if self.shows_commands { self.control.shown() } else { &self.commands };
        commands.get(..self.mirror.subapertures()).unwrap_or_default()
    }

    /// Piston, tip and tilt of every segment after all limits, in subaperture order.
    #[must_use]
    pub fn positions(&self) -> &[Position] {
        self.mirror.positions()
    }

    /// Totals since the last reset.
    #[must_use]
    pub const fn totals(&self) -> Totals {
        self.totals
    }
}

/// A frame that has been measured, and why it cannot be followed.
#[must_use = "every exposure is followed, kept or steered"]
pub(crate) struct Measured {
    pub(crate) report: Report,
    pub(crate) hold: Option<Hold>,
}

/// What is not as in every frame: a sub-cycle that lights a part of the pupil, or missing laser pulses.
#[derive(Clone, Copy)]
struct Special<'a> {
    /// Empty where all are lit.
    colours: &'a [u8],
    colour: u8,
    pulses_q16: u32,
}

impl<'a> Special<'a> {
    fn new<const M: usize>(
        schedule: &'a Schedule<M>,
        colour: u8,
        lacking_q16: u32,
    ) -> Option<Self> {
        let colours = if schedule.is_partial() { schedule.colours.as_slice() } else { &[] };
        let special = !colours.is_empty() || lacking_q16 != 0;
        special.then_some(Self { colours, colour, pulses_q16: WHOLE - lacking_q16 })
    }

    fn lights(&self, i: usize) -> bool {
        self.colours.get(i).is_none_or(|&colour| colour == self.colour)
    }
}

/// What becomes of measurements as windows end.
struct Windows<'a, const M: usize, const P: usize, const B: usize, const K: usize> {
    config: &'a Config<M, P, B, K>,
    slopes: &'a mut [Slope; M],
    control: &'a mut Control<M>,
    modal: &'a mut Modal<K>,
    /// As in [`Pipeline`].
    colour: u8,
    lacking_q16: u32,
    saturated_pixels: &'a mut u32,
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Sink<M>
    for Windows<'_, M, P, B, K>
{
    /// Slopes and pseudo-open-loop slopes of windows: subapertures', or their ones of the second gate.
    #[inline(always)]
    fn take(&mut self, windows: [usize; 2], measurements: &[Measurement]) {
        match Special::new(&self.config.schedule, self.colour, self.lacking_q16) {
            None => self.take_ordinary(windows, measurements),
            Some(special) => self.take_special(&special, windows, measurements),
        }
        if self.config.modal.is_on() {
            self.take_second(windows, measurements);
        }
    }

    #[cfg(target_arch = "riscv32")]
    #[inline(always)]
    fn subapertures(&mut self, [first, next]: [usize; 2]) -> Option<Subapertures<'_, M>> {
        let Self { config, slopes, control, saturated_pixels, .. } = self;
        let ordinary = Special::new(&config.schedule, self.colour, self.lacking_q16).is_none();
        let bounded = config.free_slopes && config.slope_scale.left == 0;
        if !ordinary || config.modal.is_on() || !bounded {
            return None;
        }
        let (applied, taking) = control.taking(&config.control)?;
        Some(Subapertures {
            calibration: config.slopes.get(first..next)?,
            applied: applied.get(first..next)?,
            slopes: slopes.get_mut(first..next)?,
            taking,
            saturated_pixels,
        })
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Windows<'_, M, P, B, K> {
    /// [`Sink::take`] of a frame that is as every other.
    ///
    /// Not inlined: it needs all registers.
    #[inline(never)]
    fn take_ordinary(&mut self, [first, next]: [usize; 2], measurements: &[Measurement]) {
        let Self { config, slopes, control, saturated_pixels, .. } = self;
        let Some((applied, mut control)) = control.taking(&config.control) else { return };
        let (calibration, nodes) = (config.slopes.as_slice(), config.nodes.as_slice());
        let scale = config.slope_scale;
        let mut saturated = 0;
        let mut slope = |calibration, measurement: &Measurement, place: &mut Slope| {
            saturated += u32::from(measurement.saturated);
            let slope = slopes::slope(calibration, scale, measurement);
            *place = slope;
            slope
        };
        // As many of everything, so that one comparison finds a subaperture in all.
        let count = nodes.len();
        let (Some(measurements), Some(places), Some(calibration), Some(applied)) = (
            measurements.get(..count),
            slopes.get_mut(..count),
            calibration.get(..count),
            applied.get(..count),
        ) else {
            return;
        };
        let slots = config.slots.get(first..next).unwrap_or_default();
        control.take(slots.iter().filter_map(|slot| {
            let i = usize::from(slot.subaperture);
            let (measurement, place) = (measurements.get(i)?, places.get_mut(i)?);
            let slope = slope(calibration.get(i)?, measurement, place);
            Some((nodes.get(i)?.place, slope, *applied.get(i)?))
        }));
        **saturated_pixels += saturated;
    }

    /// [`Sink::take`] of a frame that is not.
    #[cold]
    #[inline(never)]
    fn take_special(
        &mut self,
        special: &Special<'_>,
        [first, next]: [usize; 2],
        measurements: &[Measurement],
    ) {
        let config = self.config;
        let scale = config.slope_scale;
        let Some((applied, mut control)) = self.control.taking(&config.control) else { return };
        for slot in config.slots.get(first..next).unwrap_or_default() {
            let i = usize::from(slot.subaperture);
            let (Some(measurement), Some(calibration), Some(node), Some(place), Some(&applied)) = (
                measurements.get(i),
                config.slopes.get(i),
                config.nodes.get(i),
                self.slopes.get_mut(i),
                applied.get(i),
            ) else {
                continue;
            };
            if !special.lights(i) {
                control.retain(node.place);
                continue;
            }
            *self.saturated_pixels += u32::from(measurement.saturated);
            let mut slope = slopes::slope(calibration, scale, measurement);
            slope.valid =
                slopes::valid_in_proportion(calibration, measurement.flux, special.pulses_q16);
            *place = slope;
            control.take(core::iter::once((node.place, slope, applied)));
        }
    }

    /// [`Sink::take`] of windows of the second gate, whose subapertures' first ones have been taken.
    ///
    /// Cold, so that one gate alone pays nothing for it.
    #[cold]
    #[inline(never)]
    fn take_second(&mut self, [first, next]: [usize; 2], measurements: &[Measurement]) {
        let config = self.config;
        let scale = config.slope_scale;
        let Some((applied, _)) = self.control.taking(&config.control) else { return };
        for slot in config.slots.get(first..next).unwrap_or_default() {
            let i = usize::from(slot.subaperture);
            let Some(first) = i.checked_sub(config.nodes.len()) else { continue };
            let (Some(measurement), Some(calibration)) =
                (measurements.get(i), config.slopes.get(i))
            else {
                continue;
            };
            let mut slope = slopes::slope(calibration, scale, measurement);
            if self.lacking_q16 != 0 {
                let pulses = WHOLE - self.lacking_q16;
                slope.valid = slopes::valid_in_proportion(calibration, measurement.flux, pulses);
            }
            if let Some(place) = self.slopes.get_mut(i) {
                *place = slope;
            }
            if let (Some(firsts), Some(&applied)) = (self.slopes.get(first), applied.get(first)) {
                self.modal.take(&config.modal, first, &Pair::new(applied, firsts, &slope));
            }
        }
    }
}

fn count(totals: &mut Totals, report: &Report) {
    let add = |total: &mut u32, n: u32| *total = total.saturating_add(n);
    add(&mut totals.updated, 1);
    add(&mut totals.stale_tilt, u32::from(report.global_tilt_stale));
    add(&mut totals.saturated_actuators, u32::from(report.saturated_actuators));
    add(&mut totals.slewed_actuators, u32::from(report.slewed_actuators));
}

/// The position asked of a segment: its command, and its piston, of which `mean` is taken off.
#[inline(always)]
fn asked<const M: usize>(
    sor: &mut Sor<M>,
    commands: &RedBlack<[i32; 2], M>,
    node: &Node,
    mean: i32,
) -> Position {
    match (commands.get(node.place), sor.centred_piston(node.place, mean)) {
        (Some(&tilt_ulp), Some(piston_ulp)) => Position { piston_ulp, tilt_ulp },
        _ => Position::default(),
    }
}

/// The position asked of a segment, with the global tilt's.
///
/// A global tilt T (centre to edge over half a pitch) is the plane T (2x - (N - 1)) of pistons:
/// known exactly, so it is added and not solved for.
#[inline(always)]
fn with_global(asked: Position, node: &Node, global: [i32; 2]) -> Position {
    let ([tip, tilt], [global_tip, global_tilt], [x, y]) = (asked.tilt_ulp, global, node.centre);
    // Twice 2^23 x 39, and a piston below 2^25: within 2^29.4.
    let plane = global_tip.wrapping_mul(x.into()).wrapping_add(global_tilt.wrapping_mul(y.into()));
    let add = |a: i32, b: i32| fixed::clamp_raised(a.wrapping_add(b), TILT_LIMIT);
    let [raised_tip, raised_tilt] = global.map(|t| t.wrapping_add(TILT_LIMIT));
    Position {
        piston_ulp: plane.wrapping_add(asked.piston_ulp),
        tilt_ulp: [add(tip, raised_tip), add(tilt, raised_tilt)],
    }
}
