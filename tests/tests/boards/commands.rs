//! The server in memory, under the orders of an operator.

use super::server::{Script, image};
use super::{frames, usual};
use splash_firmware::adjust::Adjustment;
use splash_firmware::banks::DraftState;
use splash_firmware::calibration::{Step, Uncalibrated};
use splash_firmware::controller::Command;
use splash_firmware::link::{Reason, Request, Response};
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::pipeline::{Hold, Outcome, Report};
use splash_firmware::segments::Position;
use splash_firmware::telemetry::{Decimation, Record};

/// The usual instrument's calibration, all steps done.
fn calibrated() -> Adjustment {
    let mut config = usual().config::<64, 4096, 0>();
    config.set_calibrated(&Step::ALL, 62_000);
    Adjustment::Calibration(config.calibration().ok())
}

/// Has a calibrated copy run from the next frame on.
fn calibrate(script: &mut Script) {
    script.ask(Request::Copy).ask(Request::Adjust(calibrated()));
    script.ask(Request::Check).ask(Request::Switch);
}

fn enter(mode: Mode) -> Request {
    Request::Command(Command::Enter(mode))
}

/// What was refused, and why.
fn refusals(responses: &[Response]) -> Vec<Reason> {
    let refused = |response: &Response| match response {
        Response::Refused(reason) => Some(*reason),
        _ => None,
    };
    responses.iter().filter_map(refused).collect()
}

fn reports(responses: &[Response]) -> Vec<Report> {
    let report = |response: &Response| match response {
        Response::Report(report) => Some(*report),
        _ => None,
    };
    responses.iter().filter_map(report).collect()
}

#[test]
fn the_loop_closes_by_the_operators_orders_alone() {
    let pixels = frames(&usual(), 4);
    let mut script = Script::default();
    script.ask(enter(Mode::Standby)).load(&image(&usual()));
    script.ask(enter(Mode::ClosedLoop)).ask(enter(Mode::Standby)).frame(0, &pixels[0]);
    script.ask(Request::Command(Command::Arm)).frame(1, &pixels[1]);
    script.ask(enter(Mode::ClosedLoop)).ask(Request::Calibration);
    calibrate(&mut script);
    script.frame(2, &pixels[2]).ask(Request::Calibration).ask(enter(Mode::ClosedLoop));
    script.ask(Request::Subscribe(Some(Decimation { frames: 1, ..Decimation::OFF })));
    script.frame(3, &pixels[3]).ask(Request::Store).ask(Request::Status);
    script.ask(Request::Transitions).ask(Request::Counters).ask(Request::Reset);
    script.ask(Request::Status);
    let (responses, actuated, _) = script.run();

    let expected = [
        Reason::Mode(Refusal::NotConfigured),
        Reason::Mode(Refusal::NoWay { from: Mode::Safe, to: Mode::ClosedLoop }),
        Reason::Mode(Refusal::NotCalibrated),
        Reason::Uncalibrated(Uncalibrated::Never),
        Reason::Mode(Refusal::WrongMode { mode: Mode::ClosedLoop }),
    ];
    assert_eq!(refusals(&responses), expected);
    let outcomes: Vec<Outcome> = reports(&responses).iter().map(|r| r.outcome).collect();
    let held = Outcome::Held(Hold::Mode);
    assert_eq!(outcomes, [held, held, held, Outcome::Updated]);
    assert!(actuated[0] == actuated[2], "nothing moves before the loop is closed");
    assert!(actuated[2] != actuated[3]);

    let statuses: Vec<_> = responses
        .iter()
        .filter_map(|response| match response {
            Response::Status(status) => Some(*status),
            _ => None,
        })
        .collect();
    let modes: Vec<Mode> = statuses.iter().map(|status| status.mode).collect();
    assert_eq!(modes, [Mode::ClosedLoop, Mode::Safe], "a bench is safe");
    assert!(statuses[0].outputs.laser && statuses[0].outputs.high_voltage);
    assert_eq!(statuses[0].at.frame, 3);
    // Four frames of ten pulses at 10 kHz, in ns.
    assert_eq!(statuses[0].at.ticks, 4_000_000);
    assert_eq!((statuses[0].draft, statuses[0].draft_refused), (DraftState::Open, None));

    let entered: Vec<Mode> = responses
        .iter()
        .filter_map(|response| match response {
            Response::Transitions { items, .. } => Some(items.iter().map(|t| t.to)),
            _ => None,
        })
        .flatten()
        .collect();
    assert_eq!(entered, [Mode::Standby, Mode::ClosedLoop]);
    let told = responses.iter().find_map(|response| match response {
        Response::Telemetry(Record::Frame(frame)) => Some(*frame),
        _ => None,
    });
    let told = told.expect("it was subscribed to");
    assert_eq!((told.result.mode, told.result.at.frame), (Mode::ClosedLoop, 3));
    assert_eq!(told.configuration, statuses[0].configuration);
    assert_eq!((told.result.gate.asked, told.result.gate.seen), (10, 10));
    let refused = responses.iter().find_map(|response| match response {
        Response::Counters(counters) => Some(counters.refused_transitions),
        _ => None,
    });
    // The loop that was not to be closed, twice; without a configuration there is no controller yet.
    assert!(refused >= Some(2), "{refused:?}");
}

#[test]
fn a_poke_moves_its_segment_and_no_other() {
    let pixels = frames(&usual(), 3);
    let poke = |subaperture| {
        let position = Position { piston_ulp: 1 << 14, tilt_ulp: [1 << 13, 0] };
        Request::Command(Command::Position { subaperture, position })
    };
    let mut script = Script::default();
    script.load(&image(&usual())).ask(poke(3)).ask(enter(Mode::Standby));
    script.ask(Request::Command(Command::Arm)).frame(0, &pixels[0]);
    script.ask(enter(Mode::TestPattern)).ask(poke(52)).frame(1, &pixels[1]);
    script.ask(poke(3)).frame(2, &pixels[2]);
    let (responses, actuated, _) = script.run();
    let expected = [
        Reason::Mode(Refusal::WrongMode { mode: Mode::Safe }),
        Reason::Mode(Refusal::NoSubaperture { subaperture: 52, subapertures: 52 }),
    ];
    assert_eq!(refusals(&responses), expected);
    let [before, after] = [&actuated[1], &actuated[2]];
    for (i, (before, after)) in before.iter().zip(after).enumerate() {
        assert_eq!(before != after, i == 3, "segment {i}");
    }
}

/// In a closed loop a configuration without a calibration is not taken, and the operator is told.
#[test]
fn the_controller_may_refuse_a_switch() {
    let pixels = frames(&usual(), 4);
    let mut script = Script::default();
    script.load(&image(&usual())).ask(enter(Mode::Standby));
    script.ask(Request::Command(Command::Arm));
    calibrate(&mut script);
    script.frame(0, &pixels[0]).ask(enter(Mode::ClosedLoop)).frame(1, &pixels[1]);
    script.ask(Request::Copy).ask(Request::Adjust(Adjustment::Calibration(None)));
    script.ask(Request::Check).ask(Request::Switch).frame(2, &pixels[2]).ask(Request::Status);
    let (responses, ..) = script.run();
    assert_eq!(refusals(&responses), []);
    let Some(Response::Status(status)) = responses.last() else { panic!("{responses:?}") };
    assert_eq!(status.draft_refused, Some(Refusal::NotCalibrated));
    assert!(matches!(status.draft, DraftState::Checked { .. }), "{:?}", status.draft);
    assert_eq!(status.mode, Mode::ClosedLoop);
    assert_eq!(reports(&responses)[2].outcome, Outcome::Updated, "by what ran before");
}
