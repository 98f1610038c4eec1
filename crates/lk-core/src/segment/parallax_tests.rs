//! Parallax against exact vectors of a camera over boxes, and of pictures that are only moved.

use proptest::prelude::*;

use super::MotionVector;
use super::camera::{CameraModel, CameraMotion, fit_camera};
use super::camera_tests::{normal, random};
use super::parallax::{Parallax, find_parallax};

const FOCAL: f64 = 290.0;
/// Middles of boxes and of things that move, in pixels, each of 36 by 30 px.
const PLACES: [[f64; 2]; 12] = [
    [60.0, 50.0],
    [230.0, 60.0],
    [120.0, 190.0],
    [270.0, 180.0],
    [145.0, 50.0],
    [40.0, 120.0],
    [200.0, 200.0],
    [290.0, 115.0],
    [45.0, 200.0],
    [110.0, 115.0],
    [290.0, 30.0],
    [215.0, 130.0],
];
const MOVER: [f64; 2] = [163.0, 118.0];

/// A camera that looks down on a plane at distance 1, and goes this way from frame to frame.
#[derive(Clone)]
struct Scene {
    travel: [f64; 3],
    boxes: usize,
    height: f64,
    /// What moves by itself: where, and by how many pixels.
    movers: Vec<([f64; 2], [f64; 2])>,
    noise: f64,
}

fn inside(at: [f64; 2], middle: [f64; 2]) -> bool {
    (at[0] - middle[0]).abs() < 18.0 && (at[1] - middle[1]).abs() < 15.0
}

impl Scene {
    /// Of each vector whether it is of a mover, of a box, or of the plane.
    fn vectors(&self, state: &mut u64) -> Vec<(MotionVector, char)> {
        let mut out = Vec::new();
        for row in 0..40 {
            for column in 0..53 {
                let at = [3.0 + 6.0 * f64::from(column), 3.0 + 6.0 * f64::from(row)];
                let raised = PLACES[..self.boxes].iter().any(|place| inside(at, *place));
                let depth = if raised { 1.0 - self.height } else { 1.0 };
                let own = self.movers.iter().find(|(place, _)| inside(at, *place));
                let middle = [159.5, 119.5];
                let mut motion = [0, 1].map(|k: usize| {
                    let world = (at[k] - middle[k]) * depth - FOCAL * self.travel[k];
                    world / (depth - self.travel[2]) + middle[k] - at[k]
                        + self.noise * normal(state)
                });
                if let Some((_, own)) = own {
                    motion = [motion[0] + own[0], motion[1] + own[1]];
                }
                let kind = match (own, raised) {
                    (Some(_), _) => 'm',
                    (None, true) => 'b',
                    _ => 'p',
                };
                let variance = (self.noise * self.noise).max(1e-4);
                let vector = MotionVector {
                    x: at[0],
                    y: at[1],
                    u: motion[0],
                    v: motion[1],
                    covariance: [variance, 0.0, variance],
                };
                out.push((vector, kind));
            }
        }
        out
    }

    /// What is believed after a frame more, and the lengths of what depth does not explain, by kind.
    fn step(
        &self,
        before: Option<&Parallax>,
        state: &mut u64,
    ) -> (Option<Parallax>, Vec<(char, f64)>) {
        let kinds = self.vectors(state);
        let vectors: Vec<MotionVector> = kinds.iter().map(|(vector, _)| *vector).collect();
        let few: Vec<MotionVector> = vectors.iter().copied().step_by(5).collect();
        let camera = fit_camera(&few, None);
        let found = find_parallax(&vectors, &camera, before);
        let left = kinds
            .iter()
            .map(|(v, kind)| {
                let (to, by_plane) = ([v.x + v.u, v.y + v.v], camera.applied(v.x, v.y));
                let residual = [to[0] - by_plane[0], to[1] - by_plane[1]];
                let [x, y] = found.map_or(residual, |found| found.unexplained(to, residual));
                (*kind, x.hypot(y))
            })
            .collect();
        (found, left)
    }

    fn frames(&self, count: usize, state: &mut u64) -> (Option<Parallax>, Vec<(char, f64)>) {
        let mut last = (None, Vec::new());
        for _ in 0..count {
            last = self.step(last.0.as_ref(), state);
        }
        last
    }
}

