//! `estimate_shift`.

use arbitrary::Arbitrary;
use lk_core::{
    Execution, Illumination, Masks, Roi, Shift, ShiftDeformation, ShiftOptions, ShiftStatus,
    estimate_shift,
};

use crate::frames::{Frames, Grey, covered, mask};
use crate::{by_depth, others, plain};

/// Frames and options.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    roi: Option<[u8; 4]>,
    masks: [Option<u16>; 2],
    deforms: bool,
    illumination: u8,
    max_displacement: Option<f32>,
}

/// An answer further from the truth than this is a lie if it is called valid.
const FARTHEST_PX: f64 = 0.5;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (prev, next) = case.frames.pair::<T>();
    let (height, width) = case.frames.size();
    let [mask, next_mask] = case.masks.map(|seed| mask((height, width), seed));
    let masks = Masks::default()
        .prev(mask.as_ref().map(|mask| mask.view()))
        .next(next_mask.as_ref().map(|mask| mask.view()));
    let options = |execution: Execution| {
        let mut options = ShiftOptions::default()
            .illumination(light(case.illumination))
            .deformation(if case.deforms {
                ShiftDeformation::Affine
            } else {
                ShiftDeformation::None
            })
            .execution(execution);
        if let Some([x, y, width, height]) = case.roi.map(|sides| sides.map(usize::from)) {
            options = options.roi(Roi {
                x,
                y,
                width,
                height,
            });
        }
        if let Some(pixels) = case.max_displacement {
            options = options.max_displacement(f64::from(pixels));
        }
        options
    };
    let run = |execution| estimate_shift(prev.view(), next.view(), masks, &options(execution));
    let allowed = options(plain()).validate(height, width).is_ok();
    let shift = run(plain());
    assert_eq!(shift.is_ok(), allowed, "{shift:?}");
    let Ok(shift) = shift else { return };
    meaning(&shift);
    for execution in others() {
        assert_eq!(bits(&run(execution).unwrap()), bits(&shift));
    }
    let (rows_prev, rows_next) = (prev.rows(), next.rows());
    let rows = estimate_shift(rows_prev.view(), rows_next.view(), masks, &options(plain()));
    assert_eq!(bits(&rows.unwrap()), bits(&shift));
    for seed in [1, 2] {
        let prev = covered(&rows_prev, mask.as_ref(), seed);
        let next = covered(&rows_next, next_mask.as_ref(), seed + 7);
        let other = estimate_shift(prev.view(), next.view(), masks, &options(plain()));
        assert_eq!(bits(&other.unwrap()), bits(&shift), "masked pixels count");
    }
    if case.frames.still() && shift.is_valid() && case.masks.iter().all(Option::is_none) {
        assert_eq!((shift.dx, shift.dy), (0.0, 0.0));
    }
    if let Some(limit) = case.max_displacement
        && shift.is_valid()
    {
        // The search is bounded, and the iteration after it may end a pixel further.
        assert!(
            shift.dx.abs().max(shift.dy.abs()) <= f64::from(limit) + 1.0,
            "{shift:?}"
        );
    }
    if let Some([dx, dy]) = case.frames.truth()
        && light(case.illumination) == Illumination::GainOffset
        && shift.is_valid()
    {
        assert!(
            (shift.dx - dx).hypot(shift.dy - dy) < FARTHEST_PX,
            "{shift:?}, true ({dx}, {dy})"
        );
    }
}

pub(crate) fn light(number: u8) -> Illumination {
    [
        Illumination::GainOffset,
        Illumination::Offset,
        Illumination::None,
    ][usize::from(number) % 3]
}

/// An answer is whole, or it is NaN with infinite variance.
fn meaning(shift: &Shift) {
    let [[xx, xy], [yx, yy]] = shift.covariance;
    let numbers = [shift.dx, shift.dy, shift.gain, shift.offset, shift.residual];
    if shift.is_valid() {
        assert!(
            numbers
                .iter()
                .chain([&xx, &xy, &yx, &yy])
                .all(|value| value.is_finite()),
            "{shift:?}"
        );
        assert!(
            xy == yx && xx >= 0.0 && yy >= 0.0 && xx * yy >= xy * xy * (1.0 - 1e-9),
            "{shift:?}"
        );
    } else if shift.status == ShiftStatus::Aperture && shift.direction[0].is_finite() {
        // One direction was measured: nothing is known along the other.
        assert!(numbers.iter().all(|value| value.is_finite()), "{shift:?}");
        assert!(xx == f64::INFINITY || yy == f64::INFINITY, "{shift:?}");
        assert!(shift.direction_variance >= 0.0, "{shift:?}");
        assert!(
            (shift.direction[0].hypot(shift.direction[1]) - 1.0).abs() < 1e-9,
            "{shift:?}"
        );
    } else {
        assert!(shift.dx.is_nan() && shift.dy.is_nan(), "{shift:?}");
        assert!(xx == f64::INFINITY && yy == f64::INFINITY, "{shift:?}");
    }
}

fn bits(shift: &Shift) -> Vec<u64> {
    let [[xx, xy], [yx, yy]] = shift.covariance;
    let numbers = [
        shift.dx,
        shift.dy,
        shift.gain,
        shift.offset,
        shift.residual,
        xx,
        xy,
        yx,
        yy,
    ];
    let mut bits = numbers.map(f64::to_bits).to_vec();
    bits.push(shift.status as u64);
    bits
}
