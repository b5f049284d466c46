//! Telemetry as FITS tables.
//!
//! | array | a row is |
//! |---|---|
//! | `CONFIG` | bytes of the image that ran at the end of the record |
//! | `FRAMES` | a frame: number, time, configuration, mode, gate stamp, report, fault, cycles |
//! | `SLOPES` | a frame: tip and tilt of each window, m of optical path from centre to edge, and validity |
//! | `COMMANDS` | a frame: piston, tip and tilt of each segment, m |
//! | `CODES` | a frame: DAC codes of each segment's actuators |
//! | `FLUXES` | a frame: centroid of each window, px; flux and peak, ADU; saturated pixels |
//! | `FAULTS` | a fault, of a frame or not: the last frame begun, time, kind, what it says of itself |
//!
//! The windows of a second gate come behind the first's in every row. Every header has the hashes of build and
//! configuration, the serial numbers, and how many subapertures and windows there are; every row its frame's number. A
//! frame of which a piece is missing is left out and counted.

use crate::files::fits::{Column, FitsError, FitsWriter, Header, Values};
use splash_firmware::centroid::Measurement;
use splash_firmware::fault::{NAMES, Record as FaultRecord};
use splash_firmware::fixed::CENTROID_BITS;
use splash_firmware::image::Head;
use splash_firmware::link::{Identity, Status};
use splash_firmware::pipeline::Outcome;
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;
use splash_firmware::telemetry::{Dropped, FrameRecord, Record};
use std::path::Path;

use super::parameters::ulp_m;

/// What has come.
#[derive(Debug, Default)]
pub struct Recording {
    subapertures: usize,
    windows: usize,
    frames: Vec<FrameRecord>,
    slopes: Lists<Slope>,
    commands: Lists<Position>,
    codes: Lists<[u16; 3]>,
    fluxes: Lists<Measurement>,
    faults: Vec<FaultRecord>,
}

/// What a stream says, frame after frame.
#[derive(Debug)]
struct Lists<T> {
    frames: Vec<u32>,
    /// Of all subapertures or windows, frame after frame.
    items: Vec<T>,
    /// The frame whose pieces are coming, with those that have come.
    pending: Option<(u32, Vec<T>)>,
    /// Frames of which a piece is missing.
    cut: u32,
}

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self { frames: Vec::new(), items: Vec::new(), pending: None, cut: 0 }
    }
}

impl<T: Copy> Lists<T> {
    fn forget(&mut self) {
        self.frames.clear();
        self.items.clear();
    }

    fn take(&mut self, count: usize, frame: u32, first: u16, items: &[T]) {
        if first == 0 {
            self.cut += u32::from(self.pending.is_some());
            self.pending = Some((frame, Vec::with_capacity(count)));
        }
        match &mut self.pending {
            Some((due, all)) if *due == frame && all.len() == usize::from(first) => {
                all.extend_from_slice(items);
                if all.len() >= count {
                    self.frames.push(frame);
                    self.items.extend(all.iter().take(count));
                    self.pending = None;
                }
            }
            Some(_) => {
                self.cut += 1;
                self.pending = None;
            }
            // A later piece of a frame that is already given up, or began before the record.
            None => {}
        }
    }
}

/// Whose telemetry it is.
#[derive(Clone, Debug)]
pub struct Source<'a> {
    /// What the board says it is.
    pub identity: &'a Identity,
    /// How it was at the end.
    pub status: &'a Status,
    /// What ran at the end.
    pub head: &'a Head,
    /// Its image.
    pub image: &'a [u8],
    /// What the board dropped.
    pub dropped: Dropped,
}

impl Recording {
    /// An empty one of so many subapertures and windows.
    pub fn new(subapertures: usize, windows: usize) -> Self {
        Self { subapertures, windows, ..Self::default() }
    }

    /// Takes a record.
    pub fn take(&mut self, record: Record) {
        let (count, windows) = (self.subapertures, self.windows);
        match record {
            Record::Frame(frame) => self.frames.push(frame),
            Record::Slopes { frame, first, items } => {
                self.slopes.take(windows, frame, first, &items);
            }
            Record::Commands { frame, first, items } => {
                self.commands.take(count, frame, first, &items);
            }
            Record::Codes { frame, first, items } => self.codes.take(count, frame, first, &items),
            Record::Fluxes { frame, first, items } => {
                self.fluxes.take(windows, frame, first, &items);
            }
            Record::Fault(fault) => self.faults.push(fault),
        }
    }

    /// Forgets what is complete.
    pub fn forget(&mut self) {
        self.frames.clear();
        self.slopes.forget();
        self.commands.forget();
        self.codes.forget();
        self.fluxes.forget();
        self.faults.clear();
    }

