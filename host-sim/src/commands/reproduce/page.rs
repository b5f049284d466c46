//! The page: pictures and tables with what they say, as far as the data of this run says it.

use super::html;
use crate::commands::campaign::{Campaign, Task};
use crate::commands::strehl::budget::{BudgetResult, in_words, with_error};
use crate::commands::strehl::results::{PairResult, StrehlResult, style};
use crate::commands::theory::TheoryResult;
use crate::error::Error;
use crate::instrument::LeverArm;
use crate::monte_carlo::budget::{Step, lever_arm_rad2};
use crate::monte_carlo::comparator::Comparator;
use crate::monte_carlo::point::Conditions;
use crate::monte_carlo::statistics::Mean;
use std::fmt::Write;
use std::path::Path;

const STYLE: &str = include_str!("page.css");
/// A difference is told from zero beyond this many standard errors.
const APART: f64 = 3.0;

/// What a difference and its standard error say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Above,
    Below,
    Undecided,
}

impl Verdict {
    fn of(difference: f64, se: f64) -> Self {
        match difference {
            d if d > APART * se => Self::Above,
            d if d < -APART * se => Self::Below,
            // As well where the error is not known.
            _ => Self::Undecided,
        }
    }
}

/// Everything that the page is about.
struct Data<'a> {
    directory: &'a Path,
    campaign: &'a Campaign,
    theory: &'a TheoryResult,
    strehl: &'a StrehlResult,
    files: &'a [&'static str],
}

/// The page of a campaign that has run; its pictures are read from `directory`.
///
/// # Errors
/// [`Error::Run`] if a picture cannot be read.
pub(super) fn page(
    directory: &Path,
    campaign: &Campaign,
    theory: &TheoryResult,
    strehl: &StrehlResult,
    files: &[&'static str],
) -> Result<String, Error> {
    let data = Data { directory, campaign, theory, strehl, files };
    let mut body = introduction(&data);
    body += &sensing(&data)?;
    body += &ratios(&data)?;
    body += &budget(&data)?;
    body += &differences(&data);
    body += &parameters(&data)?;
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>SPLASH: the paper's figures, reproduced</title>\n<style>\n{STYLE}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n"
    ))
}

fn introduction(data: &Data<'_>) -> String {
    format!(
        "<h1>SPLASH: the paper's figures, reproduced</h1>\n\
         <p>Butterley, Love, Wilson, Myers and Morris (2006), <cite>A Shack-Hartmann wavefront sensor \
         projected onto the sky with reduced focal anisoplanatism</cite>, compare SPLASH with a \
         conventional laser guide star (LGS) twice: by equations (section 3), and in a closed loop \
         (section 4). This page has both comparisons, computed by host-sim {}, and what the residual \
         wavefront is made of. In the loop, images of the spots go through the firmware library that runs \
         on the controller. {}.</p>\n\
         <p>Error bars, and digits in brackets, are one standard error from the scatter of the screens. \
         Differences are taken screen by screen, all sensors under the same screens, and called \
         different from zero beyond {APART} standard errors.</p>\n",
        env!("CARGO_PKG_VERSION"),
        html::text(&capital(&format!(
            "{}, {}",
            data.campaign.screens(),
            data.campaign.conditions()
        ))),
    )
}

