//! The bodies of the fuzz targets over random bytes, on a stable toolchain: `cargo test --release` in this folder.
//!
//! `FUZZ_CASES` sets how many cases each target sees, `FUZZ_SEED` which.

use arbitrary::{Arbitrary, Unstructured};

fn setting(name: &str, usual: u64) -> u64 {
    std::env::var(name).map_or(usual, |text| text.parse().expect("a whole number"))
}

/// Random bytes: Marsaglia's xorshift.
fn bytes(mut state: u64, count: usize) -> Vec<u8> {
    state = state.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    (0..64).for_each(|_| {
        next();
    });
    (0..count).map(|_| next()).collect()
}

fn run<C: for<'a> Arbitrary<'a> + std::fmt::Debug>(check: fn(&C)) {
    let first = setting("FUZZ_SEED", 1);
    for seed in first..first + setting("FUZZ_CASES", 400) {
        let bytes = bytes(seed, 512);
        let case = C::arbitrary(&mut Unstructured::new(&bytes)).expect("a case from any bytes");
        // Printed where the test fails: FUZZ_SEED with FUZZ_CASES=1 runs this case alone.
        println!("seed {seed}: {case:?}");
        check(&case);
    }
}

#[test]
fn shift() {
    run(lk_core_fuzz::shift::check);
}

#[test]
fn track() {
    run(lk_core_fuzz::track::check);
}

#[test]
fn stream() {
    run(lk_core_fuzz::stream::check);
}

#[test]
fn dense() {
    run(lk_core_fuzz::dense::check);
}

#[test]
fn corners() {
    run(lk_core_fuzz::corners::check);
}

#[test]
fn pyramid() {
    run(lk_core_fuzz::pyramid::check);
}

#[test]
fn grid() {
    run(lk_core_fuzz::grid::check);
}
