//! Limits of the segments: nothing moves further than they allow, and all that moves is known.

use super::*;

/// A slew limit that was not in the way changes nothing; one that was bounds every actuator.
#[test]
fn a_slew_limit_acts_only_when_it_is_reached() {
    let mut instrument = transparent(0);
    instrument.mean = MeanSlope::Keep;
    instrument.dac_bits = 16;
    let lsb_m = instrument.stroke_m / 65536.0;
    let free = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let (mut reached, mut unreached) = (0, 0);
    for slew_lsb in [1.0, 1.3, 2.0, 10.0, 100.0] {
        instrument.slew_m_per_frame = Some(slew_lsb * lsb_m);
        let limited = instrument.config::<CELLS, PIXELS, BUFFERED>();
        for part in 1..40 {
            // One subaperture tilts, by a twentieth of the limit more at a time, times g = 1/2
            // and 0.6 of a lever.
            let tilt = (f64::from(part) * slew_lsb * 512.0 / 20.0 / 0.3) as i32;
            let mut atmosphere = vec![[0; 2]; 52];
            atmosphere[20] = [0, tilt];
            let measured = seen(&atmosphere, &vec![[0; 2]; 52]);
            let [mut a, mut b] = [(); 2].map(|()| pipeline());
            for (pipeline, config) in [(&mut a, &free), (&mut b, &limited)] {
                pipeline.begin(config, 0);
                pipeline.push_measurements(config, &measured).expect("a frame");
            }
            let (flat, moved) = (b.codes().to_vec(), a.finish(&free));
            let report = b.finish(&limited);
            assert_eq!(moved.slewed_actuators, 0);
            if report.slewed_actuators == 0 {
                unreached += 1;
                assert_same(&state(&b), &state(&a), &format!("{slew_lsb} LSB, part {part}"));
            } else {
                reached += 1;
            }
            let steps = b.codes().as_flattened().iter().zip(flat.as_flattened());
            for (&code, &from) in steps {
                // Half a code of rounding at either end.
                let step = f64::from(code.abs_diff(from));
                assert!(step <= slew_lsb + 1.0, "{step} codes in a frame of {slew_lsb}");
            }
        }
    }
    assert!(reached > 20 && unreached > 20, "{reached} and {unreached}");
}

/// The position that a segment is said to have is the one that its codes show, limits or not.
#[test]
fn positions_are_what_the_codes_show() {
    for piston in [1.0, 0.5, 3.0, 0.75, 3.5] {
        let mut instrument = transparent(0);
        // Ratios that are stored exactly.
        let ratios = [[1.0, 0.0, 0.5], [1.0, -0.375, -0.25], [1.0, 0.375, -0.25]];
        let segment = ratios.map(|row: [f64; 3]| row.map(|ratio| ratio * piston));
        instrument.matrix = Values::Uniform(segment);
        let [low, high] = [0.25, 0.625].map(|part| part * instrument.stroke_m);
        instrument.limits_m = Values::Uniform([[low, high]; 3]);
        let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
        let mut rng = Rng::new(31);
        let mut pipeline = pipeline();
        let mut limited = 0;
        for number in 0..30 {
            let largest = 1 << (14 + number.min(18) / 2);
            let mut any = || rng.between(-largest, largest);
            let tilts: Vec<_> = (0..52).map(|_| [any(), any()]).collect();
            pipeline.begin(&config, number as u32);
            let measured = seen(&tilts, &vec![[0; 2]; 52]);
            pipeline.push_measurements(&config, &measured).expect("a frame");
            limited += pipeline.finish(&config).saturated_actuators;
            for (position, codes) in pipeline.positions().iter().zip(pipeline.codes()) {
                let [tip, tilt] = position.tilt_ulp.map(f64::from);
                for (row, &code) in segment.iter().zip(codes) {
                    let height =
                        row[0] * f64::from(position.piston_ulp) + row[1] * tip + row[2] * tilt;
                    // Code 65535 is the whole stroke of 2^25 ulp; flat is its middle.
                    let shown = f64::from(code) / 65535.0 * 33_554_432.0 - 16_777_216.0;
                    // Half a code, and the rounding of the height in units of piston.
                    let error = (shown - height).abs();
                    let context = format!("piston influence {piston}, frame {number}");
                    assert!(error <= 0.5 * 512.01 + 2.0 + piston, "{context}: {error} ulp");
                }
            }
        }
        assert!(limited > 100, "{limited} actuators at their limits");
    }
}
