//! `track_points`.

use arbitrary::Arbitrary;
use lk_core::{
    Deformation, Execution, Illumination, Masks, PointStatus, TrackOptions, TrackedPoint,
    track_points,
};

use crate::frames::{Frames, Grey, covered, mask};
use crate::shift::light;
use crate::{by_depth, others, plain};

/// Frames, points and options.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    /// In 1/64 px from the corner at (-8, -8), and a few that are anything.
    points: Vec<(u16, u16)>,
    anywhere: Vec<(f32, f32)>,
    guessed: bool,
    mask: Option<u16>,
    next_mask: Option<u16>,
    window: (u8, u8),
    levels: Option<u8>,
    max_displacement: Option<f32>,
    iterations: u8,
    illumination: u8,
    deformation: u8,
    no_check_back: bool,
}

/// A point further from the truth than this is a lie if it is called tracked.
const FARTHEST_PX: f64 = 1.0;

/// More points than this only take time.
const MOST: usize = 32;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (prev, next) = case.frames.pair::<T>();
    let masks = [case.mask, case.next_mask].map(|seed| mask(case.frames.size(), seed));
    let [mask, next_mask] = &masks;
    let masks = || {
        let [prev, next] = [mask, next_mask];
        Masks::default()
            .prev(prev.as_ref().map(|mask| mask.view()))
            .next(next.as_ref().map(|mask| mask.view()))
    };
    let near = case.points.iter().map(|(x, y)| {
        [
            f32::from(x % 7168) / 64.0 - 8.0,
            f32::from(y % 7168) / 64.0 - 8.0,
        ]
    });
    let points: Vec<[f32; 2]> = near
        .chain(case.anywhere.iter().map(|(x, y)| [*x, *y]))
        .take(MOST)
        .collect();
    let (window_x, window_y) = (
        usize::from(case.window.0 % 66),
        usize::from(case.window.1 % 66),
    );
    let options = |execution: Execution| {
        let mut options = TrackOptions::default()
            .window_size(window_x, window_y)
            .levels(case.levels.map(|levels| usize::from(levels % 8)))
            .max_displacement(case.max_displacement)
            .max_iterations(usize::from(case.iterations % 40))
            .illumination(light(case.illumination))
            .deformation(match case.deformation % 3 {
                0 => Deformation::Auto,
                1 => Deformation::None,
                _ => Deformation::Affine,
            })
            .execution(execution);
        if case.no_check_back {
            options = options.max_forward_backward(None);
        }
        options
    };
    let guesses = case.guessed.then_some(points.as_slice());
    let run = |execution| {
        track_points(
            prev.view(),
            next.view(),
            &points,
            guesses,
            masks(),
            &options(execution),
        )
    };
    let allowed = options(plain()).validate().is_ok();
    let tracks = run(plain());
    assert_eq!(tracks.is_ok(), allowed, "{:?}", tracks.err());
    let Ok(tracks) = tracks else { return };
    assert_eq!(tracks.len(), points.len());
    tracks.iter().for_each(meaning);
    for execution in others() {
        assert_eq!(bits(&run(execution).unwrap()), bits(&tracks));
    }
    let (rows_prev, rows_next) = (prev.rows(), next.rows());
    let rows = track_points(
        rows_prev.view(),
        rows_next.view(),
        &points,
        guesses,
        masks(),
        &options(plain()),
    );
    assert_eq!(bits(&rows.unwrap()), bits(&tracks));
    for seed in [1, 2] {
        let other = track_points(
            covered(&rows_prev, mask.as_ref(), seed).view(),
            covered(&rows_next, next_mask.as_ref(), seed + 7).view(),
            &points,
            guesses,
            masks(),
            &options(plain()),
        );
        assert_eq!(bits(&other.unwrap()), bits(&tracks), "masked pixels count");
    }
    near_the_truth(case, &points, &tracks, window_x.min(window_y));
}

/// Where the scene is large enough for its window and its motion, tracked points went where the scene went.
fn near_the_truth(case: &Case, points: &[[f32; 2]], tracks: &[TrackedPoint], window: usize) {
    let Some([dx, dy]) = case.frames.truth() else {
        return;
    };
    let (height, width) = case.frames.size();
    let lit = light(case.illumination) == Illumination::GainOffset;
    let checked = !case.no_check_back && case.iterations % 40 >= 10;
    if !lit || !checked || window < 11 || height.min(width) < 48 || dx.hypot(dy) > 6.0 {
        return;
    }
    for (point, track) in points
        .iter()
        .zip(tracks)
        .filter(|(_, track)| track.is_valid())
    {
        let error = (f64::from(track.position[0] - point[0]) - dx)
            .hypot(f64::from(track.position[1] - point[1]) - dy);
        assert!(
            error < FARTHEST_PX,
            "{track:?} from {point:?}, true ({dx}, {dy})"
        );
    }
}

/// An answer is whole, or it is NaN with infinite variance.
pub(crate) fn meaning(track: &TrackedPoint) {
    let [xx, xy, yy] = track.covariance;
    if track.is_valid() {
        assert!(
            track
                .position
                .iter()
                .chain(&track.covariance)
                .all(|value| value.is_finite()),
            "{track:?}"
        );
        assert!(
            xx >= 0.0 && yy >= 0.0 && xx * yy >= xy * xy * (1.0 - 1e-4),
            "{track:?}"
        );
    } else {
        assert!(track.status != PointStatus::New, "{track:?}");
        assert!(
            track.position.iter().all(|value| value.is_nan()),
            "{track:?}"
        );
        assert!(xx == f32::INFINITY && yy == f32::INFINITY, "{track:?}");
    }
}

pub(crate) fn bits(tracks: &[TrackedPoint]) -> Vec<[u32; 8]> {
    let one = |track: &TrackedPoint| {
        let [x, y] = track.position.map(f32::to_bits);
        let [xx, xy, yy] = track.covariance.map(f32::to_bits);
        [
            x,
            y,
            xx,
            xy,
            yy,
            track.residual.to_bits(),
            track.forward_backward.to_bits(),
            track.status as u32,
        ]
    };
    tracks.iter().map(one).collect()
}
