//! Capacities of the types, and places of the windows: neither matters.

use super::*;

fn codes_of<const M: usize, const P: usize, const B: usize>(
    instrument: &Instrument,
    frames: &[Vec<u16>],
) -> Vec<Vec<[u16; 3]>> {
    let config = instrument.config::<M, P, B>();
    let mut pipeline = Box::new(Pipeline::<M, B>::new());
    let numbered = (0..).zip(frames);
    numbered
        .map(|(number, pixels)| {
            step(&mut pipeline, &config, number, pixels);
            pipeline.codes().to_vec()
        })
        .collect()
}

#[test]
fn capacities_do_not_matter() {
    with_big_stack(|| {
        for estimator in estimators() {
            let mut instrument = usual();
            instrument.estimator = estimator;
            instrument.delay_frames = 1;
            let frames = frames(&instrument, 4);
            // The least that fits: 52 windows of 64 pixels, eight of them side by side.
            let least = codes_of::<64, { 52 * 64 }, { 8 * 64 }>(&instrument, &frames);
            assert_eq!(codes_of::<64, 16384, 2048>(&instrument, &frames), least);
            assert_eq!(codes_of::<256, 16384, 2048>(&instrument, &frames), least);
            assert_eq!(codes_of::<1600, 65536, 8192>(&instrument, &frames), least);
        }
    });
}

/// Each subaperture's window moved to another place of a larger detector, in another order and at
/// odd positions, with light in between: the same contents give the same measurements.
#[test]
fn placement_does_not_matter() {
    for estimator in estimators() {
        let mut near = usual();
        near.estimator = estimator;
        // A calibration of its own for each pixel, which moves with it.
        let mut rng = Rng::new(21);
        let count = near.count();
        let mut map = |low, high| -> Vec<f64> {
            (0..64 * 64).map(|_| f64::from(rng.between(low, high)) / 100.0).collect()
        };
        let (dark, gain, noise) = (map(5000, 15_000), map(50, 200), map(0, 300));
        near.bad = vec![[20, 4], [21, 4], [33, 30]];
        let frames = frames(&near, 4);

        // Cells of 13 pixels, nine by nine; windows at 0 to 5 pixels inside their cell.
        let side = 9 * 13;
        let mut cells: Vec<usize> = (0..81).collect();
        for i in (1..81).rev() {
            cells.swap(i, rng.below(i as u32 + 1) as usize);
        }
        let mut far = near.clone();
        far.detector.width = side as u16;
        far.detector.height = side as u16;
        far.origins = cells[..count]
            .iter()
            .map(|cell| [cell % 9, cell / 9].map(|i| (13 * i) as u16 + rng.below(6) as u16))
            .collect();

        // Where each pixel of the near detector went.
        let mut moved = Vec::new();
        for (from, to) in near.origins.iter().zip(&far.origins) {
            for (x, y) in (0..64u16).map(|i| (i % 8, i / 8)) {
                let [a, b] = [from, to].map(|o| [usize::from(o[0] + x), usize::from(o[1] + y)]);
                moved.push((a, b));
            }
        }
        let carry = |map: &[f64], elsewhere: f64| {
            let mut carried = vec![elsewhere; side * side];
            moved.iter().for_each(|&([x, y], [u, v])| carried[v * side + u] = map[y * 64 + x]);
            Values::Each(carried)
        };
        (far.dark_adu, far.pixel_gain) = (carry(&dark, 0.0), carry(&gain, 1.0));
        far.noise_adu = carry(&noise, 0.0);
        (near.dark_adu, near.pixel_gain) = (Values::Each(dark), Values::Each(gain));
        near.noise_adu = Values::Each(noise);
        let is_bad = |at: [usize; 2]| near.bad.contains(&at.map(|i| i as u16));
        let bad = moved.iter().filter(|(from, _)| is_bad(*from));
        far.bad = bad.map(|(_, to)| to.map(|i| i as u16)).collect();
        far.bad.sort_by_key(|&[x, y]| (y, x));

        let near_config = near.config::<CELLS, PIXELS, BUFFERED>();
        let far_config = far.config::<CELLS, PIXELS, BUFFERED>();
        let (mut here, mut there) = (pipeline(), pipeline());
        for (number, pixels) in (0..).zip(&frames) {
            let mut scattered: Vec<u16> =
                (0..side * side).map(|_| rng.below(4096) as u16).collect();
            moved.iter().for_each(|&([x, y], [u, v])| {
                scattered[v * side + u] = pixels[y * 64 + x];
            });
            let expected = step(&mut here, &near_config, number, pixels);
            let report = step(&mut there, &far_config, number, &scattered);
            assert_eq!(report, expected, "{estimator:?}, frame {number}");
            assert_same(&state(&there), &state(&here), &format!("{estimator:?}, frame {number}"));
        }
    }
}
