use ndarray::{Array2, ArrayView2};
use proptest::prelude::*;

use super::*;
use crate::segment::made::{Numbers, greys, mask};

fn nothing() -> SeenBeside<'static, f32> {
    SeenBeside {
        motion: None,
        image: None,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn regions_are_what_single_pixels_say(
        w in 1usize..60, h in 1usize..40, share in 0.0f64..0.7, least in 1usize..9, seed in any::<u64>()
    ) {
        let set = mask((w, h), share, seed);
        let picture = greys((w, h), seed ^ 1);
        let mut numbers = Numbers::new(seed ^ 2);
        let motion: Vec<f32> = (0..2 * w * h).map(|_| (3.0 * numbers.normal()) as f32).collect();
        let frame = Array2::from_shape_vec((h, w), picture).unwrap();
        let shape = Array2::from_shape_fn((h, w), |(y, x)| set[y * w + x] == 1);
        let beside = SeenBeside { motion: Some(&motion), image: Some(frame.view()) };
        let seen = see_regions(shape.view(), least, beside, Some(frame.view())).unwrap();
        let mut runs = Runs::default();
        runs.label(&set, (w, h)).unwrap();
        let large = runs.regions().iter().filter(|region| region.area as usize >= least).count();
        prop_assert_eq!(seen.regions.len(), large);
        for (number, region) in (1..).zip(&seen.regions) {
            let own: Vec<[usize; 2]> = (0..w * h)
                .filter(|at| seen.labels[*at] == number)
                .map(|at| [at % w, at / w])
                .collect();
            prop_assert_eq!(own.len(), region.area);
            prop_assert!(own.iter().all(|[x, y]| set[y * w + x] == 1));
            for axis in 0..2 {
                let along = || own.iter().map(|place| place[axis]);
                prop_assert_eq!(along().min(), Some(region.bounds[axis]));
                prop_assert_eq!(along().max().map(|last| last + 1), Some(region.bounds[axis + 2]));
                let mean = along().sum::<usize>() as f64 / own.len() as f64;
                prop_assert!((mean - region.centre[axis]).abs() < 1e-9);
            }
            for sample in 0..REGION_SAMPLES {
                let [x, y] = region.place(sample);
                prop_assert_eq!(region.inside[sample], seen.labels[y * w + x] == number);
                let [weight, px, py, level, ..] = region.picture[sample];
                prop_assert_eq!((px, py, level), (x as f32, y as f32, frame[(y, x)]));
                prop_assert_eq!(weight > 0.0, region.inside[sample]);
            }
            let sum: f64 = region.shares.iter().sum();
            prop_assert!((sum - f64::from(u8::from(region.inside.contains(&true)))).abs() < 1e-9);
        }
    }
}

#[test]
fn the_motion_is_the_median_of_what_goes() {
    let (w, h) = (40, 30);
    let shape = Array2::from_elem((h, w), true);
    // A third stands, of the rest a tenth is wild, and some is not known.
    let motion: Vec<f32> = (0..w * h)
        .flat_map(|at| match at % w {
            0..12 => [0.1, 0.0],
            12..15 => [-70.0, 60.0],
            15..19 => [f32::NAN, 0.0],
            _ => [4.0, -2.0],
        })
        .collect();
    let beside = SeenBeside::<f32> {
        motion: Some(&motion),
        image: None,
    };
    let seen = see_regions::<f32, f32>(shape.view(), 1, beside, None).unwrap();
    assert_eq!(seen.regions[0].motion, [4.0, -2.0]);
    let unknown = vec![f32::NAN; 2 * w * h];
    let beside = SeenBeside::<f32> {
        motion: Some(&unknown),
        image: None,
    };
    let seen = see_regions::<f32, f32>(shape.view(), 1, beside, None).unwrap();
    assert!(seen.regions[0].motion[0].is_nan() && seen.regions[0].variance[0].is_infinite());
}

#[test]
fn levels_of_every_type_fall_into_the_same_bins() {
    let shape = Array2::from_elem((16, 16), true);
    let bytes = Array2::from_shape_fn((16, 16), |(y, x)| (y * 16 + x) as u8);
    let words = bytes.mapv(|level| u16::from(level) * 257);
    let floats = bytes.mapv(f32::from);
    fn shares<T: Pixel>(shape: ArrayView2<'_, bool>, image: &Array2<T>) -> [f64; REGION_BINS] {
        let beside = SeenBeside {
            motion: None,
            image: Some(image.view()),
        };
        see_regions::<T, T>(shape, 1, beside, None).unwrap().regions[0].shares
    }
    let want = [1.0 / 16.0; REGION_BINS];
    assert_eq!(shares(shape.view(), &bytes), want);
    assert_eq!(shares(shape.view(), &words), want);
    assert_eq!(shares(shape.view(), &floats), want);
    // What is no number is black, what is too bright white.
    let odd = floats.mapv(|level| {
        if level < 128.0 {
            f32::NAN
        } else {
            f32::INFINITY
        }
    });
    let found = shares(shape.view(), &odd);
    assert_eq!((found[0], found[REGION_BINS - 1]), (0.5, 0.5));
}

#[test]
fn sizes_that_do_not_fit_are_told() {
    let shape = Array2::from_elem((4, 5), true);
    let other = Array2::<f32>::zeros((5, 4));
    assert!(see_regions::<f32, f32>(shape.view(), 1, nothing(), Some(other.view())).is_err());
    let beside = SeenBeside::<f32> {
        motion: Some(&[0.0; 3]),
        image: None,
    };
    assert!(see_regions::<f32, f32>(shape.view(), 1, beside, None).is_err());
    let empty = Array2::from_elem((0, 0), true);
    let seen = see_regions::<f32, f32>(empty.view(), 1, nothing(), None).unwrap();
    assert!(seen.regions.is_empty() && seen.labels.is_empty());
}