/// The share of a kind whose unexplained motion is longer than half a pixel.
fn moving(left: &[(char, f64)], kind: char) -> f64 {
    let of: Vec<f64> = left.iter().filter(|l| l.0 == kind).map(|l| l.1).collect();
    of.iter().filter(|&&length| length > 0.5).count() as f64 / of.len() as f64
}

#[test]
fn boxes_stand_still_and_what_moves_across_is_told() {
    let mut state = 3;
    let sideways = [4.0 / FOCAL, 1.0 / FOCAL, 0.0];
    for (travel, own) in [(sideways, [-1.0, 3.0]), ([0.0, 0.0, 0.03], [3.0, 0.0])] {
        for boxes in [1, 4, 12] {
            for height in [0.2, 0.35] {
                let place = if travel[2] == 0.0 {
                    MOVER
                } else {
                    [163.0, 90.0]
                };
                let movers = vec![(place, own)];
                let scene = Scene {
                    travel,
                    boxes,
                    height,
                    movers,
                    noise: 0.1,
                };
                let (found, left) = scene.frames(6, &mut state);
                let found = found.unwrap();
                let told = format!("{travel:?} {boxes} {height} {found:?}");
                assert!(found.believed, "{told}");
                assert!(moving(&left, 'b') < 0.03, "{told}");
                assert!(moving(&left, 'p') < 0.005, "{told}");
                assert!(moving(&left, 'm') > 0.9, "{told}");
            }
        }
    }
}

#[test]
fn what_moves_the_way_that_no_depth_does_is_told() {
    let mut state = 3;
    // The plane moves by -4 px: what is nearer goes further that way.
    let travel = [4.0 / FOCAL, 0.0, 0.0];
    let against = vec![(MOVER, [3.0, 0.0])];
    let scene = Scene {
        travel,
        boxes: 8,
        height: 0.3,
        movers: against,
        noise: 0.1,
    };
    let (found, left) = scene.frames(6, &mut state);
    assert!(found.unwrap().sign.is_some());
    assert!(moving(&left, 'm') > 0.95);
    assert!(moving(&left, 'b') < 0.03);
    // The other way it could be a higher box.
    let along = Scene {
        movers: vec![(MOVER, [-2.0, 0.0])],
        ..scene
    };
    let (_, left) = along.frames(6, &mut state);
    assert!(moving(&left, 'm') < 0.1);
}

/// Motions of one or two things that are at least 20 degrees off the way that the plane moves.
fn movers(count: usize, travel: [f64; 3], state: &mut u64) -> Vec<([f64; 2], [f64; 2])> {
    let along = (-travel[1]).atan2(-travel[0]);
    (0..count)
        .map(|k| {
            let angle = along + (0.06 + 0.88 * random(state)) * std::f64::consts::TAU;
            let length = 1.0 + 5.0 * random(state);
            let place = PLACES[(random(state) * 6.0) as usize + 6 * k];
            (place, [length * angle.cos(), length * angle.sin()])
        })
        .collect()
}

#[test]
fn a_picture_that_is_only_moved_has_no_depth() {
    let mut state = 11;
    let mut believed = 0;
    for trial in 0..60 {
        let travel = [0, 1, 2].map(|k: usize| {
            let most = if k < 2 { 4.0 / FOCAL } else { 0.015 };
            most * (2.0 * random(&mut state) - 1.0)
        });
        // Of a travel along the line of sight every direction is that of some place's plane.
        let travel = if trial % 3 > 0 {
            [travel[0], travel[1], 0.0]
        } else {
            travel
        };
        let movers = movers(trial % 3, travel, &mut state);
        let noise = if trial % 2 == 0 { 0.1 } else { 0.5 };
        let scene = Scene {
            travel,
            boxes: 0,
            height: 0.0,
            movers,
            noise,
        };
        let mut before = None;
        for _ in 0..8 {
            before = scene.step(before.as_ref(), &mut state).0;
            believed += usize::from(before.is_some_and(|before| before.believed));
        }
    }
    assert_eq!(believed, 0);
}

