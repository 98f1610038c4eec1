//! The bodies of the fuzz targets over random bytes, on a stable toolchain: `cargo test --release` in this folder.
//!
//! Cases that were kept in `seeds/` come first (`.ci/fuzz_seeds.py` finds them). `FUZZ_CASES` sets how many random ones each
//! target sees, 0 for none, `FUZZ_SEED` which; `FUZZ_SECONDS` lets each go on for so long instead.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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

/// Until when every target may go on, in seconds of a whole run of the tests; without FUZZ_SECONDS, FUZZ_CASES count.
fn ends() -> Option<Instant> {
    let seconds = setting("FUZZ_SECONDS", 0);
    (seconds > 0).then(|| Instant::now() + Duration::from_secs_f64(seconds as f64))
}

/// The cases that were kept because they once found something, or reach what random bytes seldom do.
fn kept(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("seeds")
        .join(target);
    let files = std::fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<PathBuf> = files.map(|file| file.expect("a file").path()).collect();
    paths.sort();
    let read = |path: PathBuf| {
        let bytes = std::fs::read(&path).expect("a kept case");
        (path.display().to_string(), bytes)
    };
    paths.into_iter().map(read).collect()
}

fn run<C: for<'a> Arbitrary<'a> + std::fmt::Debug>(target: &str, check: fn(&C)) {
    let once = |name: &str, bytes: &[u8]| {
        let Ok(case) = C::arbitrary_take_rest(Unstructured::new(bytes)) else {
            return;
        };
        // Printed where the test fails: FUZZ_SEED with FUZZ_CASES=1 runs this case alone.
        println!("{name}: {case:?}");
        check(&case);
    };
    let seeds = kept(target);
    assert!(
        !seeds.is_empty(),
        "{target}: no case is kept in seeds/{target}"
    );
    for (name, bytes) in seeds {
        once(&name, &bytes);
    }
    let (first, ends) = (setting("FUZZ_SEED", 1), ends());
    let cases = setting("FUZZ_CASES", 400);
    for seed in first.. {
        let done = ends.map_or(seed - first >= cases, |end| Instant::now() >= end);
        if done {
            break;
        }
        once(&format!("seed {seed}"), &bytes(seed, 512));
    }
}

macro_rules! targets {
    ($($target:ident),*) => {
        $(
            #[test]
            fn $target() {
                run(stringify!($target), lk_core_fuzz::$target::check);
            }
        )*
    };
}

targets!(
    shift, track, stream, dense, corners, pyramid, grid, moving, plane
);
