//! One digest a stage of the pipeline.

use splash_firmware::pipeline::{Hold, Outcome, Pipeline, Progress, Report, RowError, Totals};

use crate::digest::{Digest, Hasher};

/// What a case shows, in the order in which a frame meets it: the first that differs is the cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    Measurements,
    Slopes,
    Commands,
    Positions,
    Codes,
    /// Progress, reports and totals.
    Reports,
}

use Stage::{Codes, Commands, Measurements, Positions, Reports, Slopes};

/// All of them.
pub(crate) const ALL: &[Stage] = &[Measurements, Slopes, Commands, Positions, Codes, Reports];

impl Stage {
    /// As it is in a line.
    const fn name(self) -> &'static str {
        match self {
            Measurements => "measurements",
            Slopes => "slopes",
            Commands => "commands",
            Positions => "positions",
            Codes => "codes",
            Reports => "reports",
        }
    }
}

/// The digests of one case, being made.
#[derive(Default)]
pub(crate) struct Stages([Hasher; ALL.len()]);

impl Stages {
    /// Adds all that can be read after a frame.
    pub(crate) fn frame<const M: usize, const B: usize, const K: usize>(
        &mut self,
        pipeline: &Pipeline<M, B, K>,
        report: &Report,
    ) {
        let [measurements, slopes, commands, positions, codes, reports] = &mut self.0;
        let second = pipeline.second_measurements();
        for measurement in pipeline.measurements().iter().chain(second) {
            measurement.centroid_q16.into_iter().for_each(|c| measurements.i32(c));
            measurements.u32(measurement.flux);
            measurements.u16(measurement.peak);
            measurements.u16(measurement.saturated);
        }
        for slope in pipeline.slopes().iter().chain(pipeline.second_slopes()) {
            slope.tilt_ulp.into_iter().for_each(|tilt| slopes.i32(tilt));
            slopes.u16(slope.valid.into());
        }
        pipeline.commands().as_flattened().iter().for_each(|&command| commands.i32(command));
        for position in pipeline.positions() {
            positions.i32(position.piston_ulp);
            position.tilt_ulp.into_iter().for_each(|tilt| positions.i32(tilt));
        }
        pipeline.codes().as_flattened().iter().for_each(|&code| codes.u16(code));
        add_report(reports, report);
    }

    /// Adds what became of a row or of a list of measurements.
    pub(crate) fn pushed(&mut self, result: Result<Progress, RowError>) {
        let [.., reports] = &mut self.0;
        match result {
            Ok(Progress::More) => reports.u32(0),
            Ok(Progress::Complete) => reports.u32(1),
            Err(RowError::NotBegun) => reports.u32(2),
            Err(RowError::Extra) => reports.u32(3),
            Err(RowError::Length { found, expected }) => {
                [4, found, expected.into()].into_iter().for_each(|value| reports.u32(value));
            }
        }
    }

    /// Adds the totals, and hands over each of the stages in `shown` with its digest.
    pub(crate) fn finish(
        mut self,
        totals: Totals,
        shown: &[Stage],
        mut each: impl FnMut(&'static str, Digest),
    ) {
        let [.., reports] = &mut self.0;
        add_totals(reports, totals);
        for (stage, hasher) in ALL.iter().zip(self.0).filter(|(stage, _)| shown.contains(stage)) {
            each(stage.name(), hasher.finish());
        }
    }
}

fn add_report(reports: &mut Hasher, report: &Report) {
    let outcome = match report.outcome {
        Outcome::Updated => [0, 0],
        Outcome::Held(Hold::NotBegun) => [1, 0],
        Outcome::Held(Hold::CutShort { rows }) => [2, rows],
        Outcome::Held(Hold::WrongRow) => [3, 0],
        Outcome::Held(Hold::NoLight) => [4, 0],
        Outcome::Held(Hold::NotConfigured) => [5, 0],
        Outcome::Held(Hold::Poor) => [6, 0],
        Outcome::Held(Hold::Mode) => [7, 0],
    };
    outcome.into_iter().for_each(|value| reports.u16(value));
    let Report { valid, saturated_actuators, slewed_actuators, extra_rows, .. } = *report;
    [valid, saturated_actuators, slewed_actuators, extra_rows]
        .into_iter()
        .for_each(|value| reports.u16(value));
    reports.u32(report.frame);
    reports.u32(report.saturated_pixels);
    reports.u64(report.residual_squared);
    reports.u16(report.restarted.into());
    reports.u16(report.global_tilt_age.is_some().into());
    reports.u32(report.global_tilt_age.unwrap_or(0));
    reports.u16(report.global_tilt_stale.into());
}

fn add_totals(reports: &mut Hasher, totals: Totals) {
    let Totals {
        updated,
        cut_short,
        wrong_row,
        no_light,
        not_ready,
        restarted,
        extra_rows,
        stale_tilt,
        saturated_actuators,
        slewed_actuators,
    } = totals;
    let held = [cut_short, wrong_row, no_light, not_ready];
    let others = [restarted, extra_rows, stale_tilt, saturated_actuators, slewed_actuators];
    [updated].into_iter().chain(held).chain(others).for_each(|total| reports.u32(total));
}
