//! What is on the detector, row by row, from integers.

use crate::generator::Generator;
use crate::instrument::Instrument;
use crate::maps::PLACES;

/// Widest row, pixels.
const ROW: usize = 160;

/// What lights the detector.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Light {
    /// A spot in each window, over the dark level.
    Spots(Spots),
    /// Every pixel at an edge of the arithmetic or anywhere in its range.
    Edges,
    /// Every pixel has this value.
    Level(u16),
}

/// Spots with the profile of a squared triangle in each direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spots {
    /// Brightest signal, 1/256 of the detector's range, up to 512; each spot has from a half of it
    /// to all.
    pub(crate) peak: u32,
    /// Half of a spot's base, as a power of two of pixels; 0 to 4.
    pub(crate) radius: u32,
    /// Farthest centre from the window's, in both directions, pixels in Q8.
    pub(crate) wander_q8: i32,
    /// 1.73 times the noise's rms, ADU.
    pub(crate) noise_adu: i32,
    /// One window in so many is dark, others every second frame; 0 for none.
    pub(crate) dead: u32,
}

/// One spot of the frame.
#[derive(Clone, Copy, Debug)]
struct Spot {
    centre_q8: [i32; 2],
    peak_adu: u32,
}

/// A row, at a word's address as boards have it: packed kernels take no other.
#[derive(Debug)]
#[repr(align(4))]
struct Row([u16; ROW]);

/// The detector of one frame after the other.
#[derive(Debug)]
pub(crate) struct Scene {
    spots: [Spot; PLACES],
    row: Row,
}

impl Scene {
    pub(crate) const fn new() -> Self {
        Self { spots: [Spot { centre_q8: [0; 2], peak_adu: 0 }; PLACES], row: Row([0; ROW]) }
    }

    /// Places the `count` spots of frame `frame`.
    pub(crate) fn begin(
        &mut self,
        instrument: &Instrument,
        light: Light,
        (frame, count): (u32, usize),
        numbers: &mut Generator,
    ) {
        let Light::Spots(spots) = light else { return };
        let peak_adu = (spots.peak * top(instrument)) >> 8;
        for (i, spot) in (0u32..).zip(self.spots.iter_mut().take(count)) {
            let wander = spots.wander_q8;
            let centre_q8 = [(); 2].map(|()| numbers.between(-wander, wander));
            let bright = (peak_adu * (128 + numbers.below(129))) >> 8;
            let dead = spots.dead > 0 && i % spots.dead == (frame / 2) % spots.dead;
            *spot = Spot { centre_q8, peak_adu: if dead { 0 } else { bright } };
        }
    }

    /// Row `y` of the detector.
    pub(crate) fn row(
        &mut self,
        instrument: &Instrument,
        origins: &[[u16; 2]],
        light: Light,
        y: u16,
        numbers: &mut Generator,
    ) -> &[u16] {
        let [width, _] = instrument.detector();
        let top = top(instrument);
        let dark = u32::from(instrument.dark_adu);
        let row = self.row.0.get_mut(..usize::from(width)).unwrap_or_default();
        match light {
            Light::Level(level) => row.fill(level.min(top as u16)),
            Light::Edges => {
                let edges = [0, 1, dark.saturating_sub(1), dark, dark + 3, top / 2, top - 1, top];
                for pixel in &mut *row {
                    *pixel = (numbers.edge(&edges) & top) as u16;
                }
            }
            Light::Spots(Spots { radius, noise_adu, .. }) => {
                row.fill(0);
                let window = instrument.window;
                for (spot, &[x0, y0]) in self.spots.iter().zip(origins) {
                    let line = y.checked_sub(y0).filter(|&line| line < u16::from(window));
                    let place = usize::from(x0)..usize::from(x0) + usize::from(window);
                    if let (Some(line), Some(pixels)) = (line, row.get_mut(place)) {
                        spot.line(window, line, radius, pixels);
                    }
                }
                for pixel in &mut *row {
                    let noise = (noise(numbers.bits()) * noise_adu) >> 8;
                    let value = (u32::from(*pixel) + dark).saturating_add_signed(noise);
                    *pixel = value.min(top) as u16;
                }
            }
        }
        row
    }
}

impl Spot {
    /// The signal in row `y` of the spot's window, ADU, from 0 to 65535.
    fn line(&self, window: u8, y: u16, radius: u32, pixels: &mut [u16]) {
        // 256 in the spot's centre, 0 at the end of its base.
        let profile = |i: u16, centre_q8: i32| {
            let offset = 256 * i32::from(i) - 128 * (i32::from(window) - 1) - centre_q8;
            let part = 256u32.saturating_sub(offset.unsigned_abs() >> radius);
            (part * part) >> 8
        };
        let [cx, cy] = self.centre_q8;
        let height = (self.peak_adu * profile(y, cy)) >> 8;
        for (x, pixel) in (0..).zip(pixels) {
            *pixel = ((height * profile(x, cx)) >> 8).min(u32::from(u16::MAX)) as u16;
        }
    }
}

/// The highest raw value, ADU.
fn top(instrument: &Instrument) -> u32 {
    (1 << instrument.bits) - 1
}

/// Nearly normal noise with a standard deviation of 148: the sum of four uniform bytes less its
/// mean.
#[inline]
fn noise(bits: u32) -> i32 {
    bits.to_le_bytes().into_iter().map(i32::from).sum::<i32>() - 510
}
