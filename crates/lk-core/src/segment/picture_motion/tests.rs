use ndarray::Array2;
use proptest::prelude::*;

use super::*;
use crate::segment::made::Numbers;
use crate::segment::seen_regions::{SeenBeside, see_regions};

/// A smooth picture without a pattern, shifted.
fn picture((w, h): (usize, usize), [dx, dy]: [f64; 2], seed: u64) -> Array2<f32> {
    let mut numbers = Numbers::new(seed);
    let waves: Vec<[f64; 4]> = (0..12)
        .map(|_| {
            [
                0.5 * numbers.normal(),
                0.5 * numbers.normal(),
                6.0 * numbers.next(),
                12.0 * numbers.next(),
            ]
        })
        .collect();
    Array2::from_shape_fn((h, w), |(y, x)| {
        let (x, y) = (x as f64 - dx, y as f64 - dy);
        let wave = |[kx, ky, phase, size]: &[f64; 4]| size * (kx * x + ky * y + phase).sin();
        (128.0 + waves.iter().map(wave).sum::<f64>()) as f32
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn a_picture_that_moves_is_followed(
        dx in -6.0f64..6.0, dy in -6.0f64..6.0, off in -0.8f64..0.8, light in -30.0f64..30.0, seed in any::<u64>()
    ) {
        let size = (90, 70);
        let before = picture(size, [0.0; 2], seed);
        let now = picture(size, [dx, dy], seed).mapv(|level| level + light as f32);
        let mask = |dx: f64, dy: f64| Array2::from_shape_fn((70, 90), |(y, x)| {
            let (x, y) = (x as f64 - dx, y as f64 - dy);
            (25.0..65.0).contains(&x) && (20.0..50.0).contains(&y)
        });
        let beside = SeenBeside::<f32> { motion: None, image: None };
        let seen = see_regions(mask(0.0, 0.0).view(), 1, beside, Some(before.view())).unwrap();
        let pictures = seen.regions[0].picture.as_flattened();
        let starts = [[[dx + off, dy - off], [9.0, 9.0], [0.0, 0.0], [-9.0, 5.0]]];
        let riders = Riders { pictures, starts: &starts, sizes: &[40.0] };
        let ridden = ride(riders, now.view(), mask(dx, dy).view()).unwrap()[0];
        prop_assert!((ridden.motion[0] - dx).abs() < 0.15 && (ridden.motion[1] - dy).abs() < 0.15, "{ridden:?}");
        prop_assert!(ridden.variance[0] > 0.0 && ridden.variance[0] < 0.1);
        prop_assert!(ridden.contrast > 3.0);
    }
}

#[test]
fn what_has_no_picture_says_nothing() {
    let (frame, mask) = (
        picture((40, 30), [0.0; 2], 3),
        Array2::from_elem((30, 40), true),
    );
    let none = vec![0.0; REGION_SAMPLES * SAMPLE_PARTS];
    let riders = Riders {
        pictures: &none,
        starts: &[[[0.0; 2]; RIDE_STARTS]],
        sizes: &[9.0],
    };
    let ridden = ride(riders, frame.view(), mask.view()).unwrap()[0];
    assert!(ridden.motion[0].is_nan() && ridden.variance[1].is_infinite());
    // Nor has what moves elsewhere.
    let beside = SeenBeside::<f32> {
        motion: None,
        image: None,
    };
    let seen = see_regions(mask.view(), 1, beside, Some(frame.view())).unwrap();
    let riders = Riders {
        pictures: seen.regions[0].picture.as_flattened(),
        ..riders
    };
    let nowhere = Array2::from_elem((30, 40), false);
    let ridden = ride(riders, frame.view(), nowhere.view()).unwrap()[0];
    assert!(ridden.motion[0].is_nan() && ridden.contrast > 0.0);
}

#[test]
fn sizes_that_do_not_fit_are_told() {
    let (frame, mask) = (
        picture((40, 30), [0.0; 2], 3),
        Array2::from_elem((30, 40), true),
    );
    let none = vec![0.0; REGION_SAMPLES * SAMPLE_PARTS];
    let riders = Riders {
        pictures: &none,
        starts: &[],
        sizes: &[9.0],
    };
    assert!(ride(riders, frame.view(), mask.view()).is_err());
    let riders = Riders {
        starts: &[[[0.0; 2]; RIDE_STARTS]],
        ..riders
    };
    let other = Array2::from_elem((40, 30), true);
    assert!(ride(riders, frame.view(), other.view()).is_err());
    let (no_frame, no_mask) = (
        Array2::<f32>::zeros((0, 0)),
        Array2::from_elem((0, 0), true),
    );
    assert!(ride(riders, no_frame.view(), no_mask.view()).is_err());
}
