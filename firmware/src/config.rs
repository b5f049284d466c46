//! The configuration: a specification that was checked once and can no longer be wrong.
//!
//! One [`Config`] is one calibration bank. It is built in place, because it is larger than a
//! board's stack, and everything is checked before anything is written: a refused specification
//! leaves the bank as it was. The frame path borrows the bank, so that two of them can be swapped
//! between frames.

#[cfg(target_arch = "riscv32")]
use crate::actuators::Line;
use crate::actuators::{Drive, Law, Response};
use crate::calibration::Calibration;
use crate::centroid::{EstimatorConfig, Template};
use crate::control::{Changes, ControlConfig, Gains};
#[cfg(target_arch = "riscv32")]
use crate::dsp::spots::{self, Limits};
use crate::error::ConfigError;
use crate::fixed::LENGTH_BITS;
use crate::gate::{GateTiming, Range, ShortFrame};
use crate::geometry::{Grid, Mask};
use crate::ladder::LadderLimits;
use crate::mirror::Serials;
use crate::modal::{ModalConfig, ModalHead};
use crate::omega;
use crate::pixels::Bank;
use crate::quality::QualityLimits;
use crate::quantise::Quantiser;
use crate::redblack::{Place, RedBlack};
use crate::schedule::{self, Schedule};
#[cfg(target_arch = "riscv32")]
use crate::segments::Lever;
use crate::segments::{ACTUATORS, Segment, Travel};
use crate::slopes::{SlopeCalibration, SlopeScale};
use crate::sor::{Coupling, Node, SorConfig};
use crate::spec::{SorSpec, Spec};
use crate::validate;
use serde::{Deserialize, Serialize};

/// Sweeps of the first frame after a reset, in those of any other: it starts from nothing.
const COLD: u16 = 4;

/// Where a window is and whose it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slot {
    /// Column of its first pixel.
    pub x0: u16,
    /// Row of its first pixel.
    pub y0: u16,
    /// Its subaperture; in the second gate, that and the number of subapertures.
    pub subaperture: u16,
}

