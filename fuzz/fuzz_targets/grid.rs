//! See [`lk_core_fuzz::grid`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::grid::Case| lk_core_fuzz::grid::check(&case));
