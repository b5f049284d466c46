//! Why the board has started, as the fault that is booked for it.

use splash_firmware::fault::Fault;
use splash_firmware::last_words::Words;

/// The fault behind a start: `words` of the program before it, `watchdog` whether that ended it. None
/// for a start by power, by the reset pin or by a debug probe.
#[must_use]
pub const fn fault(words: Option<&Words>, watchdog: bool) -> Option<Fault> {
    match (words, watchdog) {
        // What ends with words is left to the watchdog, too.
        (Some(_), _) => Some(Fault::Crash),
        (None, true) => Some(Fault::Watchdog),
        (None, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splash_firmware::fault::Moment;
    use splash_firmware::last_words::{Cause, LastWords};
    use splash_firmware::mode::Mode;

    #[test]
    fn words_tell_more_than_the_watchdog() {
        let mut words = LastWords::new();
        words.say(Cause::Panic, Mode::Safe, Moment::default(), [0; 2], "index");
        let words = words.take();
        assert_eq!(fault(words.as_ref(), true), Some(Fault::Crash));
        assert_eq!(fault(words.as_ref(), false), Some(Fault::Crash));
        assert_eq!(fault(None, true), Some(Fault::Watchdog));
        assert_eq!(fault(None, false), None);
    }
}
