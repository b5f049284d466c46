//! The store on the flash controller's registers: a model that is as strict as the manual says, and that can
//! lose its power between any two steps.

use crate::rig::{Bank, bank, bank_of, instrument};
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use splash_firmware::mirror::Serials;
use splash_firmware::store::{Store, StoreError};
use splash_tests::instrument::Values;
use stm32h743_logic::flash::{Flash, FlashError, Registers, SECTOR, SECTORS, WORD};

/// Bank 2.
#[derive(Clone)]
pub(crate) struct Cells {
    bytes: Vec<u8>,
    /// Words whose writing was cut short.
    broken: Vec<bool>,
    open: bool,
    failed: bool,
    /// How often it is still busy.
    busy: u32,
    /// Steps until the power goes.
    power: usize,
}

impl Cells {
    /// As it left the factory.
    pub(crate) fn new() -> Self {
        let bytes = vec![0xff; SECTORS * SECTOR];
        let broken = vec![false; bytes.len() / WORD];
        Self { bytes, broken, open: false, failed: false, busy: 0, power: usize::MAX }
    }

    /// Whether a step is done; the one in which the power goes is done by half.
    fn step(&mut self) -> Step {
        assert!(self.open && self.busy == 0, "a change while locked or busy");
        self.busy = 3;
        let left = self.power;
        self.power = left.saturating_sub(1);
        match left {
            0 => Step::Nothing,
            1 => Step::Half,
            _ => Step::Done,
        }
    }
}

#[derive(PartialEq)]
enum Step {
    Done,
    Half,
    Nothing,
}

impl Registers for &mut Cells {
    fn read(&mut self, offset: u32, bytes: &mut [u8]) {
        let first = offset as usize;
        assert_eq!(self.busy, 0);
        bytes.copy_from_slice(&self.bytes[first..first + bytes.len()]);
        let words = first / WORD..(first + bytes.len()).div_ceil(WORD);
        if self.broken[words].contains(&true) {
            bytes.fill(0);
        }
    }

    fn unlock(&mut self) {
        (self.open, self.failed) = (true, false);
    }

    fn erase(&mut self, sector: u8) {
        let step = self.step();
        let first = usize::from(sector) * SECTOR;
        // Cut short, the first half is erased and the rest cannot be read.
        let whole = first..first + SECTOR;
        if step != Step::Nothing {
            self.bytes[whole.clone()].fill(0xff);
            for word in whole.clone().step_by(WORD) {
                self.broken[word / WORD] = step == Step::Half && word >= first + SECTOR / 2;
            }
        }
    }

    fn program(&mut self, offset: u32, word: &[u8; WORD]) {
        let step = self.step();
        let first = offset as usize;
        assert_eq!(first % WORD, 0);
        let place = &mut self.bytes[first..first + WORD];
        if place.iter().any(|&byte| byte != 0xff) {
            self.failed = true;
        } else if step != Step::Nothing {
            place.copy_from_slice(word);
            self.broken[first / WORD] = step == Step::Half;
        }
    }

    fn busy(&mut self) -> bool {
        self.busy = self.busy.saturating_sub(1);
        self.busy > 0
    }

    fn lock(&mut self) -> bool {
        self.open = false;
        !self.failed && self.power > 0
    }
}

#[test]
fn only_whole_words_and_sectors_inside_the_two_are_changed() {
    let mut cells = Cells::new();
    let mut flash = Flash::new(&mut cells);
    assert_eq!(flash.capacity(), 256 << 10);
    assert_eq!(flash.write(32, &[7; 64]), Ok(()));
    assert_eq!(flash.write(64, &[7; 32]), Err(FlashError::Refused), "written twice");
    assert_eq!(flash.write(16, &[7; 32]), Err(FlashError::Place));
    assert_eq!(flash.write(0, &[7; 31]), Err(FlashError::Place));
    assert_eq!(flash.erase(0, 1024), Err(FlashError::Place));
    assert_eq!(flash.write(256 << 10, &[7; 32]), Err(FlashError::Place));
    let mut read = [0; 3];
    assert_eq!(flash.read((256 << 10) - 2, &mut read), Err(FlashError::Place));
    assert_eq!(flash.read(31, &mut read), Ok(()));
    assert_eq!(read, [0xff, 7, 7]);
    assert_eq!(flash.erase(0, 128 << 10), Ok(()));
    assert_eq!(flash.read(31, &mut read), Ok(()));
    assert_eq!(read, [0xff; 3]);
    assert!(!cells.open, "locked after each change");
}

#[test]
fn a_power_cut_at_any_step_leaves_the_old_or_the_new_configuration() {
    let old = bank();
    let mut other = instrument();
    other.control_gain = Values::Uniform(0.25);
    let new = bank_of(&other);
    let mut before = Cells::new();
    Store::new(Flash::new(&mut before)).store(old, Serials::default()).expect("stored");
    let mut after = before.clone();
    after.power = 1_000_000;
    Store::new(Flash::new(&mut after)).store(new, Serials::default()).expect("stored");
    let steps = 1_000_000 - after.power;
    assert!(steps > 100, "an erase, and a word each: {steps}");
    let cuts = (0..=steps + 1).filter(|cut| *cut < 5 || cut % 31 == 0 || *cut + 5 > steps);
    let mut kept = [0; 2];
    for cut in cuts {
        let mut cells = Cells { power: cut, ..before.clone() };
        let stored = Store::new(Flash::new(&mut cells)).store(new, Serials::default());
        assert_eq!(stored.is_err(), cut <= steps, "{cut}");
        cells.power = usize::MAX;
        let mut config = Box::new(Bank::new());
        let restored = Store::new(Flash::new(&mut cells)).restore(&mut *config);
        let hash =
            restored.unwrap_or_else(|error: StoreError<FlashError>| panic!("{cut}: {error}")).hash;
        assert!([old.hash(), new.hash()].contains(&hash), "{cut}");
        assert_eq!(config.hash(), hash);
        kept[usize::from(hash == new.hash())] += 1;
    }
    assert!(kept[0] > 10 && kept[1] > 0, "{kept:?}");
}
