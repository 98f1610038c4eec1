//! See [`lk_core_fuzz::plane`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::plane::Case| lk_core_fuzz::plane::check(&case));
