//! Requests about configurations: what is done to the other bank, what is asked of the running one.

use crate::{Link, Outbox, Pieces};
use embedded_storage::nor_flash::NorFlash;
use splash_firmware::banks::{BankError, Banks, Draft};
use splash_firmware::config::Config;
use splash_firmware::image::ImageError;
use splash_firmware::link::{PIECE, Reason, Request, Response};
use splash_firmware::mirror::Serials;
use splash_firmware::store::Store;

/// Does to the other bank what is asked, and returns the answer; `None` for a request about something
/// else.
pub fn draft<const M: usize, const P: usize, const B: usize, const K: usize>(
    draft: &mut Draft<'_, M, P, B, K>,
    request: &Request,
) -> Option<Response> {
    let done = match request {
        Request::Upload { bytes } => draft.begin(*bytes),
        Request::Chunk { offset, bytes } => draft.chunk(*offset, bytes).map(|_| ()),
        Request::Adjust(adjustment) => draft.adjust(adjustment),
        Request::Check => draft.check().map(|_| ()),
        Request::Switch => draft.switch().map(|_| ()),
        Request::Discard => {
            draft.discard();
            Ok(())
        }
        _ => return None,
    };
    Some(match done {
        Ok(()) => Response::Draft(draft.state()),
        Err(error) => Response::Refused(error.into()),
    })
}

/// Takes an image of `length` bytes into the other bank.
///
/// # Errors
/// A [`BankError`]; the bank is then empty.
pub fn load<T: Link, const M: usize, const P: usize, const B: usize, const K: usize>(
    draft: &mut Draft<'_, M, P, B, K>,
    pieces: &mut Pieces<'_, T>,
    length: u32,
) -> Result<(), BankError> {
    draft.begin(length)?;
    let mut due = 0;
    while due < length {
        let mut piece = [0; PIECE];
        let room = PIECE.min(length.saturating_sub(due) as usize);
        let bytes = piece.get_mut(..room).unwrap_or_default();
        if !pieces.fill(bytes) {
            draft.discard();
            return Err(BankError::Image(ImageError::Cut));
        }
        due = draft.chunk(due, bytes)?;
    }
    Ok(())
}

/// Tells of the running configuration what is asked; `None` for a request about something else.
pub fn running<const M: usize, const P: usize, const B: usize, const K: usize>(
    config: &Config<M, P, B, K>,
    request: &Request,
) -> Option<Response> {
    Some(match request {
        Request::Get(parameter) => match config.value(*parameter) {
            Ok(value) => Response::Value(value),
            Err(error) => Response::Refused(error.into()),
        },
        Request::Calibration => match config.calibration() {
            Ok(calibration) => Response::Calibration(calibration),
            Err(error) => Response::Refused(error.into()),
        },
        _ => return None,
    })
}

/// Whether a frame has this row and column.
///
/// # Errors
/// [`Reason::Place`] with the one that it lacks.
pub fn find_pixel<const M: usize, const P: usize, const B: usize, const K: usize>(
    config: &Config<M, P, B, K>,
    row: u16,
    column: u16,
) -> Result<(), Reason> {
    for (found, entries) in [(row, config.height()), (column, config.width())] {
        if found >= entries {
            return Err(Reason::Place { found: found.into(), entries: entries.into() });
        }
    }
    Ok(())
}

/// Raw pixels as [`Response::Pixels`] has them, of row `row` from column `first` on: as many as there is
/// room for. `rows` are those from `start` on, of `width` pixels; `None` if there are none of it.
#[must_use]
pub fn raw_pixels(
    (row, first): (usize, usize),
    rows: &[u16],
    start: usize,
    width: usize,
) -> Option<heapless::Vec<u8, PIECE>> {
    let row = rows.chunks(width.max(1)).nth(row.checked_sub(start)?)?;
    let pixels = row.get(first..).filter(|pixels| !pixels.is_empty())?;
    let mut bytes = heapless::Vec::new();
    for byte in pixels.iter().take(PIECE / 2).flat_map(|pixel| pixel.to_le_bytes()) {
        let _ = bytes.push(byte);
    }
    Some(bytes)
}

/// Sends bytes of the running configuration's image. `Ready` behind them is left to the caller.
///
/// # Errors
/// If the link has ended.
pub fn read_back<T: Link, const M: usize, const P: usize, const B: usize, const K: usize>(
    config: &Config<M, P, B, K>,
    out: &mut Outbox<'_, T>,
    offset: u32,
    bytes: u32,
) -> Result<(), T::Error> {
    let mut piece = heapless::Vec::<u8, PIECE>::new();
    let mut next = 0u32;
    let mut sent = Ok(());
    let range = offset..offset.saturating_add(bytes);
    let mut send = |piece: &mut heapless::Vec<u8, PIECE>, end: u32| {
        if sent.is_ok() && !piece.is_empty() {
            let bytes = core::mem::take(piece);
            let offset = end.wrapping_sub(bytes.len() as u32);
            sent = out.send(Response::Image { offset, bytes });
        }
    };
    config.save(&mut |bytes| {
        for &byte in bytes {
            if range.contains(&next) {
                // There is room: a full piece is sent at once.
                let _ = piece.push(byte);
                if piece.is_full() {
                    send(&mut piece, next.wrapping_add(1));
                }
            }
            next = next.wrapping_add(1);
        }
    });
    send(&mut piece, next.min(range.end));
    sent
}

/// Stores, or loads what is stored into the other bank; `None` for a request about something else.
/// `serials`: of the hardware that is there, or why nothing may be stored now.
pub fn stored<F: NorFlash, const M: usize, const P: usize, const B: usize, const K: usize>(
    flash: Option<F>,
    banks: &mut Banks<'_, M, P, B, K>,
    request: &Request,
    serials: Result<Serials, Reason>,
) -> Option<Response> {
    if !matches!(request, Request::Store | Request::Stored | Request::Restore) {
        return None;
    }
    let Some(flash) = flash else { return Some(Response::Refused(Reason::Unsupported)) };
    let mut store = Store::new(flash);
    let answer = match request {
        Request::Store => serials.and_then(|serials| {
            let stored = store.store(banks.running(), serials)?;
            Ok(Response::Stored(Some(stored)))
        }),
        Request::Stored => store.newest_stored().map(Response::Stored).map_err(Reason::from),
        _ => banks.draft.restore(&mut store).map(|_| Response::Draft(banks.draft.state())),
    };
    Some(answer.unwrap_or_else(Response::Refused))
}
