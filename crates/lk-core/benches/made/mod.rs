//! Made pictures and motion vectors, for the benchmarks.

use lk_core::MotionVector;
use ndarray::Array2;

/// Displacement of every pair, in pixels.
pub(crate) const SHIFT: (f64, f64) = (3.25, -1.5);

/// A scene with structure at several scales: plane waves of 6 to 60 pixels length.
fn scene(x: f64, y: f64) -> f64 {
    let mut state = 1_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31)
    };
    let mut level = 120.0;
    for _ in 0..24 {
        let frequency = 0.1 + 0.9 * random();
        let angle = std::f64::consts::TAU * random();
        let phase = std::f64::consts::TAU * random();
        level += (3.0 + 6.0 * random())
            * (frequency * (angle.cos() * x + angle.sin() * y) + phase).sin();
    }
    level
}

/// Two frames, the second displaced by [`SHIFT`].
pub(crate) fn pair(width: usize, height: usize) -> (Array2<u8>, Array2<u8>) {
    let frame = |dx: f64, dy: f64| {
        Array2::from_shape_fn((height, width), |(y, x)| {
            scene(x as f64 - dx, y as f64 - dy).round() as u8
        })
    };
    (frame(0.0, 0.0), frame(SHIFT.0, SHIFT.1))
}

/// Motion vectors of a camera that turns and travels, a tenth of them of boxes that are nearer.
pub(crate) fn vectors(columns: usize, rows: usize) -> Vec<MotionVector> {
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
    let vector = |(column, row): (usize, usize)| {
        let x = 640.0 * (column as f64 + 0.5) / columns as f64;
        let y = 480.0 * (row as f64 + 0.5) / rows as f64;
        let near = x % 200.0 < 64.0 && y % 160.0 < 50.0;
        let noise = |phase: f64| 0.1 * (12.9898 * x + 78.233 * y + phase).sin();
        MotionVector {
            x,
            y,
            u: if near { -6.0 } else { -4.0 } + noise(0.0),
            v: 0.01 * x + noise(1.0),
            covariance: [0.005, 0.0, 0.005],
        }
    };
    places.map(vector).collect()
}
