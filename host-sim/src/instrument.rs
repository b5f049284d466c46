//! The instrument description: a TOML file, laid over the default one.
//!
//! [`DEFAULT_TOML`] is both the documentation of every field and its default: a user's file is
//! merged over it, table by table, and unknown names are refused. [`Instrument::check`] says which
//! values are out of their limits.

mod beacon;
mod limits;
mod schedule;
mod second_gate;
mod sections;
mod windows;

use crate::atmosphere::Layer;
use crate::cn2::{self, Profile};
use crate::error::{Error, refuse};
use crate::optics::geometric::Sensor;
use crate::pupil::{Obstruction, Pupil};
use crate::theory;
use crate::theory::lever_arm::{self, Beacon};
use limits::{MAX_PROFILE_LAYERS, within};
pub use schedule::{Colours, Lattice, LatticeName, PowerName, ScheduleSection};
use sections::LAYERS;
pub use sections::{
    AtmosphereSection, Centroids, ControlSection, DetectorSection, EstimatorName, ExpectedLayer,
    GateSection, Laser, LaunchName, LayerSection, LeverArm, LeverArmName, MirrorSection,
    PhotonNumberName, PhotonsSection, PupilName, PupilShape, ResponseName, SafetySection,
    ScattererName, ScienceSection, SecondGate, SerialsSection, ShortFrameName, Telescope,
    ThresholdName,
};
use serde::{Deserialize, Serialize};
use splash_firmware::centroid::MAX_WINDOW;
use splash_firmware::geometry::Mask;
use std::path::Path;
pub use windows::{LayoutName, Windows};

/// The default instrument, with a comment for every field.
pub const DEFAULT_TOML: &str = include_str!("default.toml");

/// An instrument. Fields are documented in [`DEFAULT_TOML`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "documented once, in the default file that users read")]
pub struct Instrument {
    pub telescope: Telescope,
    pub atmosphere: AtmosphereSection,
    pub laser: Laser,
    pub second_gate: SecondGate,
    pub photons: PhotonsSection,
    pub science: ScienceSection,
    pub detector: DetectorSection,
    pub windows: Windows,
    pub centroids: Centroids,
    pub control: ControlSection,
    pub mirror: MirrorSection,
    pub schedule: ScheduleSection,
    pub gate: GateSection,
    pub safety: SafetySection,
    pub serials: SerialsSection,
}

/// Part of the peak that is a spot's threshold where there is no noise.
const NOISE_FREE_PEAK_FRACTION: f64 = 0.005;

/// Side of a window that holds a whole spot, lambda/d: what is beyond it costs the Strehl ratio less than 0.003
/// at D/r0 = 8 (8 lambda/d cost up to 0.007, 16 less than 0.001 at four times the work).
const WHOLE_SPOT_LAMBDA_D: f64 = 12.0;

impl Instrument {
    /// The default instrument.
    ///
    /// # Errors
    /// None in practice: a test reads the default.
    pub fn standard() -> Result<Self, Error> {
        Self::parse("", "default")
    }

    /// The instrument described in `file`, laid over the default.
    ///
    /// # Errors
    /// [`Error::Config`] if the file cannot be read, is not TOML, or has a field that is unknown
    /// or of the wrong type.
    pub fn load(file: &Path) -> Result<Self, Error> {
        let name = file.display().to_string();
        let text = std::fs::read_to_string(file)
            .map_err(|source| Error::Config(format!("{name}: {source}")))?;
        Self::parse_in(&text, &name, file.parent())
    }

    /// The instrument described in `file`, or the default one.
    ///
    /// # Errors
    /// As [`Instrument::load`].
    pub fn described(file: Option<&Path>) -> Result<Self, Error> {
        file.map_or_else(Self::standard, Self::load)
    }

    /// The instrument in a TOML text that is called `name` in errors.
    ///
    /// # Errors
    /// As [`Instrument::load`].
    pub fn parse(text: &str, name: &str) -> Result<Self, Error> {
        Self::parse_in(text, name, None)
    }