/// Section 3.
fn sensing(data: &Data<'_>) -> Result<String, Error> {
    let mut out = "<h2>What each sensor can sense (section 3)</h2>\n".to_string();
    let arrays: Vec<String> =
        data.theory.arrays.iter().map(|array| format!("N = {}", array.n)).collect();
    let beta = data.theory.arrays.first().and_then(|array| array.beta).unwrap_or(f64::NAN);
    out += &html::figure(
        &data.picture("sensed.svg")?,
        &format!(
            "Residual variance of each radial order as a fraction of what the sensor would measure without \
             focal anisoplanatism. {}, one turbulent layer at beta = 1 - h/H = {beta}, Kolmogorov \
             turbulence without outer scale, no noise, nothing of the way down. Exact: there are no \
             error bars. Black as in the paper; blue with the lever arm of the high layer, \
             which its analysis leaves out.",
            html::list(&arrays)
        ),
    );
    for array in &data.theory.arrays {
        let residuals = &array.residuals;
        let _ = writeln!(
            out,
            "<p>N = {}, radial orders {} to {}: SPLASH leaves {} of what it senses, an LGS {}; with \
             the lever arm, {} and {}.</p>",
            array.n,
            residuals.orders.first().unwrap_or(&0),
            residuals.orders.last().unwrap_or(&0),
            range(&residuals.splash.sensed),
            range(&residuals.lgs.sensed),
            range(&residuals.splash_lever.sensed),
            range(&residuals.lgs_lever.sensed),
        );
    }
    out += &html::figure(
        &data.picture("total.svg")?,
        "The same as a fraction of the wavefront's variance. What higher orders alias into the fit counts \
         here; the natural guide star (NGS) has nothing else.",
    );
    let heads =
        ["N", "order", "SPLASH", "LGS", "SPLASH, lever arm", "LGS, lever arm", "NGS, total"];
    let mut rows = Vec::new();
    for array in &data.theory.arrays {
        let r = &array.residuals;
        for (k, order) in r.orders.iter().enumerate() {
            let mut row = vec![array.n.to_string(), order.to_string()];
            let columns = [&r.splash.sensed, &r.lgs.sensed, &r.splash_lever.sensed]
                .into_iter()
                .chain([&r.lgs_lever.sensed, &r.ngs.total]);
            row.extend(columns.map(|column| format!("{:.5}", column[k])));
            rows.push(row);
        }
    }
    let all = html::links(&["residuals.csv"]);
    let caption =
        format!("Fractions of the sensed variance, but for the last column: {all} has all.");
    out += &html::table(&caption, &heads.map(String::from), &rows);
    Ok(out)
}

/// Section 4.
fn ratios(data: &Data<'_>) -> Result<String, Error> {
    let mut out = "<h2>Strehl ratio against D/r0 (section 4)</h2>\n".to_string();
    out += &html::figure(
        &data.picture("strehl.svg")?,
        &format!(
            "On-axis Strehl ratio, |&lt;exp(i phi)&gt;|² over the pupil with tip and tilt removed. {}. \
             N = D/r0 subapertures across, piston, tip and tilt segments; fit is the best that they can do, \
             whatever the sensor. The paper has SPLASH and LGS.",
            html::text(&capital(&format!(
                "{}, {}",
                data.campaign.screens(),
                data.campaign.conditions()
            )))
        ),
    );
    let mut heads: Vec<String> = ["D/r0", "screens"].map(String::from).into();
    heads.extend(data.campaign.comparators.iter().map(|c| name(*c).to_string()));
    heads.push("SPLASH - LGS".into());
    let each = data.strehl.points.chunks(data.campaign.comparators.len());
    let rows: Vec<Vec<String>> = each
        .zip(&data.campaign.tasks)
        .map(|(points, task)| {
            let mut row = vec![ratio(task), task.finished.len().to_string()];
            row.extend(points.iter().map(|point| with_error(point.strehl, point.strehl_se)));
            row.extend(data.advantage(task).map(|pair| signed(pair.difference, pair.se)));
            row
        })
        .collect();
    let files = html::links(&["strehl.csv", "paired.csv", "screens.csv"]);
    out += &html::table(&format!("Strehl ratios: {files}."), &heads, &rows);
    Ok(out)
}

