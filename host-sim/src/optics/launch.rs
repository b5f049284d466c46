//! The beam that is launched through a subaperture: its amplitude over the square, and what of it passes.
//!
//! A Gaussian beam of waist w, the radius at which the intensity is 1/e^2 of its peak, has the amplitude
//! exp(-r^2/w^2) about the subaperture's centre and is cut off by the subaperture's square of side d. What
//! passes is erf(d/(sqrt(2) w))^2 of it: 91 % for w = d/2. The far field of the beam that passes is the
//! separable integral over the square, so that it is wider than lambda/d for w well below d and tends to
//! that of the uniform beam for w well above.

use std::f64::consts::SQRT_2;

/// Intensity over a subaperture of the beam that is launched through it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Launch {
    /// The same all over the square, as in Butterley et al. 2006.
    #[default]
    Uniform,
    /// A Gaussian beam about the square's centre.
    Gaussian {
        /// Radius at which the intensity is 1/e^2 of the peak, in sides of a subaperture; above 0.
        waist_pitches: f64,
    },
}

impl Launch {
    /// The part of the beam's light that the square lets pass, 0 to 1; all of a uniform beam does.
    pub fn transmitted(self) -> f64 {
        match self {
            Self::Uniform => 1.0,
            Self::Gaussian { waist_pitches } => libm::erf(1.0 / (SQRT_2 * waist_pitches)).powi(2),
        }
    }

    /// Amplitudes along one axis at the `samples` centres of equal cells across the subaperture: that over
    /// the square is the product of two. The mean of their squares is one.
    pub(crate) fn amplitudes(self, samples: usize) -> Vec<f64> {
        let Self::Gaussian { waist_pitches } = self else { return vec![1.0; samples] };
        let place = |k: usize| ((k as f64 + 0.5) / samples as f64 - 0.5) / waist_pitches;
        let beam: Vec<f64> = (0..samples).map(|k| (-place(k).powi(2)).exp()).collect();
        let mean = beam.iter().map(|a| a * a).sum::<f64>() / samples as f64;
        beam.iter().map(|a| a / mean.sqrt()).collect()
    }

    /// Intensities at the same places, of mean one.
    pub(crate) fn intensities(self, samples: usize) -> Vec<f64> {
        self.amplitudes(samples).iter().map(|a| a * a).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Launch;

    /// The beam's light within the square, by the midpoint rule on the intensity exp(-2 r^2/w^2).
    #[test]
    fn what_passes_is_the_integral_over_the_square() {
        for waist_pitches in [0.2, 0.5, 1.0, 3.0] {
            let beam = |x: f64| (-2.0 * (x / waist_pitches).powi(2)).exp();
            let integral = |half: f64| -> f64 {
                let step = 2.0 * half / 1e5;
                (0..100_000).map(|k| beam((f64::from(k) + 0.5) * step - half) * step).sum()
            };
            let expected = (integral(0.5) / integral(6.0 * waist_pitches)).powi(2);
            let passes = Launch::Gaussian { waist_pitches }.transmitted();
            assert!((passes - expected).abs() < 1e-7, "{waist_pitches}: {passes}, {expected}");
        }
        assert_eq!(Launch::Uniform.transmitted(), 1.0);
    }
}
