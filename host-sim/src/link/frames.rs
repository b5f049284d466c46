//! The requests of a board whose frames come from here, and what each leaves.

use super::client::{Client, unexpected};
use super::transport::{Failure, Transport};
use crate::board::Frame;
use splash_firmware::centroid::Measurement;
use splash_firmware::link::{Identity, LIST, List, PIECE, Reason, Request, Response};
use splash_firmware::pipeline::{Report, Totals};
use splash_firmware::segments::Position;
use splash_firmware::slopes::Slope;

/// Version of the firmware library, which this and every board are made with.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The requests that bring an image into a board's other bank.
pub(crate) fn upload(image: &[u8]) -> impl Iterator<Item = Request> + '_ {
    let chunks = image.chunks(PIECE).enumerate().map(|(i, piece)| Request::Chunk {
        offset: (i * PIECE) as u32,
        bytes: piece.iter().copied().collect(),
    });
    std::iter::once(Request::Upload { bytes: image.len() as u32 }).chain(chunks)
}

/// What the board last said of itself.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// DAC codes of each segment's actuators.
    pub codes: Vec<[u16; 3]>,
    /// Measurements of the last frame: of all windows, the second gate's behind the others.
    pub measurements: Vec<Measurement>,
    /// Slopes of the last frame, in the same order.
    pub slopes: Vec<Slope>,
    /// Positions of the segments.
    pub positions: Vec<Position>,
    /// What went wrong so far.
    pub totals: Totals,
}

impl<T: Transport> Client<T> {
    /// What the board says it is.
    ///
    /// # Errors
    /// [`Failure`], also for a board of another version.
    pub fn identify(&mut self) -> Result<Identity, Failure> {
        match self.ask(Request::Identify)? {
            Response::Identity(identity) if identity.version == VERSION => Ok(identity),
            Response::Identity(Identity { version, .. }) => Err(Failure::Answer(format!(
                "version {version} of the firmware: must be {VERSION}"
            ))),
            other => Err(unexpected(&other)),
        }
    }

    /// Loads an image, and returns why the board does not take it.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn load(&mut self, image: &[u8]) -> Result<Result<(), Reason>, Failure> {
        let deadline = self.deadline();
        let bytes = image.len() as u32;
        self.request(Request::Load { bytes }, deadline)?;
        for (i, piece) in image.chunks(PIECE).enumerate() {
            let offset = (i * PIECE) as u32;
            let bytes = piece.iter().copied().collect();
            self.send(Request::Piece { offset, bytes }, deadline)?;
        }
        match self.answer(deadline)? {
            Response::Ready => Ok(Ok(())),
            Response::Refused(reason) => Ok(Err(reason)),
            other => Err(unexpected(&other)),
        }
    }

    /// Flattens the mirror of `subapertures` segments; what there was of measurements is gone.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn reset(&mut self, subapertures: usize) -> Result<State, Failure> {
        let deadline = self.deadline();
        self.request(Request::Reset, deadline)?;
        let mut state = State::default();
        loop {
            match self.answer(deadline)? {
                Response::Ready => break,
                other => state.take(other)?,
            }
        }
        state.measurements.resize(subapertures, Measurement::default());
        state.slopes.resize(subapertures, Slope::default());
        state.positions.resize(subapertures, Position::default());
        state.check(subapertures)?;
        Ok(state)
    }

    /// Has a frame done, and returns its report, or why it was refused. `state` is what the frame left,
    /// of `subapertures` segments if that is known.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn frame(
        &mut self,
        number: u32,
        frame: Frame<'_>,
        subapertures: Option<usize>,
        state: &mut State,
    ) -> Result<Result<Report, Reason>, Failure> {
        let deadline = self.deadline();
        match frame {
            Frame::Pixels(pixels) => {
                let count = pixels.len() as u32;
                self.request(Request::Frame { number, pixels: count }, deadline)?;
                if let Some(detector) = self.transport().detector() {
                    detector.pixels(pixels, deadline)?;
                }
            }
            Frame::Measurements(measurements) => {
                let count = measurements.len() as u32;
                // Pieces are not answered: they go before the request, under a number of their own.
                let pieces = measurements.chunks(LIST).enumerate().map(|(i, items)| {
                    let first = (i * LIST) as u16;
                    Request::Measurements { first, items: items.iter().copied().collect() }
                });
                for piece in pieces {
                    self.request(piece, deadline)?;
                }
                self.request(Request::MeasuredFrame { number, count }, deadline)?;
            }
        }
        let totals = state.totals;
        *state = State { totals, ..State::default() };
        loop {
            match self.answer(deadline)? {
                Response::Refused(reason) => return Ok(Err(reason)),
                Response::Report(report) if report.frame == number => {
                    state.check(subapertures.unwrap_or(state.codes.len()))?;
                    return Ok(Ok(report));
                }
                other => state.take(other)?,
            }
        }
    }
}

impl State {
    /// Takes a piece of the state.
    fn take(&mut self, response: Response) -> Result<(), Failure> {
        match response {
            Response::Codes { first, items } => append("codes", &mut self.codes, first, &items),
            Response::Measurements { first, items } => {
                append("measurements", &mut self.measurements, first, &items)
            }
            Response::Slopes { first, items } => append("slopes", &mut self.slopes, first, &items),
            Response::Positions { first, items } => {
                append("positions", &mut self.positions, first, &items)
            }
            Response::Totals(totals) => {
                self.totals = totals;
                Ok(())
            }
            other => Err(unexpected(&other)),
        }
    }

    /// Whether all of it came.
    fn check(&self, subapertures: usize) -> Result<(), Failure> {
        // With a second gate there are two windows a subaperture.
        let both = self.measurements.len() == 2 * subapertures;
        let windows = if both { 2 * subapertures } else { subapertures };
        let lists = [
            ("codes", self.codes.len(), subapertures),
            ("measurements", self.measurements.len(), windows),
            ("slopes", self.slopes.len(), windows),
            ("positions", self.positions.len(), subapertures),
        ];
        match lists.into_iter().find(|(_, found, due)| found != due) {
            Some((what, found, due)) => {
                Err(Failure::Answer(format!("{found} {what}: must be {due}")))
            }
            None => Ok(()),
        }
    }
}

fn append<T: Copy>(
    what: &str,
    all: &mut Vec<T>,
    first: u16,
    items: &List<T>,
) -> Result<(), Failure> {
    if usize::from(first) != all.len() {
        let due = all.len();
        return Err(Failure::Answer(format!("{what} from {first} on: must be from {due}")));
    }
    all.extend_from_slice(items);
    Ok(())
}
