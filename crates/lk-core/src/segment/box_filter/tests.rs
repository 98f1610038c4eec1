//! Means beside sums over pixels.

use proptest::prelude::*;

use super::*;
use crate::segment::made::{bits, every_way, greys, time};

fn reference(plane: &[f32], (w, h): Size, window: Window) -> Vec<f64> {
    let reach = (window.size / 2) as isize;
    let mut means = Vec::new();
    for y in 0..h as isize {
        for x in 0..w as isize {
            let (mut sum, mut count) = (0.0, 0.0);
            for v in y - reach..=y + reach {
                for u in x - reach..=x + reach {
                    let (near_u, near_v) = (u.clamp(0, w as isize - 1), v.clamp(0, h as isize - 1));
                    sum += f64::from(plane[near_v as usize * w + near_u as usize]);
                    count += 1.0;
                }
            }
            means.push(sum / count);
        }
    }
    means
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn means_are_those_of_windows(
        w in 1usize..70, h in 1usize..30, seed in any::<u64>(), half in 0usize..9
    ) {
        let window = Window { size: 2 * half + 1 };
        let plane = greys((w, h), seed);
        let want = reference(&plane, (w, h), window);
        let mut first = None;
        for execution in every_way() {
            let mut to = vec![f32::NAN; w * h];
            box_mean(&plane, (w, h), window, &mut to, &execution).unwrap();
            for (got, want) in to.iter().zip(&want) {
                prop_assert!((f64::from(*got) - want).abs() < 1e-4);
            }
            let found = bits(&to);
            prop_assert_eq!(first.get_or_insert(found.clone()), &found);
        }
    }
}

#[test]
fn windows_are_odd_and_bounded() {
    for size in [0, 2, 65] {
        let window = Window { size };
        let error =
            box_mean(&[1.0], (1, 1), window, &mut [0.0], &Execution::default()).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("window: got {size}, expected an odd number of at most 63")
        );
    }
}

#[test]
#[ignore = "figures for those who change the kernels"]
fn time_of_means() {
    let size = (640, 480);
    let plane = greys(size, 1);
    let mut to = vec![0.0; plane.len()];
    let one = Execution::default().threads(1);
    for window in [3, 5, 7, 15, 31] {
        let window = Window { size: window };
        time(&format!("mean {}", window.size), size, &mut || {
            box_mean(&plane, size, window, &mut to, &one).unwrap()
        });
    }
}
