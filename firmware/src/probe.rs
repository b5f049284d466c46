//! Where the time goes: a board is told as `finish` passes from stage to stage.

/// The stages of [`finish_probed`](crate::pipeline::Pipeline::finish_probed), in their order. What
/// comes before them, calibration and centroids, is done row by row in `push_row`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// Measurements to slopes, and the thresholds of the next frame.
    Slopes,
    /// Slopes to tip/tilt commands.
    Control,
    /// Tip/tilt commands to pistons.
    Sor,
    /// Pistons, tips and tilts to heights within limits.
    Segments,
    /// Heights to DAC codes.
    Actuators,
}

/// Something that reads a counter, or marks the moment for one outside.
pub trait Probe {
    /// `stage` is done.
    fn after(&mut self, stage: Stage);
}

/// Looks away, at no cost.
impl Probe for () {
    #[inline(always)]
    fn after(&mut self, _: Stage) {}
}