    /// Frames' records that have come.
    pub fn frames(&self) -> &[FrameRecord] {
        &self.frames
    }

    /// Measurements of all windows in the last whole frame, and its number.
    pub fn measurements(&self) -> Option<(u32, &[Measurement])> {
        let frame = *self.fluxes.frames.last()?;
        let start = self.fluxes.items.len().checked_sub(self.windows)?;
        Some((frame, &self.fluxes.items[start..]))
    }

    /// Whole frames of each stream: frames, slopes, commands, codes, fluxes.
    pub fn counts(&self) -> [usize; 5] {
        let Self { frames, slopes, commands, codes, fluxes, .. } = self;
        [
            frames.len(),
            slopes.frames.len(),
            commands.frames.len(),
            codes.frames.len(),
            fluxes.frames.len(),
        ]
    }

    /// Faults that have come.
    pub fn faults(&self) -> &[FaultRecord] {
        &self.faults
    }

    /// Frames of which a piece is missing.
    pub fn cut(&self) -> u32 {
        self.slopes.cut + self.commands.cut + self.codes.cut + self.fluxes.cut
    }

    /// Writes everything.
    ///
    /// # Errors
    /// [`FitsError`].
    pub fn write(&self, path: &Path, source: &Source<'_>) -> Result<(), FitsError> {
        let header = self.header(source);
        let ulp_m = ulp_m(source.head);
        let adu = source.head.adu_per_unit;
        let mut file = FitsWriter::create(path)?;
        file.image("CONFIG", &[source.image.len()], &header, source.image)?;
        file.table("FRAMES", self.frames.len(), &self.frame_columns(), &header)?;
        let number = |frames: &[u32]| Column::plain("FRAME", whole(frames.iter().copied()));

        let Lists { frames, items, .. } = &self.slopes;
        let tilt = items.iter().flat_map(|slope| slope.tilt_ulp).collect();
        let valid = items.iter().map(|slope| slope.valid).collect();
        let columns = [
            number(frames),
            Column::new("SLOPE", "m", ulp_m, Values::I32(tilt)),
            Column::plain("VALID", Values::Bool(valid)),
        ];
        file.table("SLOPES", frames.len(), &columns, &header)?;

        let Lists { frames, items, .. } = &self.commands;
        let position = |p: &Position| [p.piston_ulp, p.tilt_ulp[0], p.tilt_ulp[1]];
        let positions = Values::I32(items.iter().flat_map(position).collect());
        let columns = [number(frames), Column::new("POSITION", "m", ulp_m, positions)];
        file.table("COMMANDS", frames.len(), &columns, &header)?;

        let Lists { frames, items, .. } = &self.codes;
        let codes = items.as_flattened().iter().map(|&code| i32::from(code)).collect();
        let columns = [number(frames), Column::plain("CODE", Values::I32(codes))];
        file.table("CODES", frames.len(), &columns, &header)?;

        let Lists { frames, items, .. } = &self.fluxes;
        let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
        let centroids = items.iter().flat_map(|m| m.centroid_q16).collect();
        let columns = [
            number(frames),
            Column::new("CENTROID", "pixel", px, Values::I32(centroids)),
            Column::new("FLUX", "adu", adu, whole(items.iter().map(|m| m.flux))),
            Column::new("PEAK", "adu", adu, whole(items.iter().map(|m| m.peak))),
            Column::plain("SATURATED", whole(items.iter().map(|m| m.saturated))),
        ];
        file.table("FLUXES", frames.len(), &columns, &header)?;

        let faults = &self.faults;
        let ticks = faults.iter().map(|record| record.at.ticks.min(i64::MAX as u64) as i64);
        let kinds = faults.iter().map(|record| NAMES[record.fault.kind()].into());
        let details = faults.iter().map(|record| format!("{:?}", record.fault));
        let columns = [
            number(&faults.iter().map(|record| record.at.frame).collect::<Vec<_>>()),
            Column::plain("TICKS", Values::I64(ticks.collect())),
            Column::plain("FAULT", Values::Text(kinds.collect())),
            Column::plain("DETAIL", Values::Text(details.collect())),
        ];
        file.table("FAULTS", faults.len(), &columns, &header)?;
        file.finish()
    }

