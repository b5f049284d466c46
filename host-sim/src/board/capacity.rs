//! Capacities of the library on a PC.

/// `$with!(cells, window pixels, modes)` with the smallest capacities that hold the instrument of a `Spec`: of all
/// its windows, one a gate and cell.
macro_rules! smallest {
    ($spec:expr, $with:ident) => {{
        use splash_firmware::modal::MAX_MODES;
        let (gates, across) = ($spec.gates(), $spec.mask.across());
        let pixels = gates * $spec.mask.count() * usize::from($spec.windows.size).pow(2);
        match (gates, across, pixels) {
            (1, ..=8, ..=16_384) => $with!(64, 16_384, 0),
            (1, ..=16, ..=65_536) => $with!(256, 65_536, 0),
            (1, ..) => $with!(1600, 1_638_400, 0),
            (_, ..=16, ..=131_072) => $with!(512, 131_072, MAX_MODES),
            _ => $with!(3200, 3_276_800, MAX_MODES),
        }
    }};
}
pub(crate) use smallest;
