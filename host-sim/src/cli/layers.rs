//! Turbulent layers as words of the command line.

use crate::theory::{BETAS, Layer};

/// A beta.
pub(super) fn beta(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| "must be a number".to_string())?;
    if BETAS.contains(&value) {
        Ok(value)
    } else {
        Err(format!("must be from {} to {}", BETAS.start(), BETAS.end()))
    }
}

/// A layer, `WEIGHT:BETA`.
pub(super) fn layer(text: &str) -> Result<Layer, String> {
    let (weight, rest) =
        text.split_once(':').ok_or("must be WEIGHT:BETA, such as 0.4:0.75".to_string())?;
    let weight: f64 = weight.trim().parse().map_err(|_| "weight must be a number".to_string())?;
    if !(0.0..=1e9).contains(&weight) {
        return Err("weight must be from 0 to 1e9".into());
    }
    let beta = beta(rest).map_err(|limit| format!("beta {limit}"))?;
    Ok(Layer { weight, beta })
}