    fn header(&self, source: &Source<'_>) -> Header {
        let Source { identity, status, head, dropped, .. } = source;
        let dropped = dropped.iter().fold(0u32, |sum, &dropped| sum.saturating_add(dropped));
        Header::new()
            .with("ORIGIN", "host-sim", "SPLASH")
            .with("BOARD", identity.board.as_str(), "board")
            .with("VERSION", identity.version.as_str(), "version of the firmware library")
            .with("BUILD", format!("{:08x}", status.build), "hash of the library's source")
            .with("CONFHASH", format!("{:08x}", status.configuration), "hash of the configuration")
            .with("MIRROR", status.serials.mirror, "serial number of the board's, 0: not stated")
            .with(
                "DETECTOR",
                status.serials.detector,
                "serial number of the board's, 0: not stated",
            )
            .with("CFMIRROR", head.serials.mirror, "serial number the configuration is for, 0: any")
            .with(
                "CFDETECT",
                head.serials.detector,
                "serial number the configuration is for, 0: any",
            )
            .with("NSUB", self.subapertures as i64, "subapertures")
            .with("NWINDOWS", self.windows as i64, "windows: those of a second gate come last")
            .with("ULP", ulp_m(head), "[m] optical path per length ulp")
            .with("TICKS", status.ticks_per_second, "[Hz] ticks of the board's clock")
            .with("DROPPED", dropped, "records that the board dropped")
            .with("CUT", self.cut(), "frames of which a piece is missing")
    }

    fn frame_columns(&self) -> Vec<Column<'static>> {
        let all = &self.frames;
        let numbers = |of: fn(&FrameRecord) -> u32| whole(all.iter().map(of));
        let long = |of: fn(&FrameRecord) -> u64| {
            // Ticks of 1 ns reach 2^63 after three centuries.
            Values::I64(all.iter().map(|frame| of(frame).min(i64::MAX as u64) as i64).collect())
        };
        let words = |of: fn(&FrameRecord) -> String| Values::Text(all.iter().map(of).collect());
        let flags = |of: fn(&FrameRecord) -> bool| Values::Bool(all.iter().map(of).collect());
        let mm = |name, of: fn(&FrameRecord) -> u32| Column::new(name, "m", 1e-3, numbers(of));
        let stages = all.iter().flat_map(|frame| frame.cycles.stages);
        vec![
            Column::plain("FRAME", numbers(|f| f.result.report.frame)),
            Column::plain("TICKS", long(|f| f.result.at.ticks)),
            Column::plain("CONFIG", numbers(|f| f.configuration)),
            Column::plain("MODE", words(|f| f.result.mode.to_string())),
            Column::plain("UPDATED", flags(|f| f.result.report.outcome == Outcome::Updated)),
            Column::plain(
                "HOLD",
                words(|f| match f.result.report.outcome {
                    Outcome::Updated => String::new(),
                    Outcome::Held(hold) => variant(&hold),
                }),
            ),
            Column::plain(
                "RUNG",
                words(|f| f.result.rung.map(|rung| variant(&rung)).unwrap_or_default()),
            ),
            Column::plain(
                "FAULT",
                words(|f| f.result.fault.map_or("", |fault| NAMES[fault.kind()]).into()),
            ),
            mm("ALTITUDE", |f| f.result.gate.range.altitude_mm),
            mm("DEPTH", |f| f.result.gate.range.depth_mm),
            Column::new("ZENITH", "deg", 1e-3, numbers(|f| f.result.gate.range.zenith_mdeg)),
            Column::plain("DELAY", numbers(|f| f.result.gate.delay)),
            Column::plain("WIDTH", numbers(|f| f.result.gate.width)),
            Column::plain("ASKED", numbers(|f| f.result.gate.asked)),
            Column::plain("SEEN", numbers(|f| f.result.gate.seen)),
            Column::plain("VALID", numbers(|f| f.result.report.valid.into())),
            Column::plain("SATPIX", numbers(|f| f.result.report.saturated_pixels)),
            Column::plain("SATACT", numbers(|f| f.result.report.saturated_actuators.into())),
            Column::plain("SLEWED", numbers(|f| f.result.report.slewed_actuators.into())),
            Column::plain("RESIDUAL", long(|f| f.result.report.residual_squared)),
            Column::plain("TILT2", long(|f| f.tilt_squared_ulp2)),
            Column::plain("CYC_ROWS", numbers(|f| f.cycles.rows)),
            Column::plain("CYC_STAG", whole(stages)),
            Column::plain("LATENCY", numbers(|f| f.cycles.latency)),
        ]
    }
}

/// Unsigned numbers, which a table has no native form of.
fn whole<T: Into<i64>>(numbers: impl Iterator<Item = T>) -> Values {
    Values::I64(numbers.map(Into::into).collect())
}

/// The name of a variant.
pub(crate) fn variant(value: &impl std::fmt::Debug) -> String {
    let text = format!("{value:?}");
    text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().into()
}
