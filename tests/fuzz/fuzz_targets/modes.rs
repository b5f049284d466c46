//! `splash_tests::fuzz`, target `modes`, under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| splash_tests::fuzz::target("modes")(bytes));
