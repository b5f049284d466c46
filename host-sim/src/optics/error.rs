//! What the optics refuse, and why.

/// A physical parameter that the optics cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OpticsError {
    /// A number is NaN, infinite or outside its range.
    #[error("{field} = {value}: must be {limit}")]
    OutOfRange {
        /// The parameter's name with its unit, e.g. `r0_m`.
        field: String,
        /// The value given.
        value: f64,
        /// The range that would have been accepted.
        limit: String,
    },
    /// A list has the wrong number of entries.
    #[error("{field} has {value} entries: must have {limit}")]
    Length {
        /// The list's name.
        field: String,
        /// Its number of entries.
        value: usize,
        /// The number that would have been accepted.
        limit: String,
    },
    /// Frozen flow never visits a place twice, so a long run needs a long screen: this one is too
    /// long to be generated in memory.
    #[error(
        "layer {layer}: a run of duration_s = {duration_s} needs a phase screen of {texels} \
         texels: must be <= {limit} (a run of {longest_s:.3} s)"
    )]
    ScreenTooLarge {
        /// Index of the layer in the list given.
        layer: usize,
        /// Duration asked for, s.
        duration_s: f64,
        /// Texels needed.
        texels: u64,
        /// The largest number of texels.
        limit: u64,
        /// The longest duration that fits with this layer's wind, s.
        longest_s: f64,
    },
}

impl OpticsError {
    /// `field` = `value` violates `limit`.
    pub(crate) fn range(field: impl Into<String>, value: f64, limit: impl Into<String>) -> Self {
        Self::OutOfRange { field: field.into(), value, limit: limit.into() }
    }
}

/// `value` if it is finite and positive.
pub(crate) fn positive(field: &str, value: f64) -> Result<f64, OpticsError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(OpticsError::range(field, value, "finite and > 0"))
    }
}

/// `value` if it is finite and not negative.
pub(crate) fn not_negative(field: &str, value: f64) -> Result<f64, OpticsError> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(OpticsError::range(field, value, "finite and >= 0"))
    }
}