    /// The same, where a profile's file is looked for in `directory`.
    fn parse_in(text: &str, name: &str, directory: Option<&Path>) -> Result<Self, Error> {
        let mut merged = table(DEFAULT_TOML, "default")?;
        let given = table(text, name)?;
        let own = given.get("atmosphere").is_some_and(|section| section.get("layers").is_some());
        lay_over(&mut merged, given);
        let mut instrument: Self = merged
            .try_into()
            .map_err(|error| Error::Config(format!("{name}: {}", in_words(&error))))?;
        if instrument.atmosphere.profile != LAYERS {
            if own {
                let profile = &instrument.atmosphere.profile;
                return Err(refuse(
                    "atmosphere.profile",
                    profile,
                    "without atmosphere.layers beside it",
                ));
            }
            instrument.take_profile(directory)?;
        }
        Ok(instrument)
    }

    /// Puts a profile's layers in place of the others.
    fn take_profile(&mut self, directory: Option<&Path>) -> Result<(), Error> {
        let AtmosphereSection { profile, profile_layers, .. } = &self.atmosphere;
        within("atmosphere.profile_layers", *profile_layers as f64, 0.0, MAX_PROFILE_LAYERS)?;
        let (layers, count) = match Profile::named(profile) {
            Some(named) => (named.layers(self.laser.beacon_height_m), named.default_count()),
            None if profile.ends_with(".csv") => {
                let path = directory.unwrap_or_else(|| Path::new("")).join(profile);
                (cn2::read(&path)?, 0)
            }
            None => {
                let names = Profile::ALL.map(Profile::name).join(", ");
                let limit = format!("{LAYERS}, {names}, or the name of a file that ends in .csv");
                return Err(refuse("atmosphere.profile", profile, &limit));
            }
        };
        let count = if *profile_layers > 0 { *profile_layers } else { count };
        let section = |l: &Layer| LayerSection {
            weight: l.weight,
            height_m: l.height_m,
            wind_speed_m_per_s: l.wind_speed_m_per_s,
            wind_direction_deg: l.wind_direction_deg,
        };
        // Values that no layer may have are kept as they are, to be refused by name.
        let strange = |l: &Layer| !(l.weight >= 0.0 && l.height_m >= 0.0);
        let layers = if layers.iter().any(strange) { layers } else { cn2::reduced(&layers, count) };
        self.atmosphere = AtmosphereSection {
            layers: layers.iter().map(section).collect(),
            profile: LAYERS.into(),
            profile_layers: 0,
            ..self.atmosphere
        };
        Ok(())
    }

    /// The same instrument with a detector that adds nothing: no read noise, no dark charge, and
    /// 16 bits over the same range, so that rounding to codes is no noise either. A threshold against noise
    /// only cuts the spots' wings: `peak_fraction` is at most 0.005.
    #[must_use]
    pub fn noise_free(mut self) -> Self {
        let scale = 2f64.powi(16 - self.detector.bits.clamp(8, 16) as i32);
        let detector = &mut self.detector;
        detector.bits = detector.bits.max(16);
        detector.gain_e_per_adu /= scale;
        detector.bias_adu *= scale;
        detector.read_noise_e = 0.0;
        detector.dark_e_per_frame = 0.0;
        let fraction = &mut self.centroids.peak_fraction;
        *fraction = fraction.min(NOISE_FREE_PEAK_FRACTION);
        self
    }

    /// The same instrument with windows of at least 12 lambda/d, as far as 32 pixels reach, the optical samples
    /// that such a field takes, and no threshold relative to a spot's peak: centroids are those of whole
    /// spots, speckled wings and all. A window of the description's that is larger stays.
    #[must_use]
    pub fn with_whole_spots(mut self) -> Self {
        let windows = &mut self.windows;
        let wanted = (WHOLE_SPOT_LAMBDA_D * windows.pixels_per_lambda_d).ceil() as usize;
        windows.size = windows.size.max(wanted.min(MAX_WINDOW));
        windows.spacing_px = windows.spacing_px.max(windows.size);
        let field = (windows.size as f64 / windows.pixels_per_lambda_d).ceil() as usize;
        self.telescope.samples = self.telescope.samples.max(field);
        self.centroids.peak_fraction = 0.0;
        self
    }

