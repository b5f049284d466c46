//! What a run was asked for, beside its screens on the disk: whoever joins the parts of a run has to know that
//! they are of one.

use super::comparator::Comparator;
use super::point::{Conditions, Point};
use super::shard::Shard;
use crate::closed_loop::Sensing;
use crate::error::Error;
use crate::instrument::Instrument;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The file in a run's directory.
pub const NAME: &str = "settings.toml";
/// What may differ from part to part.
const OF_A_PART: &str = "shard";

/// Everything on which a run's results depend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    version: String,
    /// Which part of the run; all of it without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shard: Option<String>,
    /// By increasing N, each once.
    n: Vec<usize>,
    screens: u32,
    sensors: Vec<String>,
    budget: bool,
    sensing: String,
    noise_free: bool,
    settle: u32,
    frames: u32,
    /// A text: it may be larger than any whole number of TOML.
    seed: String,
    instrument: Instrument,
}

impl Settings {
    /// Those of a run of `sensors` under `screens` screens for each of `n`, subapertures across.
    pub fn new(
        instrument: Instrument,
        mut n: Vec<usize>,
        screens: u32,
        sensors: &[Comparator],
        budget: bool,
        conditions: Conditions,
    ) -> Self {
        n.sort_unstable();
        n.dedup();
        let Conditions { sensing, noise_free, settle, frames, seed } = conditions;
        let asked = Comparator::ALL.into_iter().filter(|known| sensors.contains(known));
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            shard: None,
            n,
            screens,
            sensors: asked.map(|sensor| sensor.name().into()).collect(),
            budget,
            sensing: sensing.name().into(),
            noise_free,
            settle,
            frames,
            seed: seed.to_string(),
            instrument,
        }
    }

    /// Those of a part of the run.
    #[must_use]
    pub fn of_shard(self, shard: Option<Shard>) -> Self {
        Self { shard: shard.map(|shard| shard.to_string()), ..self }
    }

    /// Screens for each N.
    pub fn screens(&self) -> u32 {
        self.screens
    }

    /// With the steps of the error budget.
    pub fn budget(&self) -> bool {
        self.budget
    }

    /// What is compared.
    ///
    /// # Errors
    /// [`Error::Config`] for a name that is none.
    pub fn sensors(&self) -> Result<Vec<Comparator>, Error> {
        let named = |name: &String| {
            Comparator::named(name).ok_or_else(|| Error::Config(format!("sensors: {name:?}")))
        };
        self.sensors.iter().map(named).collect()
    }

    /// What all screens have in common.
    ///
    /// # Errors
    /// [`Error::Config`] for a sensing or a seed that is none.
    pub fn conditions(&self) -> Result<Conditions, Error> {
        let seed = self.seed.parse();
        Ok(Conditions {
            sensing: Sensing::named(&self.sensing)
                .ok_or_else(|| Error::Config(format!("sensing: {:?}", self.sensing)))?,
            noise_free: self.noise_free,
            settle: self.settle,
            frames: self.frames,
            seed: seed.map_err(|error| Error::Config(format!("seed {:?}: {error}", self.seed)))?,
        })
    }

    /// The points by increasing N.
    ///
    /// # Errors
    /// [`Error::Config`] with field, value and limit.
    pub fn points(&self) -> Result<Vec<Point>, Error> {
        let conditions = self.conditions()?;
        self.n.iter().map(|&n| Point::new(&self.instrument, n, conditions)).collect()
    }

    /// Writes [`NAME`] into `directory`, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Run`] if it cannot be written.
    pub fn write(&self, directory: &Path) -> Result<(), Error> {
        let text = toml::to_string(self).map_err(|error| Error::Run(error.to_string()))?;
        let (path, new) = (directory.join(NAME), directory.join(format!("{NAME}.new")));
        std::fs::write(&new, text)
            .and_then(|()| std::fs::rename(&new, &path))
            .map_err(|error| Error::Run(format!("{}: {error}", path.display())))
    }

    /// Those of all the runs in `directories`, of which there is at least one.
    ///
    /// # Errors
    /// [`Error::Config`] if one has none, or names the first setting in which two differ.
    pub fn common<P: AsRef<Path>>(directories: &[P]) -> Result<Self, Error> {
        let mut first: Option<(&Path, Flat)> = None;
        for directory in directories {
            let directory = directory.as_ref();
            let found = flat(directory)?;
            match &first {
                None => first = Some((directory, found)),
                Some((other, expected)) => compare(other, expected, directory, &found)?,
            }
        }
        let Some((directory, _)) = first else {
            return Err(Error::Config("no directory to take settings from".into()));
        };
        let text = text(directory)?;
        let wrong = |error| Error::Config(format!("{}: {error}", directory.join(NAME).display()));
        let settings: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        let ours = env!("CARGO_PKG_VERSION");
        if settings.version != ours {
            return Err(wrong(format!(
                "version = {}: must be this program's, {ours}",
                settings.version
            )));
        }
        Ok(settings.of_shard(None))
    }
}

/// Values by their dotted names.
type Flat = BTreeMap<String, String>;

fn text(directory: &Path) -> Result<String, Error> {
    std::fs::read_to_string(directory.join(NAME)).map_err(|error| {
        let file = directory.join(NAME);
        Error::Config(format!("{}: {error}: no directory of host-sim strehl", file.display()))
    })
}

fn flat(directory: &Path) -> Result<Flat, Error> {
    let table: toml::Table = text(directory)?.parse().map_err(|error: toml::de::Error| {
        let file = directory.join(NAME);
        Error::Config(format!("{}: {}", file.display(), error.message().replace('\n', " ")))
    })?;
    let mut flat = Flat::new();
    flatten("", &toml::Value::Table(table), &mut flat);
    flat.remove(OF_A_PART);
    Ok(flat)
}

fn flatten(name: &str, value: &toml::Value, into: &mut Flat) {
    let inside = |key: &str| if name.is_empty() { key.into() } else { format!("{name}.{key}") };
    match value {
        toml::Value::Table(table) => {
            table.iter().for_each(|(key, value)| flatten(&inside(key), value, into));
        }
        toml::Value::Array(values) if values.iter().any(toml::Value::is_table) => {
            let numbered = values.iter().enumerate();
            numbered.for_each(|(k, value)| flatten(&format!("{name}[{k}]"), value, into));
        }
        value => {
            into.insert(name.to_string(), value.to_string());
        }
    }
}

/// Refuses the first setting by name that is not the same in both.
fn compare(a: &Path, of_a: &Flat, b: &Path, of_b: &Flat) -> Result<(), Error> {
    let mut names: Vec<&String> = of_a.keys().chain(of_b.keys()).collect();
    names.sort_unstable();
    let Some(name) = names.into_iter().find(|&name| of_a.get(name) != of_b.get(name)) else {
        return Ok(());
    };
    let value = |of: &Flat| of.get(name).cloned().unwrap_or_else(|| "not there".into());
    Err(Error::Config(format!(
        "{name} is {} in {} and {} in {}: these are not parts of one run",
        value(of_a),
        a.display(),
        value(of_b),
        b.display()
    )))
}
