//! What the fuzz targets check: the fast code against plain f64 where there is a definition to compare with, and else
//! the properties that hold for any frames: same bits for every thread count, CPU level and memory layout; an answer or
//! NaN with a reason; exactly zero between equal frames; near the truth where the frames are a scene that moved.
//!
//! Each target is a `Case` and a function `check` that panics at a fault; `tests/seeded.rs` runs the same over random
//! bytes on a stable toolchain.

pub mod corners;
pub mod dense;
pub mod frames;
pub mod grid;
pub mod moving;
pub mod plane;
pub mod pyramid;
pub mod shift;
pub mod stream;
pub mod track;

use lk_core::{Execution, SimdLevel};

/// Call a function that is generic over the pixel type with the one that a case asks for.
macro_rules! by_depth {
    ($depth:expr, $check:ident($case:expr)) => {
        match $depth {
            $crate::frames::Depth::Byte => $check::<u8>($case),
            $crate::frames::Depth::Deep => $check::<u16>($case),
            $crate::frames::Depth::Float => $check::<f32>($case),
        }
    };
}
use by_depth;

/// One thread and the plainest instructions: what every other way to run is held to.
fn plain() -> Execution {
    Execution::default().threads(1).level(SimdLevel::Baseline)
}

/// Other ways to run: every CPU level, and more threads than this machine may have.
fn others() -> impl Iterator<Item = Execution> {
    let levels = SimdLevel::available().into_iter();
    levels
        .zip([1, 2, 7].into_iter().cycle())
        .map(|(level, threads)| Execution::default().threads(threads).level(level))
}
