//! `dense_flow`, and the same pair through a `DenseFlow`.

use arbitrary::Arbitrary;
use lk_core::{
    DenseFlow, DenseHints, DenseOptions, Execution, FlowField, Illumination, Preset, dense_flow,
};
use ndarray::Array3;

use crate::frames::{Frames, Grey, mask};
use crate::shift::light;
use crate::{by_depth, others, plain};

/// Frames and options.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    preset: u8,
    illumination: u8,
    max_displacement: Option<f32>,
    masks: [Option<u16>; 2],
    initial: Option<(f32, f32)>,
}

/// Still pixels beside what a mask hides in one frame move by no more.
const STILL_PX: f32 = 0.5;
/// The median error of the valid pixels of a scene that moved stays below this.
const FARTHEST_PX: f64 = 0.5;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (prev, next) = case.frames.pair::<T>();
    let (height, width) = case.frames.size();
    let [mask, next_mask] = case.masks.map(|seed| mask((height, width), seed));
    let initial = case.initial.map(|(u, v)| {
        Array3::from_shape_fn((height, width, 2), |(_, x, axis)| {
            if axis == 0 { u } else { v * (x % 7) as f32 }
        })
    });
    let hints = DenseHints::default()
        .initial(initial.as_ref().map(|flow| flow.view()))
        .mask(mask.as_ref().map(|mask| mask.view()))
        .next_mask(next_mask.as_ref().map(|mask| mask.view()));
    let options = |execution: Execution| {
        DenseOptions::default()
            .preset(
                [
                    Preset::Ultrafast,
                    Preset::Fast,
                    Preset::Balanced,
                    Preset::Accurate,
                ][usize::from(case.preset) % 4],
            )
            .illumination(light(case.illumination))
            .max_displacement(case.max_displacement)
            .execution(execution)
    };
    let run = |execution| dense_flow(prev.view(), next.view(), hints, &options(execution));
    let allowed = options(plain()).validate().is_ok();
    let field = run(plain());
    assert_eq!(field.is_ok(), allowed, "{:?}", field.err());
    let Ok(field) = field else { return };
    assert_eq!((field.height(), field.width()), (height, width));
    meaning(&field);
    for (((keep, uv), valid), residual) in mask
        .iter()
        .flatten()
        .zip(field.uv().chunks_exact(2))
        .zip(field.valid())
        .zip(field.residual())
    {
        let unknown = uv.iter().all(|value| value.is_nan()) && residual.is_nan();
        assert!(
            *keep || unknown && !valid,
            "a masked pixel: {uv:?} {residual}"
        );
    }
    for execution in others() {
        same(&run(execution).unwrap(), &field);
    }
    let (rows_prev, rows_next) = (prev.rows(), next.rows());
    same(
        &dense_flow(rows_prev.view(), rows_next.view(), hints, &options(plain())).unwrap(),
        &field,
    );
    let mut stream = DenseFlow::new(options(plain())).unwrap();
    let mut streamed = FlowField::default();
    // What a mask hides reaches the pixels beside it unless the call that brings the frame has it.
    let first = DenseHints::default().next_mask(mask.as_ref().map(|mask| mask.view()));
    assert!(!stream.update(prev.view(), first, &mut streamed).unwrap());
    assert!(stream.update(next.view(), hints, &mut streamed).unwrap());
    same(&streamed, &field);
    if case.frames.still() && case.initial.is_none() {
        // A mask of one frame alone leaves what it hides in the other.
        let most = if case.masks.iter().any(Option::is_some) {
            STILL_PX
        } else {
            0.0
        };
        for (uv, valid) in field.uv().chunks_exact(2).zip(field.valid()) {
            let length = uv[0].hypot(uv[1]);
            assert!(
                length.is_nan() || length <= most || most > 0.0 && !valid,
                "{uv:?} of a still scene"
            );
        }
    }
    near_the_truth(case, &field);
}

fn near_the_truth(case: &Case, field: &FlowField) {
    let Some([dx, dy]) = case.frames.truth() else {
        return;
    };
    let lit = light(case.illumination) == Illumination::GainOffset;
    if !lit
        || case.initial.is_some()
        || case.masks.iter().any(Option::is_some)
        || field.height().min(field.width()) < 48
    {
        return;
    }
    if dx.hypot(dy) > 4.0
        || case
            .max_displacement
            .is_some_and(|most| f64::from(most) < dx.hypot(dy))
    {
        return;
    }
    let mut errors: Vec<f64> = field
        .uv()
        .chunks_exact(2)
        .zip(field.valid())
        .filter(|(_, valid)| **valid)
        .map(|(uv, _)| (f64::from(uv[0]) - dx).hypot(f64::from(uv[1]) - dy))
        .collect();
    errors.sort_by(f64::total_cmp);
    let share = errors.len() as f64 / field.valid().len() as f64;
    assert!(
        share > 0.3,
        "{share} valid of a scene that moved by ({dx}, {dy})"
    );
    assert!(
        errors[errors.len() / 2] < FARTHEST_PX,
        "{} px, true ({dx}, {dy})",
        errors[errors.len() / 2]
    );
}

/// A valid pixel has a motion and a residual.
fn meaning(field: &FlowField) {
    for ((uv, valid), residual) in field
        .uv()
        .chunks_exact(2)
        .zip(field.valid())
        .zip(field.residual())
    {
        assert!(
            uv[0].is_nan() == uv[1].is_nan() && !uv[0].is_infinite() && !uv[1].is_infinite(),
            "{uv:?}"
        );
        assert!(
            !valid || uv[0].is_finite() && residual.is_finite(),
            "{uv:?} {residual}"
        );
    }
}

pub(crate) fn same(got: &FlowField, want: &FlowField) {
    let bits = |values: &[f32]| {
        values
            .iter()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(got.uv()), bits(want.uv()));
    assert_eq!(bits(got.residual()), bits(want.residual()));
    assert_eq!(got.valid(), want.valid());
    let ((gain, offset, halvings), (want_gain, want_offset, want_halvings)) =
        (got.light(), want.light());
    assert_eq!(
        (bits(gain.data()), bits(offset.data())),
        (bits(want_gain.data()), bits(want_offset.data()))
    );
    assert_eq!(halvings, want_halvings);
}
