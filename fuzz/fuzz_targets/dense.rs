//! See [`lk_core_fuzz::dense`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::dense::Case| lk_core_fuzz::dense::check(&case));
