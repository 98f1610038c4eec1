//! How fast a camera travels over the ground: `cargo run --release --example velocity`.
//!
//! A camera flies over made ground at 0.6 m, 0.8 m/s to its right, while it rolls; a gyro tells the roll to 0.002 rad/s.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use lk_core::ndarray::Array2;
use lk_core::{Distortion, Execution, Lens, PlaneInterval, PlaneOptions, PlaneTracker, Result};

const HEIGHT_M: f64 = 0.6;
const SPEED_M_S: f64 = 0.8;
const RATE_RAD_S: f64 = 0.3;
const DT_S: f64 = 1.0 / 60.0;
const FOCAL_PX: f64 = 300.0;

/// The ground's grey level at a place, in metres.
fn ground(x: f64, y: f64) -> f64 {
    let wave = |a: f64, b: f64, c: f64| (a * x + b * y + c).sin();
    120.0
        + 25.0 * wave(90.0, 17.0, 0.3) * wave(-23.0, 71.0, 1.1)
        + 20.0 * wave(41.0, -130.0, 0.0)
        + 18.0 * wave(151.0, 66.0, 2.0)
        + 15.0 * wave(-60.0, 190.0, 0.7)
}

/// What the camera sees at a time: it moves along x and rolls about its axis.
fn picture(t_s: f64) -> Array2<u8> {
    let (sin, cos) = (RATE_RAD_S * t_s).sin_cos();
    // Its way in the ground's axes: to its own right, as it rolls.
    let (x0, y0) = (
        SPEED_M_S / RATE_RAD_S * sin,
        SPEED_M_S / RATE_RAD_S * (1.0 - cos),
    );
    Array2::from_shape_fn((240, 320), |(row, column)| {
        let (x, y) = (
            (column as f64 - 159.5) / FOCAL_PX,
            (row as f64 - 119.5) / FOCAL_PX,
        );
        let (x, y) = (
            HEIGHT_M * (cos * x - sin * y),
            HEIGHT_M * (sin * x + cos * y),
        );
        ground(x0 + x, y0 + y).round() as u8
    })
}

fn main() -> Result<()> {
    let lens = Lens::new([FOCAL_PX; 2], [159.5, 119.5], Distortion::Brown([0.0; 12]))?;
    let mut tracker = PlaneTracker::new(lens);
    let execution = Execution::default();
    tracker.push(picture(0.0).view(), None, &execution)?;
    let mut start = [0.0; 6];
    for frame in 1..=5 {
        let t_s = f64::from(frame) * DT_S;
        tracker.push(picture(t_s).view(), None, &execution)?;
        let interval = PlaneInterval::default().turn([0.0, 0.0, RATE_RAD_S * DT_S]);
        let options = PlaneOptions::default()
            .levels(4)
            .rotation_std([0.002 * DT_S; 3]);
        let Some(fit) = tracker.motion(&interval, &start, &options)? else {
            println!("{t_s:.3} s: the frames do not determine a motion");
            continue;
        };
        // A way in heights makes metres, and metres a second.
        let [vx, vy, vz] = [0, 1, 2].map(|axis| fit.motion[axis] * HEIGHT_M / DT_S);
        let tiles = fit.tiles.iter().filter(|tile| tile.weight > 0.0).count();
        println!("{t_s:.3} s: {vx:+.4} {vy:+.4} {vz:+.4} m/s from {tiles} tiles");
        start = [fit.motion[0], fit.motion[1], fit.motion[2], 0.0, 0.0, 0.0];
    }
    Ok(())
}
