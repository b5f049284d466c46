//! From values to colours, and the numbers that stand beside a colour bar.

use super::axes::{Tick, linear_ticks};

/// How values are spread over the colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Stretch {
    /// In proportion.
    Linear,
    /// By square root: the shot noise of photons then looks the same everywhere.
    Sqrt,
    /// By logarithm.
    Log,
}

/// The colours of a figure.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColourScale {
    low: f64,
    high: f64,
    stretch: Stretch,
    map: fn(f64) -> [u8; 3],
}

impl ColourScale {
    /// Viridis from the smallest to the largest finite value.
    pub(super) fn sequential(values: impl Iterator<Item = f64>, stretch: Stretch) -> Self {
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(value), high.max(value))
            });
        let (low, high) = match (low < high, low.is_finite()) {
            (true, _) => (low, high),
            (false, true) => (low, low + 1.0),
            (false, false) => (0.0, 1.0),
        };
        Self { low, high, stretch, map: viridis }
    }

    /// Viridis over the decades below 1.
    pub(super) fn decades(count: i32) -> Self {
        Self { low: 10_f64.powi(-count), high: 1.0, stretch: Stretch::Log, map: viridis }
    }

    /// Blue through white at 0 to red, as far as the largest finite value of either sign.
    pub(super) fn diverging(values: impl Iterator<Item = f64>) -> Self {
        let largest =
            values.filter(|value| value.is_finite()).fold(0.0, |l: f64, v| l.max(v.abs()));
        let high = if largest > 0.0 { largest } else { 1.0 };
        Self { low: -high, high, stretch: Stretch::Linear, map: red_white_blue }
    }

    /// Where a value stands on the colour bar, 0 to 1.
    pub(super) fn position(&self, value: f64) -> f64 {
        let fraction = match self.stretch {
            Stretch::Linear => (value - self.low) / (self.high - self.low),
            Stretch::Sqrt => ((value - self.low) / (self.high - self.low)).max(0.0).sqrt(),
            Stretch::Log => (value.max(self.low) / self.low).ln() / (self.high / self.low).ln(),
        };
        fraction.clamp(0.0, 1.0)
    }

    /// RGBA of a value; transparent where there is none.
    pub(super) fn rgba(&self, value: Option<f64>) -> [u8; 4] {
        match value {
            Some(value) if value.is_finite() => self.at(self.position(value)),
            _ => [0; 4],
        }
    }

    /// RGBA at a position of the colour bar, 0 to 1.
    pub(super) fn at(&self, position: f64) -> [u8; 4] {
        let [red, green, blue] = (self.map)(position);
        [red, green, blue, 255]
    }

    /// The values to write beside the colour bar.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        match self.stretch {
            Stretch::Linear => linear_ticks(self.low, self.high, 8),
            Stretch::Sqrt => self.sqrt_ticks(),
            Stretch::Log => {
                let decades = self.low.log10().round() as i32..=self.high.log10().round() as i32;
                decades
                    .map(|exponent| Tick {
                        value: 10_f64.powi(exponent),
                        label: format!("10{}", superscript(exponent)),
                    })
                    .collect()
            }
        }
    }

    /// Evenly spaced along the bar, each value as round as its distance to the next allows.
    fn sqrt_ticks(&self) -> Vec<Tick> {
        const INTERVALS: i32 = 6;
        let at = |i: i32| {
            self.low + (self.high - self.low) * (f64::from(i) / f64::from(INTERVALS)).powi(2)
        };
        (0..=INTERVALS)
            .map(|i| {
                let gap = if i == 0 { at(1) - at(0) } else { at(i) - at(i - 1) };
                let exponent = gap.log10().floor();
                let decade = 10_f64.powf(exponent);
                let value = (at(i) / decade).round() * decade;
                let decimals = (-exponent).max(0.0) as usize;
                Tick { value, label: format!("{value:.decimals$}") }
            })
            .filter(|tick| (self.low..=self.high).contains(&tick.value))
            .collect()
    }
}

fn superscript(number: i32) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let glyph = |c: char| c.to_digit(10).map_or('⁻', |digit| digits[digit as usize]);
    number.to_string().chars().map(glyph).collect()
}

fn viridis(position: f64) -> [u8; 3] {
    colorous::VIRIDIS.eval_continuous(position).as_array()
}

fn red_white_blue(position: f64) -> [u8; 3] {
    colorous::RED_BLUE.eval_continuous(1.0 - position).as_array()
}