    /// The description as TOML, complete.
    ///
    /// # Errors
    /// [`Error::Run`] if it cannot be written, which no instrument does.
    pub fn to_toml(&self) -> Result<String, Error> {
        toml::to_string(self).map_err(|error| Error::Run(error.to_string()))
    }

    /// The mask of subapertures.
    ///
    /// # Errors
    /// [`Error::Config`] if the pupil cannot be.
    pub fn mask(&self) -> Result<Mask, Error> {
        let Telescope { subapertures: across, pupil, obstruction, spider, .. } = &self.telescope;
        let mask = match pupil {
            PupilShape::Named(PupilName::Circle) => Mask::circle(*across)?,
            PupilShape::Named(PupilName::Square) => Mask::square(*across)?,
            PupilShape::Named(PupilName::Annulus) => Mask::annulus(*across, *obstruction)?,
            PupilShape::Rows(rows) => {
                let cell = |x: usize, y: usize| rows[y].as_bytes()[x] == b'#';
                limits::check_drawing("telescope.pupil", rows, *across)?;
                let strange = |row: &&String| row.bytes().any(|cell| cell != b'#' && cell != b'.');
                if let Some(row) = rows.iter().find(strange) {
                    return Err(refuse("telescope.pupil", format!("{row:?}"), "'#' and '.' only"));
                }
                Mask::from_fn(*across, cell)?
            }
        };
        let mask = if *spider { mask.with_spider() } else { mask };
        if mask.count() == 0 {
            return Err(refuse("telescope.pupil", 0, "at least one subaperture"));
        }
        Ok(mask)
    }

    /// The pupil that the optics sample.
    ///
    /// # Errors
    /// [`Error::Config`] if a value is out of its range.
    pub fn pupil(&self) -> Result<Pupil, Error> {
        let (mask, across) = (self.mask()?, self.telescope.subapertures);
        let cells = (0..across * across).map(|i| mask.contains(i % across, i / across)).collect();
        let telescope = &self.telescope;
        self.obstructed(Pupil::new(across, telescope.samples, telescope.pitch_m, cells)?)
    }

    /// The same pupil with what stands in its light.
    ///
    /// # Errors
    /// [`Error::Config`] if no light is left.
    pub fn obstructed(&self, pupil: Pupil) -> Result<Pupil, Error> {
        let telescope = &self.telescope;
        if telescope.disc_m == 0.0 && telescope.vane_width_m == 0.0 {
            return Ok(pupil);
        }
        Ok(pupil.with_obstruction(&Obstruction {
            disc_m: telescope.disc_m,
            vane_width_m: telescope.vane_width_m,
            vanes: telescope.vanes,
            vane_angle_rad: telescope.vane_angle_deg.to_radians(),
        })?)
    }

    /// The turbulent layers.
    pub fn layers(&self) -> Vec<Layer> {
        let layer = |l: &LayerSection| Layer {
            weight: l.weight,
            height_m: l.height_m,
            wind_speed_m_per_s: l.wind_speed_m_per_s,
            wind_direction_deg: l.wind_direction_deg,
        };
        self.atmosphere.layers.iter().map(layer).collect()
    }

