//! Fourier transforms of sixteen rows at a time, one row per lane: every operation is a vector
//! operation, whatever the length, and no value ever changes lane.

use pulp::Simd;

/// Rows transformed together. A multiple of the vector length of every processor.
pub(crate) const LANES: usize = 16;

/// Complex numbers, one per lane.
#[derive(Clone, Copy)]
struct Complex<V> {
    re: V,
    im: V,
}

/// A plan: decimation in frequency with radices 8, 4, 5, 3 and 2, in place and without
/// reordering. The order of the frequencies is left to [`LaneFft::frequencies`].
pub(crate) struct LaneFft {
    length: usize,
    stages: Vec<Stage>,
    frequencies: Vec<usize>,
}

/// One pass over the data: transforms of `radix` values that are `span` apart.
struct Stage {
    radix: usize,
    span: usize,
    /// exp(-2 pi i j q / (radix span)), `[j][q - 1]`, j < span, 1 <= q < radix.
    twiddles: Vec<[f32; 2]>,
}

impl LaneFft {
    /// A transform of the shortest convenient length >= `at_least`.
    pub(crate) fn new(at_least: usize) -> Self {
        let (length, radices) =
            (at_least.max(2)..).find_map(|n| Some((n, factorise(n)?))).expect("powers of two");
        let mut stages: Vec<Stage> = Vec::with_capacity(radices.len());
        let mut frequencies = vec![0; length];
        let (mut block, mut stride) = (length, 1);
        for radix in radices {
            let span = block / radix;
            let turns = |j: usize, q: usize| (j * q) as f64 / block as f64;
            let twiddles = (0..span)
                .flat_map(|j| (1..radix).map(move |q| turns(j, q)))
                .map(|turns| {
                    let (sin, cos) = (-std::f64::consts::TAU * turns).sin_cos();
                    [cos as f32, sin as f32]
                })
                .collect();
            // After this stage, part q of each block holds the frequencies q modulo the radix.
            for (position, frequency) in frequencies.iter_mut().enumerate() {
                *frequency += position % block / span * stride;
            }
            stages.push(Stage { radix, span, twiddles });
            (block, stride) = (span, stride * radix);
        }
        Self { length, stages, frequencies }
    }

    /// Number of values per row.
    pub(crate) fn length(&self) -> usize {
        self.length
    }

    /// The frequency that each position of the result holds, in cycles per length.
    pub(crate) fn frequencies(&self) -> &[usize] {
        &self.frequencies
    }

    /// Transforms `re` + i `im`, `[x][LANES]`, destroying them; position p of the result goes
    /// to `out[p * stride..][..LANES]`.
    #[inline(always)]
    pub(crate) fn forward<S: Simd>(
        &self,
        simd: S,
        re: &mut [f32],
        im: &mut [f32],
        out: [&mut [f32]; 2],
        stride: usize,
    ) {
        let re = S::as_mut_simd_f32s(&mut re[..self.length * LANES]).0;
        let im = S::as_mut_simd_f32s(&mut im[..self.length * LANES]).0;
        let (last, first) = self.stages.split_last().expect("length >= 2");
        for stage in first {
            match stage.radix {
                8 => stage.run::<S, 8>(simd, re, im),
                5 => stage.run::<S, 5>(simd, re, im),
                4 => stage.run::<S, 4>(simd, re, im),
                3 => stage.run::<S, 3>(simd, re, im),
                _ => stage.run::<S, 2>(simd, re, im),
            }
        }
        match last.radix {
            8 => finish::<S, 8>(simd, re, im, out, stride),
            5 => finish::<S, 5>(simd, re, im, out, stride),
            4 => finish::<S, 4>(simd, re, im, out, stride),
            3 => finish::<S, 3>(simd, re, im, out, stride),
            _ => finish::<S, 2>(simd, re, im, out, stride),
        }
    }
}

/// The radices of a transform of `length` values, or none if it has a prime factor above 5.
fn factorise(length: usize) -> Option<Vec<usize>> {
    let mut rest = length;
    let mut radices = vec![];
    for radix in [8, 5, 4, 3, 2] {
        while rest.is_multiple_of(radix) {
            rest /= radix;
            radices.push(radix);
        }
    }
    (rest == 1).then_some(radices)
}

