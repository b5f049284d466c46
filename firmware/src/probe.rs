//! Where the time goes: a board is told as `finish` passes from stage to stage.

/// The stages of [`finish_probed`](crate::pipeline::Pipeline::finish_probed), in their order. What
/// comes before them, from calibration to slopes, is done in `push_row` as rows come and windows end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// The complete frame's measurements, slopes and thresholds become those in use.
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