    /// The control law's factor f for `sensor`: the description's, or the one that it names; a star has no lever
    /// arm, and one by name is 1 for it.
    ///
    /// # Errors
    /// [`Error::Config`] if it cannot be found from the layers, or is out of its limits.
    pub fn lever_arm(&self, sensor: Sensor) -> Result<f64, Error> {
        let name = match self.control.lever_arm {
            LeverArm::Factor(factor) => return Ok(factor),
            LeverArm::Named(name) => name,
        };
        let beacon = match sensor {
            Sensor::Splash => Beacon::Splash,
            Sensor::Lgs => Beacon::Lgs,
            Sensor::Ngs => return Ok(1.0),
        };
        let height_m = self.laser.beacon_height_m;
        let layer =
            |l: &Layer| theory::Layer { weight: l.weight, beta: 1.0 - l.height_m / height_m };
        let layers: Vec<theory::Layer> =
            self.layers().iter().map(layer).filter(|layer| layer.weight > 0.0).collect();
        if let Some(low) = layers.iter().find(|layer| !theory::BETAS.contains(&layer.beta)) {
            let limit = format!(
                "a number where turbulence is beyond 0.9 of the beacon's height: a layer is at {:.3}",
                1.0 - low.beta
            );
            return Err(refuse("control.lever_arm", self.control.lever_arm, &limit));
        }
        let factor = match name {
            LeverArmName::Profile => lever_arm::alone(&layers),
            LeverArmName::Best => lever_arm::least_variance(&layers, beacon),
        };
        limits::check_lever_arm(factor)?;
        Ok(factor)
    }

    /// The same instrument with the factor for `sensor` in place of a name.
    ///
    /// # Errors
    /// As [`Instrument::lever_arm`].
    pub fn with_lever_arm_of(mut self, sensor: Sensor) -> Result<Self, Error> {
        self.control.lever_arm = LeverArm::Factor(self.lever_arm(sensor)?);
        Ok(self)
    }

    /// The same instrument with another sensor: a guide star lights all subapertures at once, each of which
    /// makes its own image, so nothing of its images is interleaved or laid out as on the sky; and its light comes
    /// from one height.
    #[must_use]
    pub fn seen_by(mut self, sensor: Sensor) -> Self {
        if sensor != Sensor::Splash {
            self.schedule = ScheduleSection::none();
            self.windows = self.windows.relayed();
            self.second_gate.height_m = 0.0;
        }
        self
    }

    /// The same instrument, for what has one gate.
    ///
    /// # Errors
    /// [`Error::Config`] if it has a second one.
    pub fn of_one_gate(self) -> Result<Self, Error> {
        match self.has_second_gate() {
            false => Ok(self),
            true => {
                let limit = "0 here; two gates are for host-sim gates, loop, frames, replay, link and strehl by images";
                Err(refuse("second_gate.height_m", self.second_gate.height_m, limit))
            }
        }
    }

    /// Time from one frame to the next, s.
    pub fn frame_s(&self) -> f64 {
        f64::from(self.laser.pulses_per_frame) / self.laser.pulse_rate_hz
    }

    /// Phase at the laser's wavelength per metre of optical path, rad/m.
    pub fn rad_per_m(&self) -> f64 {
        std::f64::consts::TAU / self.laser.wavelength_m
    }
}

/// Lays `over` on `base`: tables are merged, anything else is replaced.
fn lay_over(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => lay_over(base, over),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// What is wrong with which field, on one line and without the names of Rust's types.
fn in_words(error: &toml::de::Error) -> String {
    let words = [
        ("usize", "a whole number, 0 or more"),
        ("u32", "a whole number from 0 to 4294967295"),
        ("u16", "a whole number from 0 to 65535"),
        ("u8", "a whole number from 0 to 255"),
        ("f64", "a number"),
        ("struct ", "the table "),
    ];
    // The error is a message, a line break and the field.
    let line = error.to_string().trim().replace('\n', " ");
    words.iter().fold(line, |line, (rust, plain)| {
        line.replace(&format!("expected {rust}"), &format!("expected {plain}"))
    })
}

/// The table that a TOML text is; an error says in which line it is not.
fn table(text: &str, name: &str) -> Result<toml::Table, Error> {
    text.parse().map_err(|error: toml::de::Error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        let message = error.message().replace('\n', " ");
        Error::Config(format!("{name}: line {line}: {message}"))
    })
}
