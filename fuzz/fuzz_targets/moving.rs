//! See [`lk_core_fuzz::moving`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::moving::Case| lk_core_fuzz::moving::check(&case));
