use proptest::prelude::*;

use super::super::transform::along_row;
use super::*;
use crate::segment::made::{Numbers, bits, greys, mask};
use crate::simd::{SimdLevel, dispatch};

fn places(map: &Map, y: usize, width: usize, level: SimdLevel) -> [Vec<f32>; 2] {
    let (mut x, mut down) = (vec![0.0; width], vec![0.0; width]);
    let to = [&mut x[..], &mut down[..]];
    dispatch(
        level,
        Places {
            map,
            y,
            first: 0,
            to,
        },
    );
    [x, down]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn lanes_see_what_single_places_do(
        w in 1usize..90, h in 1usize..12, seed in any::<u64>(), kind in 0..4
    ) {
        let size = (w, h);
        let mut numbers = Numbers::new(seed);
        let mut n = |size: f64| size * numbers.normal();
        let map = match kind {
            0 => [[1.0, 0.0, n(3.0).round()], [0.0, 1.0, n(2.0).round()], [0.0, 0.0, 1.0]],
            1 => [[1.0, 0.0, n(3.0)], [0.0, 1.0, n(2.0)], [0.0, 0.0, 1.0]],
            2 => [[1.0 + n(0.1), n(0.1), n(3.0)], [n(0.1), 1.0 + n(0.1), n(3.0)], [0.0, 0.0, 1.0]],
            _ => [[1.0, n(0.05), n(3.0)], [n(0.05), 1.0, n(3.0)], [n(0.01), n(0.01), 1.0]],
        };
        let from = greys(size, seed);
        let known = mask(size, 0.97, seed ^ 1);
        let holes: Vec<f32> =
            from.iter().zip(&known).map(|(value, known)| if *known == 1 { *value } else { f32::NAN }).collect();
        for y in 0..h {
            let (mut all, mut want, mut want_known) = (Vec::new(), Vec::new(), Vec::new());
            along_row(&map, y, w, |_, px, py| {
                all.push([px, py]);
                want.push(cubic_at(&from, size, px, py));
                want_known.push(known_at(&holes, size, px, py));
            });
            for level in SimdLevel::available() {
                let [px, py] = places(&map, y, w, level);
                for (at, [x, y]) in all.iter().enumerate() {
                    prop_assert_eq!([px[at].to_bits(), py[at].to_bits()], [x.to_bits(), y.to_bits()]);
                }
                let (mut to, mut inside) = (vec![0.0; w], vec![7; w]);
                let places = [&px[..], &py[..]];
                dispatch(level, Cubic { from: &from, size, places, to: &mut to, inside: &mut inside });
                prop_assert_eq!(bits(&to), bits(&want));
                for (at, [x, y]) in all.iter().enumerate() {
                    let within = *x >= -0.01 && *y >= -0.01
                        && *x <= (w - 1) as f32 + 0.01 && *y <= (h - 1) as f32 + 0.01;
                    prop_assert_eq!(inside[at], u8::from(within));
                }
                dispatch(level, Known { from: &holes, size, places, to: &mut to });
                for (got, want) in to.iter().zip(&want_known) {
                    prop_assert!(got.to_bits() == want.to_bits() || (got.is_nan() && want.is_nan()));
                }
            }
        }
    }
}
