//! Exact fractional Brownian surfaces on a torus (Stein 2002, "Fast and exact simulation of
//! fractional Brownian surfaces", J. Comput. Graph. Stat. 11, 587).
//!
//! Distances are in units of U. For r <= 1 the covariance c(r) = c0 - r^a + c2 r^2, a = 5/3, plus a
//! random plane sqrt(2 c2) (g1 x + g2 y) gives the structure function
//! 2 (c(0) - c(r)) + 2 c2 r^2 = 2 r^a exactly. Beyond r = 1 the covariance goes smoothly to zero
//! at r = R = 2, such that it stays positive definite; a torus of sides >= 2 R then reproduces it
//! without any error, and one Fourier transform of weighted white noise draws two fields.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use splash_fft::{Complex, Fft, Planned, Transform};

/// Exponent of the structure function.
const ALPHA: f64 = 5.0 / 3.0;
/// Distance in U beyond which the covariance vanishes.
const REACH: f64 = 2.0;
/// Columns gathered at a time in the second pass: eight complex numbers are two cache lines.
const STRIP: usize = 8;
/// The stream, within a draw, of the random planes; the rows of the spectrum take those below.
const PLANE_STREAM: u64 = 0xffff_ffff;

/// Coefficients of the covariance for R = 2.
struct Covariance {
    c0: f64,
    c2: f64,
    beta: f64,
}

impl Covariance {
    fn new() -> Self {
        let beta = ALPHA * (2.0 - ALPHA) / (3.0 * REACH * (REACH * REACH - 1.0));
        let c2 = (ALPHA - beta * (REACH - 1.0).powi(2) * (REACH + 2.0)) / 2.0;
        Self { c0: beta * (REACH - 1.0).powi(3) + 1.0 - c2, c2, beta }
    }

    /// c(r), r in units of U.
    fn at(&self, r: f64) -> f64 {
        if r <= 1.0 {
            self.c0 - r.powf(ALPHA) + self.c2 * r * r
        } else if r <= REACH {
            self.beta * (REACH - r).powi(3) / r
        } else {
            0.0
        }
    }
}

/// A drawn surface of structure function 2 r^(5/3), r in units of U.
pub(crate) struct Surface {
    /// Row-major, width x height.
    pub(crate) texels: Vec<f32>,
    /// The plane's gradient per U along x and y, not contained in the texels.
    pub(crate) gradient: [f64; 2],
}

/// Everything that draws on one torus have in common.
pub(crate) struct BrownianTorus {
    width: usize,
    height: usize,
    /// sqrt(eigenvalue / texels) for the frequencies [0, width/2] x [0, height/2], `[kx][ky]`;
    /// the spectrum is even in both.
    amplitude: Vec<f64>,
    along_x: Transform<f64>,
    along_y: Transform<f64>,
    plane: f64,
}

impl BrownianTorus {
    /// A torus of `width` x `height` texels with `unit_texels` texels in U.
    ///
    /// # Panics
    /// If a side is shorter than 2 R U: the eigenvalues would then not all be positive.
    pub(crate) fn new([width, height]: [usize; 2], unit_texels: f64) -> Self {
        assert!(width.min(height) as f64 >= 2.0 * REACH * unit_texels, "torus sides >= 4 U");
        let covariance = Covariance::new();
        let [along_x, along_y] = [width, height].map(f64::forward);

        let mut data = vec![Complex::default(); width * height];
        data.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
            let y = row.min(height - row) as f64 / unit_texels;
            for (col, value) in values.iter_mut().enumerate() {
                let x = col.min(width - col) as f64 / unit_texels;
                value.re = covariance.at(x.hypot(y));
            }
        });
        let eigenvalues = transform(data, along_x.as_ref(), along_y.as_ref(), |value| value.re);
        let largest = eigenvalues.iter().copied().fold(0.0, f64::max);
        let mut amplitude = Vec::with_capacity((width / 2 + 1) * (height / 2 + 1));
        for kx in 0..=width / 2 {
            for &eigenvalue in &eigenvalues[kx * height..][..=height / 2] {
                // The exact eigenvalues are positive; what the transform rounds below zero is
                // of the order of its own error.
                assert!(eigenvalue > -1e-9 * largest, "circulant embedding is not positive");
                amplitude.push((eigenvalue.max(0.0) / (width * height) as f64).sqrt());
            }
        }
        let plane = (2.0 * covariance.c2).sqrt();
        Self { width, height, amplitude, along_x, along_y, plane }
    }

    /// Two independent surfaces: a pure function of `seed` and `stream` (ChaCha8, one stream for
    /// each row of the spectrum, whatever the number of threads).
    pub(crate) fn draw(&self, seed: u64, stream: u32) -> [Surface; 2] {
        let generator = |row: u64| {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            generator.set_stream(u64::from(stream) << 32 | row);
            generator
        };
        let (width, height) = (self.width, self.height);
        let mut data = vec![Complex::default(); width * height];
        data.par_chunks_mut(height).enumerate().for_each(|(kx, values)| {
            let mut generator = generator(kx as u64);
            let amplitude = &self.amplitude[kx.min(width - kx) * (height / 2 + 1)..];
            for (ky, value) in values.iter_mut().enumerate() {
                let re: f64 = StandardNormal.sample(&mut generator);
                let im: f64 = StandardNormal.sample(&mut generator);
                *value = Complex::new(re, im) * amplitude[ky.min(height - ky)];
            }
        });
        let fields = transform(data, self.along_y.as_ref(), self.along_x.as_ref(), |value| {
            [value.re as f32, value.im as f32]
        });
        let mut generator = generator(PLANE_STREAM);
        [0, 1].map(|part| Surface {
            texels: fields.iter().map(|field| field[part]).collect(),
            gradient: [0; 2].map(|_| {
                let normal: f64 = StandardNormal.sample(&mut generator);
                self.plane * normal
            }),
        })
    }
}

