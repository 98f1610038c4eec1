//! The camera's motion against exact vectors.

use proptest::prelude::*;

use super::MotionVector;
use super::camera::{CameraModel, CameraMotion, fit_camera};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 480.0;

pub(super) fn random(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as f64 / f64::from(1_u32 << 31)
}

/// A normal number, about: the sum of twelve equal ones.
pub(super) fn normal(state: &mut u64) -> f64 {
    (0..12).map(|_| random(state)).sum::<f64>() - 6.0
}

fn homography(numbers: [f64; 8]) -> CameraMotion {
    let [a, b, c, d, e, f, g, h] = numbers;
    CameraMotion {
        homography: [[1.0 + a, b, c], [d, 1.0 + e, f], [g, h, 1.0]],
        ..CameraMotion::unknown()
    }
}

fn vector(x: f64, y: f64, to: [f64; 2]) -> MotionVector {
    MotionVector {
        x,
        y,
        u: to[0] - x,
        v: to[1] - y,
        covariance: [0.01, 0.0, 0.01],
    }
}

/// Vectors every 24 px of a camera's motion.
fn field(camera: &CameraMotion) -> Vec<MotionVector> {
    let places = (0..20).flat_map(|row| (0..26).map(move |column| (column, row)));
    places
        .map(|(column, row)| {
            (
                12.0 + 24.0 * f64::from(column),
                12.0 + 24.0 * f64::from(row),
            )
        })
        .map(|(x, y)| vector(x, y, camera.applied(x, y)))
        .collect()
}

/// The furthest that two motions take a place of the frame apart.
fn apart(a: &CameraMotion, b: &CameraMotion) -> f64 {
    let corners = [
        (0.0, 0.0),
        (WIDTH, 0.0),
        (0.0, HEIGHT),
        (WIDTH, HEIGHT),
        (320.0, 240.0),
    ];
    corners
        .into_iter()
        .map(|(x, y)| {
            let ([ax, ay], [bx, by]) = (a.applied(x, y), b.applied(x, y));
            (ax - bx).hypot(ay - by)
        })
        .fold(0.0, f64::max)
}

prop_compose! {
    fn any_camera()(
        linear in prop::array::uniform4(-0.02..0.02_f64),
        shift in prop::array::uniform2(-8.0..8.0_f64),
        tilt in prop::array::uniform2(-3e-5..3e-5_f64),
    ) -> CameraMotion {
        let [a, b, d, e] = linear;
        homography([a, b, shift[0], d, e, shift[1], tilt[0], tilt[1]])
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn clean_vectors_give_the_motion(camera in any_camera()) {
        let fit = fit_camera(&field(&camera), None);
        prop_assert!(apart(&fit, &camera) < 0.02, "{fit:?} {camera:?}");
        prop_assert!(fit.explained > 0.99);
    }

    #[test]
    fn any_vectors_do_no_harm(
        rows in prop::collection::vec(prop::array::uniform7(prop_oneof![
            -1e3..1e3_f64, Just(0.0), Just(f64::NAN), Just(f64::INFINITY), Just(1e300)
        ]), 0..60)
    ) {
        let vectors: Vec<MotionVector> = rows
            .into_iter()
            .map(|[x, y, u, v, xx, xy, yy]| MotionVector { x, y, u, v, covariance: [xx, xy, yy] })
            .collect();
        let fit = fit_camera(&vectors, None);
        prop_assert!(fit.homography.iter().flatten().all(|value| value.is_finite()), "{fit:?}");
    }
}

#[test]
fn a_thing_of_two_fifths_of_the_frame_does_not_bend_it() {
    let mut state = 1;
    let mut bent = Vec::new();
    for _ in 0..200 {
        let mut within = |most: f64| most * (2.0 * random(&mut state) - 1.0);
        let numbers = [0.02, 0.02, 8.0, 0.02, 0.02, 8.0, 3e-5, 3e-5].map(&mut within);
        let middle = [320.0 + within(120.0), 240.0 + within(80.0)];
        let (angle, length) = (within(3.2), 11.5 + within(8.5));
        let camera = homography(numbers);
        let mut vectors = field(&camera);
        // The nearest to the middle, in a shape like the frame's.
        let far = |v: &MotionVector| ((v.x - middle[0]) / WIDTH).hypot((v.y - middle[1]) / HEIGHT);
        vectors.sort_by(|a, b| far(a).total_cmp(&far(b)));
        let count = vectors.len() * 2 / 5;
        for v in &mut vectors[..count] {
            v.u += length * angle.cos();
            v.v += length * angle.sin();
        }
        let fit = fit_camera(&vectors, None);
        if apart(&fit, &camera) > 0.02 {
            bent.push((length, fit));
        }
    }
    assert!(bent.len() < 2, "{}: {:?}", bent.len(), bent[0]);
}

#[test]
fn vectors_count_by_their_covariance() {
    let camera = homography([0.0, 0.0, 2.0, 0.0, 0.0, -1.0, 0.0, 0.0]);
    let mut vectors = field(&camera);
    let mut state = 5;
    // More than half are along vertical edges: they say nothing of the motion down, and are far off there.
    for v in vectors.iter_mut().filter(|v| v.x > 250.0) {
        v.v += 3.0 * normal(&mut state) + 2.0;
        v.covariance = [0.01, 0.0, 13.0];
    }
    let fit = fit_camera(&vectors, None);
    assert!(apart(&fit, &camera) < 0.1, "{fit:?}");
}

#[test]
fn of_two_planes_alike_the_one_before_is_kept() {
    let near = homography([0.0, 0.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let far = homography([0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut vectors = field(&near);
    for v in vectors.iter_mut().filter(|v| v.x > 320.0) {
        let to = far.applied(v.x, v.y);
        *v = vector(v.x, v.y, to);
    }
    for plane in [&near, &far] {
        let fit = fit_camera(&vectors, Some(&plane.homography));
        assert!(apart(&fit, plane) < 0.02, "{fit:?}");
    }
}

#[test]
fn few_vectors_tell_nothing() {
    let vectors = field(&homography([0.0; 8]));
    assert_eq!(fit_camera(&vectors[..11], None), CameraMotion::unknown());
    assert_eq!(
        fit_camera(&vectors[..60], None).model,
        CameraModel::Translation
    );
}
