//! See [`lk_core_fuzz::corners`].
#![no_main]

libfuzzer_sys::fuzz_target!(
    |case: lk_core_fuzz::corners::Case| lk_core_fuzz::corners::check(&case)
);
