//! See [`lk_core_fuzz::shift`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::shift::Case| lk_core_fuzz::shift::check(&case));