impl Stage {
    #[inline(always)]
    fn run<S: Simd, const R: usize>(&self, simd: S, re: &mut [S::f32s], im: &mut [S::f32s]) {
        let vectors = LANES / S::F32_LANES;
        let span = self.span * vectors;
        for (re, im) in re.chunks_exact_mut(R * span).zip(im.chunks_exact_mut(R * span)) {
            for (j, twiddles) in self.twiddles.chunks_exact(R - 1).enumerate() {
                for v in j * vectors..(j + 1) * vectors {
                    let x = std::array::from_fn(|q| Complex {
                        re: re[v + q * span],
                        im: im[v + q * span],
                    });
                    let y = transform::<S, R>(simd, x);
                    (re[v], im[v]) = (y[0].re, y[0].im);
                    for q in 1..R {
                        let y = rotate(simd, y[q], twiddles[q - 1]);
                        (re[v + q * span], im[v + q * span]) = (y.re, y.im);
                    }
                }
            }
        }
    }
}

/// The last stage: span 1, no twiddles, results to their place.
#[inline(always)]
fn finish<S: Simd, const R: usize>(
    simd: S,
    re: &[S::f32s],
    im: &[S::f32s],
    [out_re, out_im]: [&mut [f32]; 2],
    stride: usize,
) {
    let vectors = LANES / S::F32_LANES;
    let blocks = re.chunks_exact(R * vectors).zip(im.chunks_exact(R * vectors));
    for (block, (re, im)) in blocks.enumerate() {
        for v in 0..vectors {
            let x = std::array::from_fn(|q| Complex {
                re: re[v + q * vectors],
                im: im[v + q * vectors],
            });
            let y = transform::<S, R>(simd, x);
            for (q, y) in y.into_iter().enumerate() {
                let at = (block * R + q) * stride;
                S::as_mut_simd_f32s(&mut out_re[at..at + LANES]).0[v] = y.re;
                S::as_mut_simd_f32s(&mut out_im[at..at + LANES]).0[v] = y.im;
            }
        }
    }
}

/// x * (c + i s)
#[inline(always)]
fn rotate<S: Simd>(simd: S, x: Complex<S::f32s>, [c, s]: [f32; 2]) -> Complex<S::f32s> {
    let (c, s) = (simd.splat_f32s(c), simd.splat_f32s(s));
    Complex {
        re: simd.negate_mul_add_e_f32s(x.im, s, simd.mul_f32s(x.re, c)),
        im: simd.mul_add_e_f32s(x.im, c, simd.mul_f32s(x.re, s)),
    }
}

#[inline(always)]
fn add<S: Simd>(simd: S, a: Complex<S::f32s>, b: Complex<S::f32s>) -> Complex<S::f32s> {
    Complex { re: simd.add_f32s(a.re, b.re), im: simd.add_f32s(a.im, b.im) }
}

#[inline(always)]
fn sub<S: Simd>(simd: S, a: Complex<S::f32s>, b: Complex<S::f32s>) -> Complex<S::f32s> {
    Complex { re: simd.sub_f32s(a.re, b.re), im: simd.sub_f32s(a.im, b.im) }
}

/// a + s b
#[inline(always)]
fn add_scaled<S: Simd>(
    simd: S,
    a: Complex<S::f32s>,
    s: f32,
    b: Complex<S::f32s>,
) -> Complex<S::f32s> {
    let s = simd.splat_f32s(s);
    Complex { re: simd.mul_add_e_f32s(s, b.re, a.re), im: simd.mul_add_e_f32s(s, b.im, a.im) }
}

/// (a - i b, a + i b)
#[inline(always)]
fn quadrature<S: Simd>(simd: S, a: Complex<S::f32s>, b: Complex<S::f32s>) -> [Complex<S::f32s>; 2] {
    [
        Complex { re: simd.add_f32s(a.re, b.im), im: simd.sub_f32s(a.im, b.re) },
        Complex { re: simd.sub_f32s(a.re, b.im), im: simd.add_f32s(a.im, b.re) },
    ]
}