#[test]
fn cars_of_a_road_under_a_shaken_camera_are_not_depth() {
    let mut state = 11;
    let vanishing = [150.0, -60.0];
    let movers = PLACES[..5]
        .iter()
        .map(|place| {
            let away = [place[0] - vanishing[0], place[1] - vanishing[1]];
            (*place, away.map(|part| 0.02 * part))
        })
        .collect();
    let mut scene = Scene {
        travel: [0.0; 3],
        boxes: 0,
        height: 0.0,
        movers,
        noise: 0.15,
    };
    let (mut before, mut believed) = (None, 0);
    for _ in 0..40 {
        scene.travel = [
            3.0 * normal(&mut state) / FOCAL,
            3.0 * normal(&mut state) / FOCAL,
            0.0,
        ];
        before = scene.step(before.as_ref(), &mut state).0;
        believed += usize::from(before.is_some_and(|before| before.believed));
    }
    assert!(believed <= 2, "{believed} of 40");
}

#[test]
fn what_moves_along_the_way_that_a_camera_pans_is_not_depth() {
    let mut state = 5;
    // The plane goes to the left by 8 px. Three go along with the camera, one further than it; two go against it, as if
    // they were nearer.
    let own = [4.5, 8.7, 6.0, -1.6, -3.0].map(|along| [along, 0.0]);
    let scene = Scene {
        travel: [8.0 / FOCAL, 0.0, 0.0],
        boxes: 0,
        height: 0.0,
        movers: PLACES.into_iter().zip(own).collect(),
        noise: 0.1,
    };
    let (mut before, mut left) = (None, Vec::new());
    for _ in 0..12 {
        (before, left) = scene.step(before.as_ref(), &mut state);
        assert!(!before.unwrap().believed);
    }
    assert!(moving(&left, 'm') > 0.95);
    // It is remembered of those that went along with the camera while these are not seen.
    let against = Scene {
        movers: scene.movers[3..].to_vec(),
        ..scene
    };
    for _ in 0..4 {
        before = against.step(before.as_ref(), &mut state).0;
        assert!(!before.unwrap().believed);
    }
}

#[test]
fn a_camera_that_rests_sees_no_parallax_and_believes_again() {
    let mut state = 7;
    let travel = [4.0 / FOCAL, 0.0, 0.0];
    let scene = Scene {
        travel,
        boxes: 8,
        height: 0.3,
        movers: vec![(MOVER, [0.0, 3.0])],
        noise: 0.1,
    };
    let (found, _) = scene.frames(5, &mut state);
    let resting = Scene {
        travel: [0.0; 3],
        ..scene.clone()
    };
    let (found, left) = resting.step(found.as_ref(), &mut state);
    assert!(!found.unwrap().believed);
    assert!(moving(&left, 'm') > 0.95);
    let (found, left) = scene.step(found.as_ref(), &mut state);
    assert!(found.unwrap().believed);
    assert!(moving(&left, 'b') < 0.03);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_vectors_do_no_harm(
        rows in prop::collection::vec(prop::array::uniform7(prop_oneof![
            -1e3..1e3_f64, Just(0.0), Just(f64::NAN), Just(f64::INFINITY), Just(1e300)
        ]), 0..80),
        numbers in prop::array::uniform9(-2.0..2.0_f64),
    ) {
        let vectors: Vec<MotionVector> = rows
            .into_iter()
            .map(|[x, y, u, v, xx, xy, yy]| MotionVector { x, y, u, v, covariance: [xx, xy, yy] })
            .collect();
        let [a, b, c, d, e, f, g, h, i] = numbers;
        let camera = CameraMotion {
            homography: [[a, b, c], [d, e, f], [g, h, i]],
            model: CameraModel::Homography,
            sigma_px: 0.1,
            explained: 1.0,
        };
        let mut before = None;
        for _ in 0..3 {
            before = find_parallax(&vectors, &camera, before.as_ref());
            if let Some(found) = &before {
                let [u, v] = found.unexplained([10.0, 20.0], [1.0, 2.0]);
                prop_assert!((u + v + found.belief).is_finite(), "{found:?}");
            }
        }
    }
}
