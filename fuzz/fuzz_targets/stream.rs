//! See [`lk_core_fuzz::stream`].
#![no_main]

libfuzzer_sys::fuzz_target!(|case: lk_core_fuzz::stream::Case| lk_core_fuzz::stream::check(&case));
