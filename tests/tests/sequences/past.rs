//! What the mirror showed: the delay, lost frames and the global tilt.

use super::*;

/// What goes wrong in one frame of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Loss {
    None,
    /// Rows are missing, and `finish` says so.
    CutShort,
    /// The next frame begins before this one was finished.
    Restarted,
}

/// The commands of every frame of a loop that is closed on a constant atmosphere.
///
/// Frame k is exposed while the mirror shows what it was told after frame k - 1 - L; a frame that
/// is lost leaves the mirror as it is.
fn closed_loop(delay: u8, losses: &[Loss], global: Option<[i32; 2]>) -> Vec<Vec<[i32; 2]>> {
    let instrument = transparent(delay);
    let config = instrument.config::<CELLS, PIXELS, BUFFERED>();
    let mut pipeline = pipeline();
    let mut rng = Rng::new(5);
    let count = instrument.count();
    let mut any = || rng.between(-1 << 18, 1 << 18);
    let atmosphere: Vec<_> = (0..count).map(|_| [any(), any()]).collect();
    // What the mirror showed, the latest last, without the global tilt.
    let mut shown = vec![vec![[0; 2]; count]; 1 + usize::from(delay)];
    let mut commands = Vec::new();
    if let Some(tilt_ulp) = global {
        pipeline.reset(&config);
        pipeline.set_global_tilt(GlobalTilt { tilt_ulp, frame: 0 });
    }
    for (number, &loss) in (0..).zip(losses) {
        let exposed = &shown[shown.len() - 1 - usize::from(delay)];
        pipeline.begin(&config, number);
        match loss {
            Loss::Restarted => {}
            Loss::CutShort => {
                let held = pipeline.finish(&config).outcome;
                assert_eq!(held, Outcome::Held(Hold::CutShort { rows: 0 }));
            }
            Loss::None => {
                pipeline.push_measurements(&config, &seen(&atmosphere, exposed)).expect("a frame");
                let report = pipeline.finish(&config);
                assert_eq!((report.outcome, report.saturated_actuators), (Outcome::Updated, 0));
                commands.push(pipeline.commands().to_vec());
            }
        }
        let [tip, tilt] = global.unwrap_or_default();
        let now = pipeline.positions().iter().map(|p| [p.tilt_ulp[0] - tip, p.tilt_ulp[1] - tilt]);
        let now = if commands.is_empty() { vec![[0; 2]; count] } else { now.collect() };
        shown.push(now);
    }
    commands
}

/// s + c_applied is the atmosphere, however late the mirror: the commands do not know the delay.
#[test]
fn the_delay_is_made_up_for() {
    let prompt = closed_loop(0, &[Loss::None; 12], None);
    for delay in 1..=3 {
        let late = closed_loop(delay, &[Loss::None; 12], None);
        for (k, (late, prompt)) in late.iter().zip(&prompt).enumerate() {
            first_difference(late, prompt, &format!("delay {delay}, frame {k}"));
        }
    }
    // Of 2^18 ulp, (1 - g)^12 is left at g = 1/2.
    for (last, before) in prompt[11].as_flattened().iter().zip(prompt[10].as_flattened()) {
        assert!((last - before).abs() <= (1 << 18 >> 11) + 2, "{last} after {before}");
    }
}

/// A lost frame is one during which the mirror kept its shape, whichever way it was lost.
#[test]
fn a_lost_frame_is_part_of_the_past() {
    let good = closed_loop(0, &[Loss::None; 10], None);
    for loss in [Loss::CutShort, Loss::Restarted] {
        for delay in 0..=3 {
            for lost in [vec![4], vec![4, 5], vec![3, 5], vec![0, 6]] {
                let mut losses = [Loss::None; 12];
                lost.iter().for_each(|&k| losses[k] = loss);
                let commands = closed_loop(delay, &losses, None);
                let kept = commands.len();
                assert_eq!(kept, 12 - lost.len());
                for (k, (found, expected)) in commands.iter().zip(&good).enumerate() {
                    let context = format!("{loss:?} at {lost:?}, delay {delay}, update {k}");
                    first_difference(found, expected, &context);
                }
            }
        }
    }
}

/// The global tilt is the natural guide star's business: the commands do not know it.
#[test]
fn commands_do_not_know_the_global_tilt() {
    let without = closed_loop(0, &[Loss::None; 8], None);
    for delay in [0, 2] {
        let with = closed_loop(delay, &[Loss::None; 8], Some([70_000, -50_000]));
        assert_eq!(with, without, "delay {delay}");
    }
}