/// What the residual is made of.
fn budget(data: &Data<'_>) -> Result<String, Error> {
    let mut out = "<h2>Error budget</h2>\n".to_string();
    out += &html::figure(
        &data.picture("budget.svg")?,
        "Residual variance of the star's phase. Each effect is switched on in turn under the same screens, \
         from the bottom up; a term is what it adds. Terms below zero undo part of another. The ring is the \
         run itself, with its error.",
    );
    out += "<p>Fitting: piston, tip and tilt of each segment fitted to the star's phase. Aliasing: exact \
            gradients of the star's phase in its place. Cone: gradients over what the light of a beacon \
            crosses, a smaller square above each subaperture for SPLASH, a smaller pupil for an LGS. Lever \
            arm: a gradient at height h counts times 1 - h/H. Return path: less the mean gradient between \
            spot and whole pupil. Temporal: the loop in time, nothing under a sky that stands still once \
            it has settled. Quantisation: through the firmware, to DAC codes. Images: spots on a \
            detector in place of exact gradients.</p>\n";
    for &comparator in &data.campaign.comparators {
        let of_sensor: Vec<_> =
            data.strehl.budget.iter().filter(|b| b.sensor == comparator.name()).collect();
        let Some(first) = of_sensor.first() else { continue };
        let mut heads = vec!["D/r0".to_string()];
        heads.extend(first.terms.iter().map(|term| in_words(term.term).to_string()));
        heads.extend(["sum", "run"].map(String::from));
        let row = |(budget, task): (&&BudgetResult, &Task)| {
            let mut row = vec![ratio(task)];
            let terms = budget.terms.iter();
            row.extend(terms.map(|term| with_error(term.variance_rad2, term.se)));
            row.push(format!("{:.4}", budget.sum_rad2));
            row.push(with_error(budget.run_rad2, budget.run_se));
            row
        };
        let rows: Vec<_> = of_sensor.iter().zip(&data.campaign.tasks).map(row).collect();
        let caption = format!("{}, rad²: {}.", name(comparator), html::links(&["budget.csv"]));
        out += &html::table(&caption, &heads, &rows);
    }
    Ok(out)
}

/// Where this run and the paper's text part.
fn differences(data: &Data<'_>) -> String {
    let mut out = "<h2>Where this differs from the paper's text</h2>\n".to_string();
    out += &advantage(data);
    out += &lever_arm(data);
    out += &by_order(data);
    out += &speckle(data);
    out += SLIPS;
    out
}

/// Is SPLASH better everywhere?
fn advantage(data: &Data<'_>) -> String {
    let mut out =
        "<h3>SPLASH against the LGS</h3>\n<blockquote>SPLASH performs considerably better than a \
                   conventional LGS system across the whole range of simulated values. (Section \
                   4)</blockquote>\n<p>"
            .to_string();
    let tasks = &data.campaign.tasks;
    let pairs = || tasks.iter().filter_map(|task| Some((task, data.advantage(task)?)));
    let those = |verdict: Verdict| -> Vec<String> {
        let ours = pairs().filter(|(_, p)| Verdict::of(p.difference, p.se) == verdict);
        let words = |(task, p): (&Task, &PairResult)| {
            format!("{} ({})", ratio(task), signed(p.difference, p.se))
        };
        ours.map(words).collect()
    };
    for (verdict, words) in [
        (Verdict::Above, "the Strehl ratio of SPLASH is above the LGS's"),
        (Verdict::Undecided, "the two cannot be told apart"),
        (Verdict::Below, "the Strehl ratio of SPLASH is below the LGS's"),
    ] {
        let those = those(verdict);
        if !those.is_empty() {
            let _ = write!(out, "In this run {words} at D/r0 = {}. ", html::list(&those));
        }
    }
    out += "(The text does not list the values that it simulates.)</p>\n";
    let row = |task: &Task| {
        let [splash, lgs] = beacon(task)?;
        let difference = Mean::of_differences(&splash, &lgs);
        let cells = [Mean::of(&splash), Mean::of(&lgs)];
        let mut row = vec![ratio(task)];
        row.extend(cells.map(|cell| with_error(cell.mean, cell.standard_error)));
        row.push(signed(difference.mean, difference.standard_error));
        Some(row)
    };
    let rows: Vec<_> = tasks.iter().filter_map(row).collect();
    if !rows.is_empty() {
        let caption = "What a beacon adds, rad²: cone, lever arm and return path together. Fitting and \
                       aliasing are the same for both. The cone of an LGS takes in the whole pupil, SPLASH's \
                       only each subaperture; the return path is SPLASH's own.";
        let heads = ["D/r0", "SPLASH", "LGS", "SPLASH - LGS"].map(String::from);
        out += &html::table(caption, &heads, &rows);
    }
    out
}