/// Two-dimensional transform of `data` (row-major, `rows.len()` columns, `columns.len()` rows):
/// `rows` is applied to every row, `columns` to every column. The result is transposed, which
/// saves a second array of complex numbers.
fn transform<T: Copy + Default + Send>(
    mut data: Vec<Complex<f64>>,
    rows: &dyn Fft<f64>,
    columns: &dyn Fft<f64>,
    store: impl Fn(Complex<f64>) -> T + Sync,
) -> Vec<T> {
    let (width, height) = (rows.len(), columns.len());
    data.par_chunks_mut(width).for_each_init(
        || vec![Complex::default(); rows.get_inplace_scratch_len()],
        |scratch, row| rows.process_with_scratch(row, scratch),
    );
    let mut out = vec![T::default(); width * height];
    out.par_chunks_mut(STRIP * height).enumerate().for_each_init(
        || {
            let scratch = vec![Complex::default(); columns.get_inplace_scratch_len()];
            (vec![Complex::default(); STRIP * height], scratch)
        },
        |(strip, scratch), (index, out)| {
            let strip = &mut strip[..out.len()];
            for (y, row) in data.chunks_exact(width).enumerate() {
                for (x, value) in row[index * STRIP..].iter().take(out.len() / height).enumerate() {
                    strip[x * height + y] = *value;
                }
            }
            columns.process_with_scratch(strip, scratch);
            for (out, value) in out.iter_mut().zip(strip) {
                *out = store(*value);
            }
        },
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The structure function that the eigenvalues and the plane imply, without any statistics.
    #[test]
    fn structure_function_is_exact_up_to_one_unit() {
        let (width, height, unit) = (48, 54, 12.0);
        let torus = BrownianTorus::new([width, height], unit);
        let power = |kx: usize, ky: usize| {
            torus.amplitude[kx.min(width - kx) * (height / 2 + 1) + ky.min(height - ky)].powi(2)
        };
        for (x, y) in [(1, 0), (0, 1), (3, 4), (12, 0), (0, 12), (7, 8)] {
            let mut structure = 0.0;
            for kx in 0..width {
                for ky in 0..height {
                    let turns = (kx * x) as f64 / width as f64 + (ky * y) as f64 / height as f64;
                    structure +=
                        2.0 * power(kx, ky) * (1.0 - (std::f64::consts::TAU * turns).cos());
                }
            }
            let r = f64::from(x as u32).hypot(f64::from(y as u32)) / unit;
            structure += (torus.plane * r).powi(2);
            let expected = 2.0 * r.powf(ALPHA);
            assert!((structure / expected - 1.0).abs() < 1e-9, "{x} {y}: {structure} {expected}");
        }
    }

    #[test]
    fn surfaces_depend_on_seed_and_stream_only() {
        let torus = BrownianTorus::new([16, 20], 4.0);
        let [a, b] = torus.draw(1, 0);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let [again, _] = pool.install(|| torus.draw(1, 0));
        assert_eq!(a.texels, again.texels);
        assert_eq!(a.gradient, again.gradient);
        assert_ne!(a.texels, b.texels);
        assert_ne!(a.texels, torus.draw(1, 1)[0].texels);
        assert_ne!(a.texels, torus.draw(2, 0)[0].texels);
    }
}
