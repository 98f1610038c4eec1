//! Cleaned masks beside what their words say, pixel by pixel.

use proptest::prelude::*;

use super::*;
use crate::segment::components::tests::flood;
use crate::segment::made::{mask, time};

/// Whether a pixel lies within the convex hull of others: no line has all of them on its other side.
fn in_hull((x, y): (i64, i64), spots: &[(i64, i64)]) -> bool {
    let beside = |a: (i64, i64), b: (i64, i64)| (b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (x - a.0);
    if spots.contains(&(x, y)) {
        return true;
    }
    // Within a triangle, or on a line, of some of them.
    spots.iter().any(|&a| {
        spots.iter().any(|&b| {
            spots.iter().any(|&c| {
                let area = (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0);
                let sides = [beside(a, b), beside(b, c), beside(c, a)];
                let box_of = |p: [i64; 3], at: i64| {
                    p.iter().min() <= Some(&at) && p.iter().max() >= Some(&at)
                };
                if area == 0 {
                    sides == [0; 3] && box_of([a.0, b.0, c.0], x) && box_of([a.1, b.1, c.1], y)
                } else {
                    sides.iter().all(|side| *side * area.signum() >= 0)
                }
            })
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn weak_regions_are_kept_that_hold_seeds(
        w in 1usize..40, h in 1usize..20, seed in any::<u64>(), share in 0.1f64..0.6, least in 1u64..3
    ) {
        let (weak, seeds) = (mask((w, h), share, seed), mask((w, h), 0.03, seed ^ 1));
        let both: Vec<u8> = weak.iter().zip(&seeds).map(|(a, b)| a | b).collect();
        let (labels, count) = flood(&both, (w, h), 1, true);
        let mut held = vec![0; count as usize + 1];
        for (label, seed) in labels.iter().zip(&seeds) {
            held[*label as usize] += u64::from(*seed);
        }
        held[0] = 0;
        let want: Vec<u8> = labels.iter().map(|label| u8::from(held[*label as usize] >= least)).collect();
        let mut to = vec![9; w * h];
        RegionWork::default().grow(&weak, &seeds, (w, h), least, &mut to).unwrap();
        prop_assert_eq!(to, want);
    }

    #[test]
    fn holes_are_filled_and_specks_removed(
        w in 1usize..40, h in 1usize..20, seed in any::<u64>(), share in 0.2f64..0.8, limit in 0u32..9
    ) {
        let source = mask((w, h), share, seed);
        let mut work = RegionWork::default();
        let (labels, _) = flood(&source, (w, h), 0, false);
        let mut want = source.clone();
        for at in 0..w * h {
            let same: Vec<_> = (0..w * h).filter(|near| labels[*near] == labels[at]).collect();
            let open = same.iter().any(|at| at % w == 0 || at % w == w - 1 || at / w == 0 || at / w == h - 1);
            want[at] |= u8::from(labels[at] > 0 && !open && same.len() <= limit as usize);
        }
        let mut got = source.clone();
        work.fill_holes(&mut got, (w, h), limit).unwrap();
        prop_assert_eq!(got, want);
        let (labels, _) = flood(&source, (w, h), 1, true);
        let want: Vec<u8> = labels
            .iter()
            .map(|label| u8::from(*label > 0 && labels.iter().filter(|near| *near == label).count() >= limit as usize))
            .collect();
        let mut got = source;
        work.remove_small(&mut got, (w, h), limit).unwrap();
        prop_assert_eq!(got, want);
    }

    #[test]
    fn what_is_possible_is_taken_within_hulls(
        w in 1usize..14, h in 1usize..11, seed in any::<u64>(), certain in 0.02f64..0.2, possible in 0.1f64..0.8
    ) {
        let masks = [mask((w, h), certain, seed), mask((w, h), possible, seed ^ 1), mask((w, h), 0.03, seed ^ 2)];
        let [certain, possible, seeds] = &masks;
        let any: Vec<u8> = (0..w * h).map(|at| certain[at] | possible[at] | seeds[at]).collect();
        let (labels, _) = flood(&any, (w, h), 1, true);
        let want: Vec<u8> = (0..w * h)
            .map(|at| {
                let same = (0..w * h).filter(|near| labels[*near] == labels[at]);
                let place = |at: usize| ((at % w) as i64, (at / w) as i64);
                let spots: Vec<_> = same.clone().filter(|at| certain[*at] | seeds[*at] == 1).map(place).collect();
                let seeded = labels[at] > 0 && same.clone().any(|at| seeds[at] == 1);
                u8::from(seeded && in_hull(place(at), &spots))
            })
            .collect();
        let mut to = vec![9; w * h];
        RegionWork::default().grow_in_hulls([certain, possible, seeds], (w, h), &mut to).unwrap();
        prop_assert_eq!(to, want);
    }
}

#[test]
#[ignore = "figures for those who change the regions"]
fn time_of_cleaning() {
    let size = (640, 480);
    let (mut work, mut to) = (RegionWork::default(), vec![0; 640 * 480]);
    let disc = |radius: i32| -> Vec<u8> {
        (0..640 * 480)
            .map(|at| {
                u8::from(
                    (at % 640 % 80 - 40i32).pow(2) + (at / 640 % 120 - 60i32).pow(2)
                        < radius * radius,
                )
            })
            .collect()
    };
    let (weak, seeds) = (disc(20), disc(10));
    time("grow", size, &mut || {
        work.grow(&weak, &seeds, size, 1, &mut to).unwrap()
    });
    time("grow in hulls", size, &mut || {
        work.grow_in_hulls([&seeds, &weak, &seeds], size, &mut to)
            .unwrap()
    });
    time("fill holes", size, &mut || {
        work.fill_holes(&mut to, size, 100).unwrap()
    });
    time("remove small", size, &mut || {
        work.remove_small(&mut to, size, 20).unwrap()
    });
}
