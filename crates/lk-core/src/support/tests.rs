use ndarray::Array2;
use proptest::prelude::*;

use super::*;

pub(super) fn support<T: Pixel>(frame: &Array2<T>, mask: Option<&Array2<bool>>) -> Support {
    let mut support = Support::default();
    let mask = mask.map(|mask| mask.view());
    support
        .take(frame.view(), mask, &Execution::default())
        .unwrap();
    support
}

proptest! {
    #[test]
    fn a_coarser_pixel_counts_where_most_of_it_does(
        height in 1usize..30, width in 1usize..30, seed in any::<u32>(), share in 0u32..300,
    ) {
        let mask = Array2::from_shape_fn((height, width), |(y, x)| {
            ((x as u32 * 7919 + y as u32 * 104_729).wrapping_add(seed).wrapping_mul(2_654_435_761) >> 16) % 997 >= share
        });
        let frame = Array2::from_shape_fn((height, width), |(y, x)| (x * y) as f32);
        let finer = support(&frame, Some(&mask));
        let mut coarser = Support::default();
        coarser.reduce(&finer).unwrap();
        for y in 0..height.div_ceil(2) {
            for x in 0..width.div_ceil(2) {
                let mut weight = 0;
                for (j, wy) in [1, 4, 6, 4, 1].into_iter().enumerate() {
                    for (i, wx) in [1, 4, 6, 4, 1].into_iter().enumerate() {
                        let at = [(2 * x + i) as isize - 2, (2 * y + j) as isize - 2];
                        weight += wx * wy * i32::from(finer.at(at[0], at[1]) != ABSENT);
                    }
                }
                // At the frame's border a whole side is missing, however much of the rest is there.
                let inner = |at: usize, size: usize| at > 0 && 2 * at + 1 < size;
                let want = weight >= i32::from(LEAST_WEIGHT) && inner(x, width) && inner(y, height);
                prop_assert_eq!(coarser.at(x as isize, y as isize) == COUNTS, want, "{} {}", x, y);
            }
        }
    }
}

#[test]
fn what_a_mask_takes_away_says_nothing_of_where_grey_levels_are_cut_off() {
    let slope =
        |x: usize, y: usize| 180.0 + 120.0 * (x as f32 * 0.2).sin() * (y as f32 * 0.15).cos();
    let scene = Array2::from_shape_fn((60, 80), |(y, x)| slope(x, y).min(255.0) as u8);
    let mask = Array2::from_shape_fn((60, 80), |(y, x)| (x / 3 + y / 4) % 3 > 0);
    let covered = |cover: u8| {
        let frame = Array2::from_shape_fn((60, 80), |at| if mask[at] { scene[at] } else { cover });
        support(&frame, Some(&mask)).bytes
    };
    let found = covered(0);
    assert!(found.contains(&CLIPPED));
    for cover in [90, 254, 255] {
        assert_eq!(covered(cover), found, "{cover}");
    }
    let small = |cover: u8| {
        let mask = Array2::from_shape_fn((60, 80), |(y, _)| y > 30);
        let frame = Array2::from_shape_fn((60, 80), |(y, x)| {
            if mask[(y, x)] {
                (slope(x, y) / 2.0) as u8
            } else {
                cover
            }
        });
        support(&frame, Some(&mask)).bytes
    };
    assert_eq!(small(0), small(255));
}

#[test]
fn grey_levels_that_are_cut_off_are_told_from_flat_shapes() {
    let slope =
        |x: usize, y: usize| 180.0 + 120.0 * (x as f32 * 0.2).sin() * (y as f32 * 0.15).cos();
    let scene = Array2::from_shape_fn((60, 80), |(y, x)| slope(x, y));
    let bytes = scene.mapv(|grey| grey.min(255.0) as u8);
    let deep = scene.mapv(|grey| (grey * 16.0).min(4095.0) as u16);
    let float = scene.mapv(|grey| (grey / 255.0).min(1.0));
    for (found, name) in [
        (support(&bytes, None), "u8"),
        (support(&deep, None), "u16"),
        (support(&float, None), "f32"),
    ] {
        for ((y, x), grey) in scene.indexed_iter() {
            let want = if *grey >= 255.95 { CLIPPED } else { COUNTS };
            if (grey - 255.5).abs() > 0.6 {
                assert_eq!(
                    found.at(x as isize, y as isize),
                    want,
                    "{name} {x} {y} {grey}"
                );
            }
        }
    }
    let disc = Array2::from_shape_fn((60, 80), |(y, x)| {
        let far = (x as f32 - 40.0).hypot(y as f32 - 30.0);
        (255.0 * (20.5 - far).clamp(0.0, 1.0)) as u8
    });
    assert!(support(&disc, None).is_whole());
    assert!(support(&scene, None).is_whole());
    assert!(support(&Array2::<u8>::from_elem((9, 9), 255), None).is_whole());
}
