//! `detect_corners`, its responses held to their definition in f64.

use arbitrary::Arbitrary;
use lk_core::{Corner, CornerOptions, Execution, detect_corners};
use ndarray::Array2;

use crate::frames::{Frames, Grey, covered, mask};
use crate::{by_depth, others, plain};

/// A frame and options.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    max_corners: u8,
    quality: f32,
    min_distance: f32,
    block_size: u8,
    harris: Option<f32>,
    mask: Option<u16>,
}

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (frame, _) = case.frames.pair::<T>();
    let mask = mask(case.frames.size(), case.mask);
    let block = usize::from(case.block_size % 12);
    let options = |execution: Execution| {
        CornerOptions::default()
            .max_corners(usize::from(case.max_corners))
            .quality(case.quality)
            .min_distance(case.min_distance)
            .block_size(block)
            .harris(case.harris)
            .execution(execution)
    };
    let view = mask.as_ref().map(|mask| mask.view());
    let corners = detect_corners(frame.view(), view, &options(plain()));
    assert_eq!(
        corners.is_ok(),
        options(plain()).validate().is_ok(),
        "{:?}",
        corners.err()
    );
    let Ok(corners) = corners else { return };
    for execution in others() {
        assert_eq!(
            bits(&detect_corners(frame.view(), view, &options(execution)).unwrap()),
            bits(&corners)
        );
    }
    let rows = frame.rows();
    assert_eq!(
        bits(&detect_corners(rows.view(), view, &options(plain())).unwrap()),
        bits(&corners)
    );
    for seed in [1, 2] {
        let other = covered(&rows, mask.as_ref(), seed);
        assert_eq!(
            bits(&detect_corners(other.view(), view, &options(plain())).unwrap()),
            bits(&corners),
            "masked pixels count"
        );
    }
    if case.max_corners > 0 {
        assert!(corners.len() <= usize::from(case.max_corners));
    }
    assert!(corners.is_sorted_by(|a, b| a.response >= b.response));
    for (number, corner) in corners.iter().enumerate() {
        let [x, y] = corner.position;
        assert!(
            mask.as_ref()
                .is_none_or(|mask| mask[(y as usize, x as usize)])
        );
        for other in &corners[..number] {
            let apart = f64::from(other.position[0] - x).hypot(f64::from(other.position[1] - y));
            assert!(
                apart >= f64::from(case.min_distance) * (1.0 - 1e-6),
                "{other:?} and {corner:?}"
            );
        }
    }
    let greys = rows.mapv(|grey| f64::from(grey.to_f32()));
    // Beyond this the squares of squares leave `f32`; what is not finite has no response.
    if case.harris.is_none() && greys.iter().all(|grey| grey.abs() < 1e6) {
        for corner in &corners {
            // Beside masked pixels a response is made of fewer gradients.
            if mask
                .as_ref()
                .is_none_or(|mask| is_whole(mask, block, corner))
            {
                as_defined(&greys, block, corner);
            }
        }
    }
}

/// Whether all pixels count that the response of a corner is made of.
fn is_whole(mask: &Array2<bool>, block: usize, corner: &Corner) -> bool {
    let (height, width) = mask.dim();
    let (x, y) = (corner.position[0] as isize, corner.position[1] as isize);
    let reach = block as isize / 2 + 1;
    (-reach..=reach)
        .all(|j| (-reach..=reach).all(|i| mask[(mirror(y + j, height), mirror(x + i, width))]))
}

/// The smaller eigenvalue of the mean structure tensor of Sobel's gradients, in f64.
fn as_defined(greys: &Array2<f64>, block: usize, corner: &Corner) {
    let (height, width) = greys.dim();
    let (x, y) = (corner.position[0] as isize, corner.position[1] as isize);
    let at = |y: isize, x: isize| greys[(mirror(y, height), mirror(x, width))];
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for j in 0..block as isize {
        for i in 0..block as isize {
            let row = mirror(y + j - block as isize / 2, height) as isize;
            let column = mirror(x + i - block as isize / 2, width) as isize;
            let (mut gx, mut gy) = (0.0, 0.0);
            for (step, weight) in [(-1, 1.0), (0, 2.0), (1, 1.0)] {
                gx += weight * (at(row + step, column + 1) - at(row + step, column - 1)) / 8.0;
                gy += weight * (at(row + 1, column + step) - at(row - 1, column + step)) / 8.0;
            }
            (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
        }
    }
    let count = (block * block) as f64;
    let (xx, xy, yy) = (xx / count, xy / count, yy / count);
    let want = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
    // The two terms nearly cancel where the window has one direction only: their rounding remains.
    let error = (f64::from(corner.response) - want).abs();
    assert!(
        error <= 1e-5 * (xx + yy) + 1e-6,
        "{corner:?}, defined as {want}"
    );
}

/// Mirrored without repeating the edge.
fn mirror(index: isize, size: usize) -> usize {
    let last = size as isize - 1;
    let mut index = index;
    while index < 0 || index > last {
        index = if index < 0 { -index } else { 2 * last - index };
    }
    index as usize
}

fn bits(corners: &[Corner]) -> Vec<[u32; 3]> {
    corners
        .iter()
        .map(|corner| {
            [
                corner.position[0].to_bits(),
                corner.position[1].to_bits(),
                corner.response.to_bits(),
            ]
        })
        .collect()
}
