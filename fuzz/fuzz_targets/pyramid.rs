//! See [`lk_core_fuzz::pyramid`].
#![no_main]

libfuzzer_sys::fuzz_target!(
    |case: lk_core_fuzz::pyramid::Case| lk_core_fuzz::pyramid::check(&case)
);
