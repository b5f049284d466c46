//! Slope calibration: what an instrument's team measures with a flat mirror and with pokes.
//!
//! The centroid of a real estimator moves by less than the spot: the window cuts the wings and the
//! threshold what is faint. So, through the firmware's own centroids and without turbulence or
//! noise: reference slopes are the centroids of the flat mirror; the 2 x 2 gain of a subaperture
//! is the inverse of how far its centroid moves when its segment tilts.

use crate::atmosphere::Atmosphere;
use crate::board::{Frame, in_process};
use crate::detector::place;
use crate::error::Error;
use crate::instrument::Instrument;
use crate::optics::splash_image::SplashCamera;
use crate::pupil::{Mirror, Pupil};
use crate::reconstructor::Reconstructor;
use splash_firmware::fixed::CENTROID_BITS;

/// How far a poke moves a spot, pixels: well within the linear range of a spot two pixels wide.
const POKE_PX: f64 = 0.25;

/// Reference slopes and gains, one a subaperture in mask order.
#[derive(Clone, Debug, PartialEq)]
pub struct SlopeCalibration {
    /// Centroid of the flat wavefront from the window's centre, pixels.
    pub reference_px: Vec<[f64; 2]>,
    /// Centre-to-edge optical path per pixel of centroid, m: rows tip and tilt, columns x and y.
    pub gain_m_per_px: Vec<[[f64; 2]; 2]>,
}

impl SlopeCalibration {
    /// That of a sensor which measures mean gradients: a pixel is lambda / (p d) on the sky, and
    /// half a subaperture turns it into a path of lambda / (2 p).
    pub fn ideal(instrument: &Instrument, subapertures: usize) -> Self {
        let path = path_m_per_px(instrument);
        Self {
            reference_px: vec![[0.0; 2]; subapertures],
            gain_m_per_px: vec![[[path, 0.0], [0.0, path]]; subapertures],
        }
    }

    /// Measures it.
    ///
    /// # Errors
    /// [`Error::Config`] for an instrument that the optics or the firmware refuse, or whose spots
    /// do not follow their segments: too faint, or windows too small.
    pub fn measure(instrument: &Instrument) -> Result<Self, Error> {
        let mut bench = Bench::new(instrument)?;
        let path = path_m_per_px(instrument);
        let poke_rad = POKE_PX * path * instrument.rad_per_m();
        let subapertures = bench.pupil.subapertures().to_vec();
        let sign = |[x, y]: [usize; 2]| if (x + y) % 2 == 0 { 1.0 } else { -1.0 };
        // SPLASH does not see the mean of the pokes.
        let mean =
            subapertures.iter().map(|&cell| sign(cell)).sum::<f64>() / subapertures.len() as f64;
        let reference_px = bench.centroids([0.0; 2], sign)?;
        let mut columns = Vec::new();
        for poke in [[poke_rad, 0.0], [0.0, poke_rad]] {
            let plus = bench.centroids(poke, sign)?;
            let minus = bench.centroids(poke.map(|p| -p), sign)?;
            columns.push((plus, minus));
        }
        let mut gain_m_per_px = Vec::with_capacity(subapertures.len());
        for (i, &cell) in subapertures.iter().enumerate() {
            let moved = 2.0 * POKE_PX * (sign(cell) - mean);
            let response = |axis: usize, (plus, minus): &(Vec<[f64; 2]>, Vec<[f64; 2]>)| {
                (plus[i][axis] - minus[i][axis]) / moved
            };
            let [a, b] = [response(0, &columns[0]), response(0, &columns[1])];
            let [c, d] = [response(1, &columns[0]), response(1, &columns[1])];
            let determinant = a * d - b * c;
            // A spot that moves by less than a third of its segment's tilt is no measurement.
            if !(determinant.abs() > 0.1 && a.is_finite() && d.is_finite()) {
                return Err(Error::Config(format!(
                    "calibration of subaperture {i}: determinant of the spot's response to its \
                     segment = {determinant}: must be above 0.1; check windows.size and \
                     laser.electrons_per_spot"
                )));
            }
            let scale = path / determinant;
            gain_m_per_px.push([[d * scale, -b * scale], [-c * scale, a * scale]]);
        }
        Ok(Self { reference_px, gain_m_per_px })
    }
}

/// Centre-to-edge optical path of a tilt that moves a spot by one pixel, m.
fn path_m_per_px(instrument: &Instrument) -> f64 {
    instrument.laser.wavelength_m / (2.0 * instrument.windows.pixels_per_lambda_d)
}

/// The instrument under an empty sky, without noise.
struct Bench {
    pupil: Pupil,
    sky: Atmosphere,
    camera: SplashCamera,
    reconstructor: Reconstructor,
    flux_e: f32,
}

impl Bench {
    fn new(instrument: &Instrument) -> Result<Self, Error> {
        let pupil = instrument.pupil()?;
        let sky = Atmosphere::from_screens(Vec::new(), pupil.diameter_m(), 0.0)?;
        let (scale, size) = (instrument.windows.pixels_per_lambda_d, instrument.windows.size);
        let height_m = instrument.laser.beacon_height_m;
        let camera = SplashCamera::new(&pupil, &sky, height_m, scale, size)?;
        let flux_e = instrument.laser.electrons_per_spot as f32;
        Ok(Self { pupil, sky, camera, reconstructor: Reconstructor::new(instrument)?, flux_e })
    }

    /// The centroids when every segment adds its `sign` times these tilts to the wavefront: a
    /// mirror's shape is taken off it.
    fn centroids(
        &mut self,
        [tip, tilt]: [f64; 2],
        sign: impl Fn([usize; 2]) -> f64,
    ) -> Result<Vec<[f64; 2]>, Error> {
        let cells = self.pupil.subapertures();
        let poke = |&cell: &[usize; 2]| [0.0, -sign(cell) * tip, -sign(cell) * tilt];
        let mirror = Mirror { segments: cells.iter().map(poke).collect() };
        let window = self.camera.window();
        let mut images = vec![0.0; self.camera.spots() * window * window];
        self.camera.expose(&self.sky, 0.0, &mirror, &mut images);
        let detector = self.reconstructor.detector();
        let (width, height) = (detector.spec().width, detector.spec().height);
        let mut expected = vec![0.0; width * height];
        let origins: Vec<_> =
            self.reconstructor.origins().iter().map(|o| o.map(usize::from)).collect();
        place(&images, self.flux_e, &origins, window, width, &mut expected)?;
        let mut pixels = vec![0; width * height];
        detector.read_noise_free(&expected, &mut pixels)?;
        let mut board = in_process(&self.reconstructor.spec())?;
        // The moving threshold and the weight follow the frame before.
        for frame in 0..3 {
            board.frame(frame, Frame::Pixels(&pixels))?;
        }
        let px = 1.0 / f64::from(1u32 << CENTROID_BITS);
        let centroid = |q16: [i32; 2]| q16.map(|c| f64::from(c) * px);
        Ok(board.measurements().iter().map(|m| centroid(m.centroid_q16)).collect())
    }
}