/// A validated configuration.
///
/// Capacities: `M` cells of the subaperture grid (N x N) and windows (two a subaperture with two
/// gates), `P` window pixels (windows x W x W), `B` pixels that brightest-n can buffer (windows that
/// share a row, x W x W; 0 without that estimator), `K` modes of a second gate (0 without one, and
/// without the code for it). Results depend on the specification only, never on the capacities.
#[derive(Debug)]
pub struct Config<const M: usize, const P: usize, const B: usize, const K: usize = 0> {
    pub(crate) mask: Option<Mask>,
    pub(crate) width: u16,
    pub(crate) height: u16,
    /// Bits of a raw pixel.
    pub(crate) bits: u8,
    /// Whether raw values and fixed thresholds are below 2^15.
    pub(crate) low_thresholds: bool,
    /// Whether fluxes are as [`spots::are_small`] says.
    #[cfg(target_arch = "riscv32")]
    pub(crate) small_fluxes: bool,
    pub(crate) window: usize,
    /// Windows in readout order: by first row, then first column.
    pub(crate) slots: heapless::Vec<Slot, M>,
    /// As these: bytes in a frame before a window's first pixel, modulo addresses.
    #[cfg(target_arch = "riscv32")]
    pub(crate) starts: heapless::Vec<usize, M>,
    /// Whether all these are words.
    #[cfg(target_arch = "riscv32")]
    pub(crate) in_words: bool,
    /// Whether the order of windows is that of their subapertures.
    pub(crate) in_order: bool,
    pub(crate) bank: Bank<P>,
    pub(crate) estimator: EstimatorConfig,
    pub(crate) template: Template,
    /// Windows that a row can meet at once.
    pub(crate) concurrent: usize,
    /// Mean fixed threshold of each window, signal units: the first gate's, then the second's.
    pub(crate) base_thresholds: heapless::Vec<u16, M>,
    /// As slopes: what a kernel of one gate takes of them and of thresholds.
    #[cfg(target_arch = "riscv32")]
    pub(crate) limits: heapless::Vec<Limits<M>, M>,
    /// As these.
    pub(crate) slopes: heapless::Vec<SlopeCalibration, M>,
    pub(crate) modal: ModalConfig<M, K>,
    pub(crate) gain_exponent: u32,
    /// Of that.
    pub(crate) slope_scale: SlopeScale,
    /// Whether no centroid of signals makes a slope that has to be limited.
    pub(crate) free_slopes: bool,
    pub(crate) control: ControlConfig,
    /// Per node; zero where there is no subaperture.
    pub(crate) changes: RedBlack<Changes, M>,
    pub(crate) tilt_max_age: u32,
    pub(crate) nodes: heapless::Vec<Node, M>,
    pub(crate) sor: SorConfig<M>,
    pub(crate) segments: heapless::Vec<Segment, M>,
    /// Of these.
    #[cfg(target_arch = "riscv32")]
    pub(crate) levers: heapless::Vec<Lever, M>,
    pub(crate) travel: Travel,
    pub(crate) drive: Drive,
    pub(crate) responses: heapless::Vec<[Response; ACTUATORS], M>,
    /// Of these.
    #[cfg(target_arch = "riscv32")]
    pub(crate) lines: heapless::Vec<[Line; ACTUATORS], M>,
    pub(crate) timing: GateTiming,
    pub(crate) range: Range,
    pub(crate) short_frame: ShortFrame,
    pub(crate) schedule: Schedule<M>,
    pub(crate) quality: QualityLimits,
    pub(crate) ladder: LadderLimits,
    pub(crate) serials: Serials,
    pub(crate) lsb_m: f64,
    pub(crate) adu_per_unit: f64,
    pub(crate) omega: f64,
    /// Record of the calibration that it carries.
    pub(crate) calibrated: Option<Calibration>,
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Default
    for Config<M, P, B, K>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// A configuration without subapertures: every frame is held. All zeros, so that a `static` one
    /// takes no place in an image.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            mask: None,
            width: 0,
            height: 0,
            bits: 0,
            low_thresholds: false,
            #[cfg(target_arch = "riscv32")]
            small_fluxes: false,
            window: 0,
            slots: heapless::Vec::new(),
            #[cfg(target_arch = "riscv32")]
            starts: heapless::Vec::new(),
            #[cfg(target_arch = "riscv32")]
            in_words: false,
            in_order: false,
            bank: Bank::new(),
            estimator: EstimatorConfig::CentreOfGravity { peak_fraction: 0 },
            template: Template::EMPTY,
            concurrent: 0,
            base_thresholds: heapless::Vec::new(),
            #[cfg(target_arch = "riscv32")]
            limits: heapless::Vec::new(),
            slopes: heapless::Vec::new(),
            modal: ModalConfig::NONE,
            gain_exponent: 0,
            slope_scale: SlopeScale { up: 0, left: 0, limit: 0 },
            free_slopes: false,
            control: ControlConfig { mean: crate::slopes::MeanSlope::Remove, delay: 0 },
            changes: RedBlack::new(Changes::NONE),
            tilt_max_age: 0,
            nodes: heapless::Vec::new(),
            sor: SorConfig::EMPTY,
            segments: heapless::Vec::new(),
            #[cfg(target_arch = "riscv32")]
            levers: heapless::Vec::new(),
            travel: Travel {
                ratio_bits: 0,
                slew_ulp: 0,
                tilts_shrink: false,
                slews: false,
                is_level: false,
                is_short: false,
            },
            drive: Drive { law: Law::Linear, spare_bits: 0 },
            responses: heapless::Vec::new(),
            #[cfg(target_arch = "riscv32")]
            lines: heapless::Vec::new(),
            timing: GateTiming { delay_ns: 0, width_ns: 0, period_ns: 0, pulses_per_frame: 0 },
            range: Range { altitude_mm: 0, depth_mm: 0, zenith_mdeg: 0 },
            short_frame: ShortFrame::Mark,
            schedule: Schedule::NONE,
            quality: QualityLimits {
                valid_min: 0,
                flux_min: 0,
                flux_max: 0,
                saturated_pixels_max: 0,
            },
            ladder: LadderLimits {
                hold_frames: 0,
                safe_frames: 0,
                leak_q16: 0,
                saturated_actuators: 0,
                saturated_frames: 0,
            },
            serials: Serials { mirror: 0, detector: 0 },
            lsb_m: 0.0,
            adu_per_unit: 0.0,
            omega: 0.0,
            calibrated: None,
        }
    }

    /// Builds the configuration of `spec` in place.
    ///
    /// # Errors
    /// A [`ConfigError`] with field, value and limit of the first value refused; `self` is then
    /// as it was.
    pub fn build(&mut self, spec: &Spec<'_>) -> Result<(), ConfigError> {
        if spec.modal.is_some() {
            ModalConfig::<M, K>::check_room(validate::modes(spec))?;
        }
        validate::geometry::<M, P>(spec)?;
        validate::windows(spec)?;
        let control = validate::control(spec)?;
        let timing = spec.gate.timing()?;
        let quantiser = Quantiser::new(spec)?;
        let (estimator, weight_fwhm_px) = quantiser.estimator()?;
        let concurrent =
            validate::buffer::<B>(&estimator, spec.windows.size.into(), spec.origins())?;
        let slew_ulp = quantiser.slew_ulp()?;
        let (quality, ladder) = quantiser.safety()?;
        schedule::check(spec)?;
        let count = spec.mask.count();
        for i in 0..count {
            quantiser.slope(i)?;
            quantiser.second_slope(i).transpose()?;
            quantiser.gains(i)?;
            quantiser.segment(i)?;
            quantiser.responses(i)?;
        }
        validate::sor(spec)?;
        let modal = quantiser.modal()?;
        ModalConfig::<M, K>::check_modes(count, modal, |i| quantiser.gradients(modal, i))?;

        self.mask = Some(spec.mask);
        self.width = spec.detector.width;
        self.height = spec.detector.height;
        self.bits = spec.detector.bits;
        self.window = usize::from(spec.windows.size);
        self.estimator = estimator;
        match weight_fwhm_px {
            Some(fwhm_px) => self.template.fill(fwhm_px),
            None => self.template = Template::EMPTY,
        }
        self.concurrent = concurrent;
        self.set_gain_exponent(quantiser.gain_exponent);
        self.control = control;
        self.tilt_max_age = spec.control.global_tilt_max_age;
        let spare_bits = 16 - u32::from(spec.actuators.dac_bits.clamp(8, 16));
        self.drive = Drive { law: spec.actuators.law, spare_bits };
        self.timing = timing;
        self.range = spec.gate.range();
        self.short_frame = spec.gate.short_frame;
        self.quality = quality;
        self.ladder = ladder;
        self.serials = spec.serials;
        self.lsb_m = quantiser.lsb_m;
        self.adu_per_unit = quantiser.adu_per_unit;
        self.calibrated = None;
        self.fill_nodes(&spec.mask);
        self.fill_subapertures(&quantiser, spec)?;
        self.fill_modal(&quantiser, modal, count)?;
        self.schedule.fill(spec);
        self.fill_bank(&quantiser, spec);
        self.fill_mirror(quantiser.ratio_bits, slew_ulp);
        self.find_bounds();
        self.fill_sor(spec.mask.across(), &spec.sor);
        Ok(())
    }

    pub(crate) fn set_gain_exponent(&mut self, exponent: u32) {
        self.gain_exponent = exponent;
        self.slope_scale = SlopeScale::new(exponent);
    }

    /// Back to no subapertures.
    pub(crate) fn forget(&mut self) {
        self.mask = None;
        self.calibrated = None;
        self.clear();
        self.bank.clear();
        self.nodes.clear();
    }

    fn clear(&mut self) {
        self.slots.clear();
        #[cfg(target_arch = "riscv32")]
        self.starts.clear();
        self.modal.head = ModalHead::default();
        self.base_thresholds.clear();
        #[cfg(target_arch = "riscv32")]
        self.limits.clear();
        self.slopes.clear();
        self.changes.fill(Changes::NONE);
        self.schedule.colours.clear();
        self.segments.clear();
        self.responses.clear();
        #[cfg(target_arch = "riscv32")]
        {
            self.levers.clear();
            self.lines.clear();
        }
    }

    /// Everything that is one entry a subaperture. All of it was checked; no push can fail.
    fn fill_subapertures(&mut self, q: &Quantiser<'_>, spec: &Spec<'_>) -> Result<(), ConfigError> {
        self.clear();
        for (i, &[x0, y0]) in spec.windows.origins.iter().enumerate() {
            let segment = q.segment(i)?;
            let responses = q.responses(i)?;
            let _ = self.slots.push(Slot { x0, y0, subaperture: i as u16 });
            let _ = self.base_thresholds.push(q.base_threshold([x0, y0]));
            let _ = self.slopes.push(q.slope(i)?);
            self.set_gains(i, q.gains(i)?);
            let _ = self.segments.push(segment);
            let _ = self.responses.push(responses);
        }
        let second = spec.modal.map_or(&[][..], |modal| modal.origins);
        for (i, &[x0, y0]) in second.iter().enumerate() {
            let subaperture = (spec.windows.origins.len() + i) as u16;
            let _ = self.slots.push(Slot { x0, y0, subaperture });
            let _ = self.base_thresholds.push(q.base_threshold([x0, y0]));
            if let Some(slope) = q.second_slope(i).transpose()? {
                let _ = self.slopes.push(slope);
            }
        }
        self.slots.sort_unstable_by_key(|slot| (slot.y0, slot.x0));
        self.find_order();
        Ok(())
    }

    /// Due behind a change of segments, responses, ratio bits or the slew limit.
    pub(crate) fn fill_mirror(&mut self, ratio_bits: u32, slew_ulp: i32) {
        self.travel = Travel::new(ratio_bits, slew_ulp, &self.segments, &self.responses);
        #[cfg(target_arch = "riscv32")]
        {
            self.levers.clear();
            self.lines.clear();
            for (segment, responses) in self.segments.iter().zip(&self.responses) {
                let _ = self.levers.push(segment.lever());
                let _ = self.lines.push(responses.each_ref().map(Response::line));
            }
        }
    }

    /// Due behind a change of thresholds, slopes, their scale, window, estimator, highest raw value or nodes.
    pub(crate) fn find_bounds(&mut self) {
        let is_low = |level: u16| level <= i16::MAX as u16;
        self.low_thresholds =
            is_low(self.bank.top) && self.base_thresholds.iter().all(|&base| is_low(base));
        let (scale, window) = (self.slope_scale, self.window);
        self.free_slopes = self.slopes.iter().all(|slope| slope.is_free(scale, window));
        #[cfg(target_arch = "riscv32")]
        {
            let (low, fraction) = (self.low_thresholds, self.estimator.peak_fraction());
            self.small_fluxes = spots::are_small(window * window, self.bank.top);
            self.limits.clear();
            let subapertures = self.base_thresholds.iter().zip(&self.slopes).zip(&self.nodes);
            for ((&base, slope), node) in subapertures {
                let _ = self.limits.push(Limits::new((base, low), fraction, (slope, scale), node));
            }
        }
    }

    /// Due behind a change of slots or the detector's width.
    pub(crate) fn find_order(&mut self) {
        self.in_order = (0..).zip(&self.slots).all(|(i, slot)| slot.subaperture == i);
        #[cfg(target_arch = "riscv32")]
        {
            let width = usize::from(self.width);
            self.starts.clear();
            for slot in &self.slots {
                let pixels = usize::from(slot.y0).wrapping_mul(width).wrapping_add(slot.x0.into());
                let _ = self.starts.push(pixels.wrapping_mul(size_of::<u16>()));
            }
            self.in_words = self.starts.iter().all(|start| start.is_multiple_of(size_of::<u32>()));
        }
    }

    fn fill_modal(
        &mut self,
        q: &Quantiser<'_>,
        head: ModalHead,
        count: usize,
    ) -> Result<(), ConfigError> {
        self.modal.head = head;
        let modes = usize::from(head.modes);
        for (i, gradients) in self.modal.gradients.iter_mut().take(count).enumerate() {
            *gradients = q.gradients(head, i);
        }
        for (k, row) in self.modal.coupling.iter_mut().take(modes).enumerate() {
            for (j, entry) in row.iter_mut().take(modes).enumerate() {
                *entry = q.coupling(k, j)?;
            }
        }
        Ok(())
    }

    fn fill_bank(&mut self, quantiser: &Quantiser<'_>, spec: &Spec<'_>) {
        self.bank.clear();
        self.bank.threshold_shift = quantiser.threshold_shift;
        self.bank.convention = spec.pixels.convention;
        self.bank.top = quantiser.top();
        self.bank.saturation = spec.pixels.saturation_adu.unwrap_or(self.bank.top);
        for slot in &self.slots {
            for (x, y) in quantiser.window([slot.x0, slot.y0]) {
                self.bank.push(quantiser.pixel(x, y));
            }
        }
    }

    /// The gains of a subaperture whose node there is.
    pub(crate) fn set_gains(&mut self, i: usize, gains: Gains) {
        if let Some(place) = self.nodes.get(i).and_then(|node| self.changes.get_mut(node.place)) {
            *place = gains.into();
        }
    }

    /// Where the subapertures are on the solver's grid, and what belongs together.
    pub(crate) fn fill_nodes(&mut self, mask: &Mask) {
        let grid = Grid::new(mask.across());
        let sor = &mut self.sor;
        sor.grid = grid;
        sor.couplings.fill(Coupling::NONE);
        sor.surplus = 0;
        self.nodes.clear();
        for (x, y) in mask.cells() {
            let place = Place::new::<M>(grid.node(x, y));
            sor.surplus += if place.is_black::<M>() { -1 } else { 1 };
            let centre = [x, y].map(|i| (2 * i as i32 - (mask.across() as i32 - 1)) as i8);
            let _ = self.nodes.push(Node { place, component: u16::MAX, centre });
            let west = x > 0 && mask.contains(x - 1, y);
            let north = y > 0 && mask.contains(x, y - 1);
            let links = [west, mask.contains(x + 1, y), north, mask.contains(x, y + 1)];
            if let Some(coupling) = sor.couplings.get_mut(place) {
                *coupling = Coupling::new(links);
            }
        }
        label_components(&mut self.nodes, &grid);
        sor.sizes.clear();
        for component in 0..u16::MAX {
            let size = self.nodes.iter().filter(|node| node.component == component).count();
            if size == 0 {
                break;
            }
            let _ = sor.sizes.push(size as u16);
        }
    }

    /// The relaxation of those nodes.
    pub(crate) fn fill_sor(&mut self, across: usize, spec: &SorSpec) {
        let sor = &mut self.sor;
        // Long and narrow pupils have more than a given one may be.
        self.omega = spec.omega.unwrap_or_else(|| omega::optimal(sor, &self.nodes).min(1.99));
        let sweeps = spec.sweeps.unwrap_or_else(|| omega::sweeps(self.omega, across));
        sor.warm_sweeps = sweeps;
        self.schedule.share(sweeps);
        sor.cold_sweeps = spec.cold_sweeps.unwrap_or(COLD.saturating_mul(sweeps));
        // omega is 1 to 1.99.
        let overshoot_q32 = libm::round((self.omega - 1.0) * f64::from(1u32 << 31) * 2.0) as u32;
        sor.relax_by(overshoot_q32, &self.nodes);
    }

    /// Whether a position of a segment means the same codes in both.
    pub(crate) fn same_mechanics(&self, other: &Self) -> bool {
        self.segments == other.segments
            && self.responses == other.responses
            && self.drive == other.drive
            && self.travel == other.travel
            && self.lsb_m == other.lsb_m
    }

    /// Subapertures in use, in mask order.
    #[must_use]
    pub fn subapertures(&self) -> usize {
        self.nodes.len()
    }

    /// Windows: one a subaperture, two with two gates.
    #[must_use]
    pub fn windows(&self) -> usize {
        self.slots.len()
    }

    /// Modes of the second gate; 0 without one.
    #[must_use]
    pub fn modes(&self) -> usize {
        usize::from(self.modal.head.modes)
    }

    /// The mask; `None` before the first build.
    #[must_use]
    pub const fn mask(&self) -> Option<&Mask> {
        self.mask.as_ref()
    }

    /// Pixels in a detector row.
    #[must_use]
    pub const fn width(&self) -> u16 {
        self.width
    }

    /// Rows in a frame.
    #[must_use]
    pub const fn height(&self) -> u16 {
        self.height
    }

    /// Bits of a raw pixel.
    #[must_use]
    pub const fn bits(&self) -> u8 {
        self.bits
    }

    /// The gate's and the frame's timing.
    #[must_use]
    pub const fn timing(&self) -> GateTiming {
        self.timing
    }

    /// The range that is gated at the start.
    #[must_use]
    pub const fn range(&self) -> Range {
        self.range
    }

    /// What becomes of a frame with fewer laser pulses.
    #[must_use]
    pub const fn short_frame(&self) -> ShortFrame {
        self.short_frame
    }

    /// What a frame must be to be followed.
    #[must_use]
    pub const fn quality(&self) -> QualityLimits {
        self.quality
    }

    /// When the ladder is climbed.
    #[must_use]
    pub const fn ladder(&self) -> LadderLimits {
        self.ladder
    }

    /// The mirror and the detector it is for.
    #[must_use]
    pub const fn serials(&self) -> Serials {
        self.serials
    }

    /// Sub-cycles of a cycle: 1 without a schedule.
    #[must_use]
    pub fn colours(&self) -> u8 {
        self.schedule.count.max(1)
    }

    /// The colour of each subaperture, in mask order: the sub-cycle that lights it.
    #[must_use]
    pub fn colouring(&self) -> &[u8] {
        &self.schedule.colours
    }

    /// Optical path per length ulp, m: the unit of every tip, tilt, piston and height.
    #[must_use]
    pub fn ulp_m(&self) -> f64 {
        self.lsb_m / f64::from(1 << LENGTH_BITS)
    }

    /// Calibrated ADU per unit of flux and peak.
    #[must_use]
    pub const fn adu_per_unit(&self) -> f64 {
        self.adu_per_unit
    }

    /// The relaxation factor.
    #[must_use]
    pub const fn omega(&self) -> f64 {
        self.omega
    }

    /// Connected components of the mask: each has its own mean piston, which is removed.
    #[must_use]
    pub fn components(&self) -> usize {
        self.sor.sizes.len()
    }

    /// What the piston solver needs of the mask.
    #[must_use]
    pub const fn solver(&self) -> &SorConfig<M> {
        &self.sor
    }

    /// Where each subaperture is in the solver, in mask order.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Sweeps of a warm frame.
    #[must_use]
    pub const fn sweeps(&self) -> u16 {
        self.sor.warm_sweeps
    }
}

/// Numbers the connected components of the mask by their first subaperture.
fn label_components<const M: usize>(nodes: &mut heapless::Vec<Node, M>, grid: &Grid) {
    let mut components = 0;
    for first in 0..nodes.len() {
        if nodes.get(first).is_none_or(|node| node.component != u16::MAX) {
            continue;
        }
        // Subapertures found and not yet looked around from: each enters once.
        let mut found = heapless::Vec::<u16, M>::new();
        let visit = |nodes: &mut [Node], found: &mut heapless::Vec<u16, M>, padded: usize| {
            let place = nodes.binary_search_by_key(&padded, |node| node.place.padded::<M>());
            if let Some(node) = place.ok().and_then(|i| nodes.get_mut(i))
                && node.component == u16::MAX
            {
                node.component = components;
                // Below 2 x 1600.
                let _ = found.push(padded as u16);
            }
        };
        let start = nodes.get(first).map_or(0, |node| node.place.padded::<M>());
        visit(nodes, &mut found, start);
        while let Some(padded) = found.pop() {
            let f = usize::from(padded);
            for next in [f - 1, f + 1, f - grid.stride, f + grid.stride] {
                visit(nodes, &mut found, next);
            }
        }
        components += 1;
    }
}
