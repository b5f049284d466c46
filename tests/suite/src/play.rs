//! Cases that go through the pipeline: frames of rows, or of measurements made elsewhere, and what
//! may go wrong on the way.

use splash_firmware::centroid::Measurement;
use splash_firmware::config::Config;
use splash_firmware::pipeline::{GlobalTilt, Pipeline};

use crate::generator::Generator;
use crate::instrument::Instrument;
use crate::maps::{Maps, PLACES};
use crate::scene::{Light, Scene};
use crate::stages::{Stage, Stages};

/// Number of a case's first frame: the third is number 0.
const FIRST: u32 = u32::MAX - 1;

/// What a frame is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Input {
    /// Rows of this light.
    Rows(Light),
    /// Centroids anywhere within this, Q16 pixels, of the window's centre, flux in range; one
    /// subaperture in so many, others every second frame, without flux; 0 for none.
    Centroids(i32, u32),
    /// Measurements at the edges of their types.
    Edges,
}

/// What is done to one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// Nothing.
    None,
    /// Its last rows do not come.
    Cut,
    /// Its second row, or its list, lacks an entry.
    Wrong,
    /// Two rows, or a second list, come after the last.
    Extra,
    /// It begins again after its third row, or after its list.
    Restart,
    /// It never begins.
    NotBegun,
    /// All of it is dark.
    Dark,
    /// This global tilt comes before it, ulp.
    Tilt([i32; 2]),
    /// The loop is opened before it.
    Reset,
}

/// A case: frames and what is done to the first of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) input: Input,
    pub(crate) frames: u32,
    pub(crate) events: &'static [Event],
    /// The stages it is about.
    pub(crate) shown: &'static [Stage],
}

/// Where frames come from.
#[derive(Debug)]
pub(crate) struct Source {
    scene: Scene,
    measurements: [Measurement; PLACES],
}

impl Source {
    pub(crate) const fn new() -> Self {
        const BLANK: Measurement =
            Measurement { centroid_q16: [0; 2], flux: 0, peak: 0, saturated: 0 };
        Self { scene: Scene::new(), measurements: [BLANK; PLACES] }
    }
}

/// Runs a case from the flat mirror.
pub(crate) fn play<const M: usize, const P: usize, const B: usize, const K: usize>(
    case: &Case,
    instrument: &Instrument,
    maps: &Maps,
    config: &Config<M, P, B, K>,
    pipeline: &mut Pipeline<M, B, K>,
    source: &mut Source,
) -> Stages {
    let numbers = &mut Generator::new(seed(instrument.name, case.name));
    let mut stages = Stages::default();
    pipeline.reset(config);
    for k in 0..case.frames {
        let event = case.events.get(k as usize).copied().unwrap_or(Event::None);
        let number = FIRST.wrapping_add(k);
        match event {
            Event::Tilt(tilt_ulp) => {
                pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame: number });
            }
            Event::Reset => pipeline.reset(config),
            _ => (),
        }
        if event != Event::NotBegun {
            pipeline.begin(config, number);
        }
        let mut frame = Frame { instrument, maps, config, pipeline, stages: &mut stages, event };
        match case.input {
            Input::Rows(light) => frame.rows(light, k, &mut source.scene, numbers),
            input => frame.measured(input, k, &mut source.measurements, numbers),
        }
        let report = pipeline.finish(config);
        stages.frame(pipeline, &report);
    }
    stages
}

/// From the names, so that a new case changes no other.
fn seed(instrument: &str, case: &str) -> u32 {
    let bytes = instrument.bytes().chain(case.bytes());
    bytes.fold(0, |seed, byte| seed.wrapping_mul(31).wrapping_add(byte.into()))
}

/// One frame on its way in.
struct Frame<'a, const M: usize, const P: usize, const B: usize, const K: usize> {
    instrument: &'a Instrument,
    maps: &'a Maps,
    config: &'a Config<M, P, B, K>,
    pipeline: &'a mut Pipeline<M, B, K>,
    stages: &'a mut Stages,
    event: Event,
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Frame<'_, M, P, B, K> {
    fn rows(&mut self, light: Light, k: u32, scene: &mut Scene, numbers: &mut Generator) {
        let light = if self.event == Event::Dark { Light::Level(0) } else { light };
        let height = self.config.height();
        let rows = match self.event {
            Event::Cut => height - 3,
            Event::Extra => height + 2,
            _ => height,
        };
        scene.begin(self.instrument, light, (k, self.config.windows()), numbers);
        if self.event == Event::Restart {
            for y in 0..3 {
                let row = scene.row(self.instrument, self.maps.origins(), light, y, numbers);
                self.stages.pushed(self.pipeline.push_row(self.config, row));
            }
            self.pipeline.begin(self.config, FIRST.wrapping_add(k));
        }
        for y in 0..rows {
            let row = scene.row(self.instrument, self.maps.origins(), light, y, numbers);
            let short = usize::from(self.event == Event::Wrong && y == 1);
            let row = row.get(short..).unwrap_or_default();
            self.stages.pushed(self.pipeline.push_row(self.config, row));
        }
    }

    fn measured(
        &mut self,
        input: Input,
        k: u32,
        measurements: &mut [Measurement],
        numbers: &mut Generator,
    ) {
        let count = self.config.windows() - usize::from(self.event == Event::Wrong);
        let list = measurements.get_mut(..count).unwrap_or_default();
        for (i, measurement) in (0u32..).zip(&mut *list) {
            *measurement = match input {
                Input::Centroids(wander_q16, dead) => {
                    let dead = dead > 0 && i % dead == (k / 2) % dead;
                    let lit = u32::from(!dead && self.event != Event::Dark);
                    Measurement {
                        centroid_q16: [(); 2].map(|()| numbers.between(-wander_q16, wander_q16)),
                        flux: lit * (1000 + numbers.below(10_000)),
                        peak: numbers.below(4096) as u16,
                        saturated: 0,
                    }
                }
                _ => edge(self.instrument, numbers),
            };
        }
        if self.event == Event::Cut {
            return;
        }
        let mut push = || self.pipeline.push_measurements(self.config, list);
        self.stages.pushed(push());
        match self.event {
            Event::Extra => self.stages.pushed(push()),
            Event::Restart => {
                self.pipeline.begin(self.config, FIRST.wrapping_add(k));
                self.stages.pushed(self.pipeline.push_measurements(self.config, list));
            }
            _ => (),
        }
    }
}

/// A measurement at the edges of its types and of the flux limits.
fn edge(instrument: &Instrument, numbers: &mut Generator) -> Measurement {
    let [least, most] = instrument.flux_adu.map(|adu| adu as u32);
    let fluxes = [0, 1, least - 1, least, least + 1, most, most + 1, u32::MAX];
    let [top, bottom] = [i32::MAX, i32::MIN].map(|limit| limit as u32);
    let centroids = [0, 1, u32::MAX, 1 << 16, 32 << 16, top, bottom];
    Measurement {
        centroid_q16: [(); 2].map(|()| numbers.edge(&centroids) as i32),
        flux: numbers.edge(&fluxes),
        peak: numbers.edge(&[0, 1, 65534, 65535]) as u16,
        saturated: numbers.edge(&[0, 1, 65535]) as u16,
    }
}