/// What a beacon adds to SPLASH's variance and to an LGS's, screen by screen; `None` without high layers.
fn beacon(task: &Task) -> Option<[Vec<f64>; 2]> {
    let cost = |comparator: Comparator, last: Step| {
        let chain = task.chain(comparator);
        let of = |step| chain.iter().find(|(other, _)| *other == step).map(|(_, values)| values);
        let (with, without) = (of(last)?, of(Step::Aliasing)?);
        Some(with.iter().zip(without).map(|(with, without)| with - without).collect())
    };
    Some([cost(Comparator::Splash, Step::ReturnPath)?, cost(Comparator::Lgs, Step::LeverArm)?])
}

/// Is it only bandwidth?
fn lever_arm(data: &Data<'_>) -> String {
    let mut out = "<h3>Lever arm</h3>\n<blockquote>This is not expected to be a significant problem for closed \
                   loop operation, especially for a sodium LGS system, although it will have the effect of \
                   slightly reducing the system bandwidth. (Section 2.2)</blockquote>\n\
                   <p>The loop drives to zero what the sensor sees. Of a high layer it sees 1 - h/H, and \
                   with the mirror at the ground it sees all of the mirror: at its null, h/H of that layer \
                   is still there, however long the loop has had. It is no matter of bandwidth: here \
                   nothing moves.</p>\n"
        .to_string();
    let instrument = data.campaign.tasks[0].point.instrument();
    let plain = instrument.control.lever_arm == LeverArm::Factor(1.0);
    let mut heads: Vec<String> = ["D/r0", "SPLASH", "LGS"].map(String::from).into();
    if plain {
        heads.push("0.134 (D/r0)^(5/3) sum w (h/H)^2".into());
    }
    let mut apart = Vec::new();
    let row = |task: &Task| {
        let mut row = vec![ratio(task)];
        for comparator in [Comparator::Splash, Comparator::Lgs] {
            let term = data.budget(task, comparator)?.term(Step::LeverArm)?;
            row.push(with_error(term.variance_rad2, term.se));
            let verdict = Verdict::of(term.variance_rad2, term.se);
            if comparator == Comparator::Splash && verdict == Verdict::Above {
                apart.push(ratio(task));
            }
        }
        if plain {
            row.push(format!("{:.4}", lever_arm_rad2(instrument, task.diameter_in_r0())));
        }
        Some(row)
    };
    let rows: Vec<Vec<String>> = data.campaign.tasks.iter().filter_map(row).collect();
    if rows.is_empty() {
        return out + "<p>This run has no layer above the ground.</p>\n";
    }
    let caption = "The lever arm's term, rad². It depends on the cone before it: an LGS sees the layer \
                   magnified, and gradients taken whole are then too steep, which a term below zero takes \
                   back. The last column is a circular pupil whose every mode is corrected.";
    let caption = if plain { caption } else { "The lever arm's term, rad²." };
    out += &html::table(caption, &heads, &rows);
    if !apart.is_empty() {
        let list = html::list(&apart);
        let _ = write!(out, "<p>SPLASH's is told from zero at D/r0 = {list}. ");
        out += "A gain on the measured tilts, <code>lever_arm</code> in <code>[control]</code>, makes up for \
                part of it.</p>\n";
    }
    out
}

