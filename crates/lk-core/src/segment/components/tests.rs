//! Regions beside a flood over pixels.

use proptest::prelude::*;

use super::*;
use crate::segment::made::{Numbers, mask, time};

/// Number the regions of what is `wanted` by a flood from each pixel that has none yet; 0 elsewhere.
pub(crate) fn flood(mask: &[u8], (w, h): Size, wanted: u8, corners: bool) -> (Vec<u32>, u32) {
    let mut labels = vec![0; w * h];
    let mut count = 0;
    for seed in 0..w * h {
        if mask[seed] != wanted || labels[seed] != 0 {
            continue;
        }
        count += 1;
        labels[seed] = count;
        let mut open = vec![seed];
        while let Some(at) = open.pop() {
            let (x, y) = (at % w, at / w);
            for v in y.saturating_sub(1)..(y + 2).min(h) {
                for u in x.saturating_sub(1)..(x + 2).min(w) {
                    let near = v * w + u;
                    if (corners || u == x || v == y) && mask[near] == wanted && labels[near] == 0 {
                        labels[near] = count;
                        open.push(near);
                    }
                }
            }
        }
    }
    (labels, count)
}

fn of_label(labels: &[u32], label: u32) -> impl Iterator<Item = usize> + Clone {
    labels
        .iter()
        .enumerate()
        .filter(move |(_, found)| **found == label)
        .map(|(at, _)| at)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn regions_are_those_of_a_flood(
        w in 0usize..150, h in 0usize..24, seed in any::<u64>(), share in 0.02f64..0.98
    ) {
        let source = mask((w, h), share, seed);
        let mut runs = Runs::default();
        let mut labels = vec![9; w * h];
        for inverse in [false, true] {
            if inverse {
                runs.label_inverse(&source, (w, h)).unwrap();
            } else {
                runs.label(&source, (w, h)).unwrap();
            }
            let (want, count) = flood(&source, (w, h), u8::from(!inverse), !inverse);
            runs.labels(&mut labels);
            prop_assert_eq!(&labels, &want);
            prop_assert_eq!(runs.regions().len(), count as usize);
            for (region, label) in runs.regions().iter().zip(1..) {
                let places: Vec<_> = of_label(&want, label).map(|at| (at % w, at / w)).collect();
                let (area, columns, rows) = (
                    places.len(),
                    places.iter().map(|place| place.0),
                    places.iter().map(|place| place.1),
                );
                prop_assert_eq!(region.area as usize, area);
                prop_assert_eq!(Some(region.left as usize), columns.clone().min());
                prop_assert_eq!(Some(region.right as usize - 1), columns.clone().max());
                prop_assert_eq!(Some(region.top as usize), rows.clone().min());
                prop_assert_eq!(Some(region.bottom as usize - 1), rows.clone().max());
            }
        }
    }

    #[test]
    fn planes_are_summed_over_regions(w in 1usize..60, h in 1usize..20, seed in any::<u64>(), share in 0.1f64..0.9) {
        let source = mask((w, h), share, seed);
        let mut numbers = Numbers::new(seed);
        let bytes: Vec<u8> = (0..w * h).map(|_| (255.0 * numbers.next()) as u8).collect();
        let mut runs = Runs::default();
        runs.label(&source, (w, h)).unwrap();
        let (labels, _) = flood(&source, (w, h), 1, true);
        let mut of_bytes = Vec::new();
        runs.sum_bytes(&bytes, &mut of_bytes).unwrap();
        for (index, label) in (1..).take(runs.regions().len()).enumerate() {
            prop_assert_eq!(of_bytes[index], of_label(&labels, label).map(|at| u64::from(bytes[at])).sum::<u64>());
        }
    }

    #[test]
    fn regions_that_are_kept_are_numbered_anew(w in 1usize..60, h in 1usize..20, seed in any::<u64>(), share in 0.1f64..0.6) {
        let source = mask((w, h), share, seed);
        let (mut all, mut runs) = (Runs::default(), Runs::default());
        all.label(&source, (w, h)).unwrap();
        runs.label(&source, (w, h)).unwrap();
        runs.keep(|label, region| label % 3 != 0 && region.area > 1).unwrap();
        let mut kept = vec![0; w * h];
        all.draw(|label| label % 3 != 0 && all.regions()[label].area > 1, &mut kept);
        let mut again = Runs::default();
        again.label(&kept, (w, h)).unwrap();
        prop_assert_eq!(again.runs(), runs.runs());
        prop_assert_eq!(again.regions(), runs.regions());
        for y in 0..h {
            prop_assert_eq!(again.row(y), runs.row(y));
        }
    }
}

#[test]
#[ignore = "figures for those who change the search"]
fn time_of_regions() {
    let size = (640, 480);
    let mut runs = Runs::default();
    let mut blobs = vec![0; 640 * 480];
    for (at, value) in blobs.iter_mut().enumerate() {
        let (x, y) = (at % 640 % 80, at / 640 % 120);
        *value = u8::from((x as i32 - 40).pow(2) + (y as i32 - 60).pow(2) < 400);
    }
    for (name, source) in [
        ("nothing", vec![0; 640 * 480]),
        ("blobs", blobs),
        ("noise", mask(size, 0.05, 1)),
    ] {
        time(&format!("label {name}"), size, &mut || {
            runs.label(&source, size).unwrap()
        });
        let plane = vec![1; source.len()];
        let mut sums = Vec::new();
        time(&format!("sum {name}"), size, &mut || {
            runs.sum_bytes(&plane, &mut sums).unwrap()
        });
    }
}
