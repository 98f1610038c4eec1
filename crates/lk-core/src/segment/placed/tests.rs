use proptest::prelude::*;

use super::super::transform::{along_row, shift};
use super::*;
use crate::segment::made::{Numbers, every_way, mask};

#[test]
fn whole_pixels_move_without_a_change() {
    let size = (7, 5);
    let from: Vec<f32> = (0..35).map(|k| (k * k % 13) as f32).collect();
    let map = shift(2.0, 1.0);
    let moved = Moved {
        from: (&from, size),
        map: &map,
    };
    for y in 0..4 {
        let (mut row, mut inside, mut spare) = (vec![0.0; 7], vec![0; 7], vec![0.0; 14]);
        moved.row(y, &mut row, &mut inside, &mut spare, SimdLevel::detected());
        assert_eq!(row[..5], from[(y + 1) * 7 + 2..(y + 2) * 7]);
        assert_eq!(inside, [1, 1, 1, 1, 1, 0, 0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn masks_are_seen_where_single_places_say(
        w in 1usize..90, h in 1usize..40, seed in any::<u64>(), share in 0usize..4, kind in 0..5
    ) {
        let (size, to_size) = ((w, h), (w + 7, h + 3));
        let mut numbers = Numbers::new(seed);
        let mut n = |size: f64| size * numbers.normal();
        let map = match kind {
            0 => shift(n(3.0).round(), n(2.0).round()),
            1 => [[0.5, 0.0, -0.25], [0.0, 0.5, -0.25], [0.0, 0.0, 1.0]],
            2 => [[1.0 + n(0.1), n(0.1), n(3.0)], [n(0.1), 1.0 + n(0.1), n(3.0)], [0.0, 0.0, 1.0]],
            3 => [[1.0, n(0.05), n(3.0)], [n(0.05), 1.0, n(3.0)], [n(0.03), n(0.03), 1.0]],
            _ => [[0.0; 3]; 3],
        };
        let from = mask(size, [0.0, 0.002, 0.05, 0.6][share], seed);
        let (mut want, mut half) = (vec![0; to_size.0 * to_size.1], vec![0; to_size.0 * to_size.1]);
        for y in 0..to_size.1 {
            along_row(&map, y, to_size.0, |x, px, py| {
                let at = y * to_size.0 + x;
                let (nx, ny) = (px + 0.5, py + 0.5);
                if nx >= 0.0 && ny >= 0.0 && nx < w as f32 && ny < h as f32 {
                    want[at] = from[ny as usize * w + nx as usize];
                }
                if px > -1.0 && py > -1.0 && px < w as f32 && py < h as f32 {
                    let (left, top) = (px.max(0.0) as usize, py.max(0.0) as usize);
                    let (right, down) = ((left + 1).min(w - 1), (top + 1).min(h - 1));
                    let of = |y: usize, x: usize| f32::from(from[y * w + x]);
                    let (fx, fy) = (px - left as f32, py - top as f32);
                    let upper = of(top, left) + fx * (of(top, right) - of(top, left));
                    let lower = of(down, left) + fx * (of(down, right) - of(down, left));
                    half[at] = u8::from(upper + fy * (lower - upper) >= 0.5);
                }
            });
        }
        for execution in every_way() {
            let mut to = vec![7; want.len()];
            nearest_mask((&from, size), &map, (&mut to, to_size), &execution).unwrap();
            prop_assert_eq!(&to, &want);
            nearest((&from, size), &map, (&mut to, to_size), 0, &execution).unwrap();
            prop_assert_eq!(&to, &want);
            let few = (&from[..], size);
            nearest_of_few(few, |set| *set > 0, &map, (&mut to, to_size), 0, &execution).unwrap();
            prop_assert_eq!(&to, &want);
            covered((&from, size), &map, (&mut to, to_size), &execution).unwrap();
            prop_assert_eq!(&to, &half);
        }
    }
}