/// Is SPLASH's fraction the same in all orders?
fn by_order(data: &Data<'_>) -> String {
    let mut out = "<h3>Radial orders</h3>\n<blockquote>The fractional residual variance in each mode [...] is \
                   roughly constant at each spatial scale for SPLASH, whereas the effect of FA on a \
                   conventional LGS becomes more severe as the spatial frequency of the aberrations \
                   increases. (Section 3)</blockquote>\n"
        .to_string();
    for array in &data.theory.arrays {
        let residuals = &array.residuals;
        let _ = writeln!(
            out,
            "<p>N = {}: without the lever arm SPLASH's fraction goes from {} here, with it from {}.</p>",
            array.n,
            range(&residuals.splash.sensed),
            range(&residuals.splash_lever.sensed),
        );
    }
    out
}

/// The least and the largest fraction, in words.
fn range(fractions: &[f64]) -> String {
    let least = fractions.iter().copied().fold(f64::INFINITY, f64::min);
    let most = fractions.iter().copied().fold(0.0, f64::max);
    format!("{:.1} % to {:.1} %", 100.0 * least, 100.0 * most)
}

/// Do the speckles of the return path matter?
fn speckle(data: &Data<'_>) -> String {
    let mut out =
        "<h3>Speckle on the return path</h3>\n<blockquote>As D/r0 increases further, the residual \
                   wavefront error will worsen and centroid anisoplanatism become more noticeable. \
                   (Section 4)</blockquote>\n"
            .to_string();
    let row = |task: &Task| {
        let of = |comparator| data.budget(task, comparator)?.term(Step::Images);
        let terms = [of(Comparator::Splash)?, of(Comparator::Lgs)?, of(Comparator::Ngs)?];
        let mut row = vec![ratio(task)];
        row.extend(terms.map(|term| signed(term.variance_rad2, term.se)));
        Some(row)
    };
    let rows: Vec<_> = data.campaign.tasks.iter().filter_map(row).collect();
    let heads = ["D/r0", "SPLASH", "LGS", "NGS"].map(String::from);
    let caption = "The images' term, rad²: diffraction, speckle, windows and threshold together. Only \
                   SPLASH's images are made through the whole pupil.";
    out += &html::table(caption, &heads, &rows);
    out
}

/// Of use to whoever recomputes section 3.
const SLIPS: &str = "<h3>For those who recompute section 3</h3>\n\
<p>As printed, some equations do not give the figure. Here:</p>\n<ul>\n\
<li>Gradients are in rad of phase per pupil radius; the (lambda/2 pi)² of angles cancels with \
pi D/lambda.</li>\n\
<li>The factor before a covariance of gradients is 1/(2 A_i A_l) with the areas of the two squares, d² or \
(beta d)², not 1/(2 d²).</li>\n\
<li>In I'' the subapertures of SPLASH keep their separation: (u + x)/(beta d), not (u + beta x)/(beta d), \
which is an LGS's.</li>\n\
<li>For an LGS, G' is a function of r_i - beta r_l, and G'' of beta (r_i - r_l).</li>\n\
<li>C' = D^-1 G' (D'^-1)^T: the first factor belongs to b, the second to b'. An LGS has D^-1 for both, \
as its D' would extrapolate from a smaller disc.</li>\n\
<li>g is a mean over the subaperture, and W = 1/pi in the coefficients a_j.</li>\n\
<li>The paper's a = b is used in every term, &lt;(b - b')²&gt;/&lt;b²&gt;: with &lt;a²&gt; in \
place of &lt;b²&gt; fractions can be negative.</li>\n\
<li>Tip and tilt are fitted and then left out; radial orders up to 7 and 10 are fitted for N = 8 \
and 12.</li>\n</ul>\n";

