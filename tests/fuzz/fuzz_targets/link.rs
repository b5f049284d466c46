//! `splash_tests::fuzz`, target `link`, under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| splash_tests::fuzz::target("link")(bytes));
