//! That the cases do what their names say; what comes out is for the golden file.

use splash_firmware::config::Config;
use splash_firmware::pipeline::{Pipeline, Totals};

use super::*;
use crate::maps::Maps;
use crate::play::{Source, play};
use crate::{BUFFER, MODES, PIXELS, WINDOWS};

/// What is left of a case: its totals, and what its last complete frame saw.
struct After {
    subject: &'static str,
    case: &'static str,
    totals: Totals,
    invalid: usize,
    saturated: u32,
}

fn run(subjects: &[Subject]) -> Vec<After> {
    let mut config = Box::new(Config::<WINDOWS, PIXELS, BUFFER, MODES>::new());
    let mut pipeline = Box::new(Pipeline::<WINDOWS, BUFFER, MODES>::new());
    let (mut maps, mut source) = (Box::new(Maps::new()), Box::new(Source::new()));
    let mut all = Vec::new();
    for Subject { instrument, cases, .. } in subjects {
        config.build(&instrument.spec(&mut maps).expect("a mask")).expect("a configuration");
        for case in *cases {
            play(case, instrument, &maps, &config, &mut pipeline, &mut source);
            let (slopes, seen) = (pipeline.slopes(), pipeline.measurements());
            all.push(After {
                subject: instrument.name,
                case: case.name,
                totals: pipeline.totals(),
                invalid: slopes.iter().filter(|slope| !slope.valid).count(),
                saturated: seen.iter().map(|m| u32::from(m.saturated)).sum(),
            });
        }
    }
    all
}

#[test]
fn events_happen_and_the_loop_goes_on() {
    let all = run(frames::SUBJECTS);
    let mut found = 0;
    for After { subject, case, totals, .. } in all {
        if case != "events" && case != "measured" {
            let Totals { updated, cut_short, wrong_row, no_light, not_ready, .. } = totals;
            assert_eq!([cut_short, wrong_row, no_light, not_ready], [0; 4], "{subject} {case}");
            assert!(updated >= 3, "{subject} {case}");
            continue;
        }
        found += 1;
        let Totals { updated, cut_short, wrong_row, no_light, not_ready, .. } = totals;
        // The reset after the first of fifteen frames forgets it; four were held.
        assert_eq!([cut_short, wrong_row, no_light, not_ready], [1; 4], "{subject} {case}");
        assert_eq!(updated, 10, "{subject} {case}");
        assert_eq!(totals.restarted, 1, "{subject} {case}");
        assert_eq!(totals.extra_rows, if case == "events" { 2 } else { 0 }, "{subject} {case}");
        // Given for frame 10, old after 12.
        assert_eq!(totals.stale_tilt, 2, "{subject} {case}");
    }
    assert_eq!(found, 7);
}

#[test]
fn lights_are_what_they_are_called() {
    let all = run(frames::SUBJECTS);
    for name in ["bright", "noisy", "dead", "saturated"] {
        assert!(all.iter().any(|after| after.case == name), "{name}");
    }
    for After { subject, case, invalid, saturated, .. } in all {
        let seen = (invalid > 0, saturated > 0);
        match case {
            "bright" => assert_eq!(seen, (false, false), "{subject} {case}"),
            "dead" => assert_eq!(seen, (true, false), "{subject} {case}"),
            "saturated" => assert_eq!(seen, (false, true), "{subject} {case}"),
            _ => (),
        }
    }
}

#[test]
fn segments_meet_their_limits() {
    for After { subject, case, totals, .. } in run(mirror::SUBJECTS) {
        if case == "beyond" {
            assert!(totals.saturated_actuators > 0, "{subject}");
        }
        let limited = subject.contains("slew") && case != "within";
        assert!(!limited || totals.slewed_actuators > 0, "{subject} {case}");
    }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<_> =
        SUBJECTS.iter().flat_map(|s| s.iter()).map(|s| s.instrument.name).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
}