fn parameters(data: &Data<'_>) -> Result<String, Error> {
    let point = &data.campaign.tasks[0].point;
    let instrument = point.instrument();
    let (Conditions { frames, seed, .. }, settle) = (point.conditions(), point.settle());
    let across: Vec<String> = data.campaign.tasks.iter().map(|t| t.point.n().to_string()).collect();
    let total: f64 = instrument.atmosphere.layers.iter().map(|layer| layer.weight).sum();
    let layers = instrument.atmosphere.layers.iter().map(|layer| {
        let beta = 1.0 - layer.height_m / instrument.laser.beacon_height_m;
        let share = 100.0 * layer.weight / total;
        format!("{share:.0} % at {:.0} m (beta = {})", layer.height_m, (beta * 1e4).round() / 1e4)
    });
    let layers = html::list(&layers.collect::<Vec<_>>());
    let mut out = "<h2>Parameters and files</h2>\n".to_string();
    let rows = [
        ["seed", &seed.to_string()],
        ["screens", &data.campaign.screens()],
        ["N", &across.join(", ")],
        ["frames of a loop", &format!("{frames} averaged after {settle} to settle")],
        ["r0", &format!("{} m", instrument.r0_m())],
        ["subaperture", &format!("{} m", instrument.telescope.pitch_m)],
        ["turbulence", &layers],
        ["beacon", &format!("{:.0} m", instrument.laser.beacon_height_m)],
        [
            "windows of images",
            &format!(
                "{0} x {0} pixels of lambda/{1}d, {2} samples per subaperture",
                instrument.windows.size,
                instrument.windows.pixels_per_lambda_d,
                instrument.telescope.samples
            ),
        ],
        [
            "laser, science",
            &format!(
                "{:.0} nm, {:.0} nm",
                1e9 * instrument.laser.wavelength_m,
                1e9 * instrument.science.wavelength_m
            ),
        ],
        [
            "control",
            &format!(
                "gain {}, lever_arm {}",
                instrument.control.gain, instrument.control.lever_arm
            ),
        ],
    ];
    let rows: Vec<Vec<String>> = rows.iter().map(|row| row.map(String::from).into()).collect();
    out += &html::table("Section 4 and the budget.", &["", "value"].map(String::from), &rows);
    let _ = writeln!(out, "<p>Files: {}.</p>", html::links(data.files));
    let _ = writeln!(
        out,
        "<details><summary>The instrument for N = {}</summary><pre>{}</pre></details>",
        point.n(),
        html::text(&instrument.to_toml()?)
    );
    Ok(out)
}

impl Data<'_> {
    fn picture(&self, file: &str) -> Result<String, Error> {
        let path = self.directory.join(file);
        std::fs::read_to_string(&path)
            .map_err(|error| Error::Run(format!("{}: {error}", path.display())))
    }

    /// SPLASH - LGS.
    fn advantage(&self, task: &Task) -> Option<&PairResult> {
        let ours = |p: &&PairResult| p.n == task.point.n() && (p.a, p.b) == ("splash", "lgs");
        self.strehl.paired.iter().find(ours)
    }

    fn budget(&self, task: &Task, comparator: Comparator) -> Option<&BudgetResult> {
        let ours = |b: &&BudgetResult| b.n == task.point.n() && b.sensor == comparator.name();
        self.strehl.budget.iter().find(ours)
    }
}

fn name(comparator: Comparator) -> &'static str {
    style(comparator).0
}

/// D/r0 in at most two decimals.
fn ratio(task: &Task) -> String {
    ((task.diameter_in_r0() * 100.0).round() / 100.0).to_string()
}

fn signed(value: f64, se: f64) -> String {
    let words = with_error(value, se);
    if value > 0.0 { format!("+{words}") } else { words }
}

fn capital(words: &str) -> String {
    let mut characters = words.chars();
    characters.next().map_or(String::new(), |c| c.to_uppercase().chain(characters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three standard errors, on either side; a single screen says nothing.
    #[test]
    fn verdicts() {
        assert_eq!(Verdict::of(0.31, 0.1), Verdict::Above);
        assert_eq!(Verdict::of(0.29, 0.1), Verdict::Undecided);
        assert_eq!(Verdict::of(-0.29, 0.1), Verdict::Undecided);
        assert_eq!(Verdict::of(-0.31, 0.1), Verdict::Below);
        assert_eq!(Verdict::of(5.0, f64::NAN), Verdict::Undecided);
    }
}
