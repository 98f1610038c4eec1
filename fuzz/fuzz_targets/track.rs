//! See [`lk_core_fuzz::track`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::track::Case| lk_core_fuzz::track::check(&case));