/// y_q = sum_p x_p exp(-2 pi i p q / R)
#[inline(always)]
fn transform<S: Simd, const R: usize>(simd: S, x: [Complex<S::f32s>; R]) -> [Complex<S::f32s>; R] {
    let mut y = x;
    match R {
        2 => (y[0], y[1]) = (add(simd, x[0], x[1]), sub(simd, x[0], x[1])),
        3 => {
            let sum = add(simd, x[1], x[2]);
            let middle = add_scaled(simd, x[0], -0.5, sum);
            let turned = scale(simd, SIN_60, sub(simd, x[1], x[2]));
            y[0] = add(simd, x[0], sum);
            [y[1], y[2]] = quadrature(simd, middle, turned);
        }
        4 => {
            let four = transform_4(simd, [x[0], x[1], x[2], x[3]]);
            y.copy_from_slice(&four);
        }
        5 => {
            let (s1, d1) = (add(simd, x[1], x[4]), sub(simd, x[1], x[4]));
            let (s2, d2) = (add(simd, x[2], x[3]), sub(simd, x[2], x[3]));
            let even_1 = add_scaled(simd, add_scaled(simd, x[0], COS_72, s1), COS_144, s2);
            let even_2 = add_scaled(simd, add_scaled(simd, x[0], COS_144, s1), COS_72, s2);
            let odd_1 = add_scaled(simd, scale(simd, SIN_72, d1), SIN_144, d2);
            let odd_2 = add_scaled(simd, scale(simd, SIN_144, d1), -SIN_72, d2);
            y[0] = add(simd, x[0], add(simd, s1, s2));
            [y[1], y[4]] = quadrature(simd, even_1, odd_1);
            [y[2], y[3]] = quadrature(simd, even_2, odd_2);
        }
        _ => {
            let even = transform_4(simd, [x[0], x[2], x[4], x[6]]);
            let odd = transform_4(simd, [x[1], x[3], x[5], x[7]]);
            let diagonal = std::f32::consts::FRAC_1_SQRT_2;
            (y[0], y[4]) = (add(simd, even[0], odd[0]), sub(simd, even[0], odd[0]));
            let turned = rotate(simd, odd[1], [diagonal, -diagonal]);
            (y[1], y[5]) = (add(simd, even[1], turned), sub(simd, even[1], turned));
            [y[2], y[6]] = quadrature(simd, even[2], odd[2]);
            let turned = rotate(simd, odd[3], [-diagonal, -diagonal]);
            (y[3], y[7]) = (add(simd, even[3], turned), sub(simd, even[3], turned));
        }
    }
    y
}

const SIN_60: f32 = 0.866_025_4;
const COS_72: f32 = 0.309_017;
const SIN_72: f32 = 0.951_056_5;
const COS_144: f32 = -0.809_017;
const SIN_144: f32 = 0.587_785_24;

#[inline(always)]
fn scale<S: Simd>(simd: S, s: f32, a: Complex<S::f32s>) -> Complex<S::f32s> {
    let s = simd.splat_f32s(s);
    Complex { re: simd.mul_f32s(s, a.re), im: simd.mul_f32s(s, a.im) }
}

#[inline(always)]
fn transform_4<S: Simd>(simd: S, x: [Complex<S::f32s>; 4]) -> [Complex<S::f32s>; 4] {
    let (s02, d02) = (add(simd, x[0], x[2]), sub(simd, x[0], x[2]));
    let (s13, d13) = (add(simd, x[1], x[3]), sub(simd, x[1], x[3]));
    let [y1, y3] = quadrature(simd, d02, d13);
    [add(simd, s02, s13), y1, sub(simd, s02, s13), y3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct Forward<'a>(&'a LaneFft, Vec<f32>, Vec<f32>);

    impl WithSimd for Forward<'_> {
        type Output = [Vec<f32>; 2];

        #[inline(always)]
        fn with_simd<S: Simd>(mut self, simd: S) -> Self::Output {
            let mut out = [vec![0.0; self.1.len()], vec![0.0; self.1.len()]];
            let [re, im] = &mut out;
            self.0.forward(simd, &mut self.1, &mut self.2, [re, im], LANES);
            out
        }
    }

    #[test]
    fn agrees_with_the_definition() {
        for at_least in [2, 3, 5, 8, 39, 45, 71, 135, 263] {
            let fft = LaneFft::new(at_least);
            let length = fft.length();
            let value = |x: usize, lane: usize, part: f64| {
                ((x * x + 3 * x * lane) as f64 * 0.37 + part).sin()
            };
            let input = |part: f64| -> Vec<f32> {
                let at = |k: usize| value(k / LANES, k % LANES, part) as f32;
                (0..length * LANES).map(at).collect()
            };
            let [re, im] = Arch::new().dispatch(Forward(&fft, input(0.0), input(1.0)));
            for (position, &frequency) in fft.frequencies().iter().enumerate() {
                for lane in [0, 7, 15] {
                    let mut sum = [0.0; 2];
                    for x in 0..length {
                        let turns = (x * frequency % length) as f64 / length as f64;
                        let (s, c) = (-std::f64::consts::TAU * turns).sin_cos();
                        let (re, im) = (value(x, lane, 0.0), value(x, lane, 1.0));
                        sum[0] += re * c - im * s;
                        sum[1] += re * s + im * c;
                    }
                    let at = position * LANES + lane;
                    let error = (f64::from(re[at]) - sum[0]).hypot(f64::from(im[at]) - sum[1]);
                    assert!(error < 1e-5 * (length as f64).sqrt(), "length {length}: {error}");
                }
            }
        }
    }
}
