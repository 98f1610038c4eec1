//! Masks beside what their words say, pixel by pixel.

use proptest::prelude::*;

use super::*;
use crate::segment::made::{every_way, mask};
use crate::segment::vote::majority;
use crate::simd::SimdLevel;

/// Whether the element that lies over (x, y) has a pixel at a distance from it.
fn within(element: Element, dx: isize, dy: isize) -> bool {
    match element {
        Element::Square(size) => dx.unsigned_abs().max(dy.unsigned_abs()) <= size / 2,
        Element::Disc(size) => {
            let r = (size / 2) as f64;
            let (dx, dy) = (dx as f64, dy as f64);
            dy.abs() <= r && dx.abs() <= (r * r - dy * dy).sqrt().round_ties_even()
        }
    }
}

/// Over a frame larger by `pad` on every side: whether `wanted` stands in the element over each pixel; what is beyond the
/// picture is not.
fn spread_plainly(mask: &[u8], (w, h): Size, element: Element, wanted: u8, pad: isize) -> Vec<u8> {
    let (w, h) = (w as isize, h as isize);
    let mut out = Vec::new();
    for y in -pad..h + pad {
        for x in -pad..w + pad {
            let mut found = false;
            for v in 0..h {
                for u in 0..w {
                    found |= within(element, u - x, v - y) && mask[(v * w + u) as usize] == wanted;
                }
            }
            out.push(if found { wanted } else { 1 - wanted });
        }
    }
    out
}

fn elements() -> impl Strategy<Value = Element> {
    (0usize..5, any::<bool>()).prop_map(|(half, square)| {
        let size = 2 * half + 1;
        if square {
            Element::Square(size)
        } else {
            Element::Disc(size)
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn masks_grow_and_shrink_as_pixels_say(
        w in 1usize..26, h in 1usize..22, seed in any::<u64>(), share in 0.02f64..0.98, element in elements()
    ) {
        let source = mask((w, h), share, seed);
        let grown = spread_plainly(&source, (w, h), element, 1, 0);
        let shrunk = spread_plainly(&source, (w, h), element, 0, 0);
        for execution in every_way() {
            let mut to = vec![7; w * h];
            dilate(&source, (w, h), element, &mut to, &execution).unwrap();
            prop_assert_eq!(&to, &grown);
            erode(&source, (w, h), element, &mut to, &execution).unwrap();
            prop_assert_eq!(&to, &shrunk);
        }
    }

    #[test]
    fn closing_and_opening_go_there_and_back_over_the_border(
        w in 1usize..20, h in 1usize..16, seed in any::<u64>(), share in 0.1f64..0.9, element in elements()
    ) {
        let (Element::Square(size) | Element::Disc(size)) = element;
        let reach = size / 2;
        let source = mask((w, h), share, seed);
        let mut work = Morphology::default();
        for wanted in [1, 0] {
            let wide = (w + 2 * reach, h + 2 * reach);
            let there = spread_plainly(&source, (w, h), element, wanted, reach as isize);
            let back = spread_plainly(&there, wide, element, 1 - wanted, 0);
            let want: Vec<u8> = (0..w * h)
                .map(|at| back[(at / w + reach) * wide.0 + at % w + reach])
                .collect();
            for execution in every_way() {
                let mut got = source.clone();
                if wanted == 1 {
                    work.close(&mut got, (w, h), element, &execution).unwrap();
                    prop_assert!(got.iter().zip(&source).all(|(a, b)| a >= b));
                } else {
                    work.open(&mut got, (w, h), element, &execution).unwrap();
                    prop_assert!(got.iter().zip(&source).all(|(a, b)| a <= b));
                }
                prop_assert_eq!(&got, &want);
            }
        }
    }

    #[test]
    fn a_vote_counts_the_window(
        w in 1usize..40, h in 1usize..30, seed in any::<u64>(), share in 0.1f64..0.9, half in 0usize..8
    ) {
        let source = mask((w, h), share, seed);
        let mut want = vec![0; w * h];
        for y in 0..h {
            for x in 0..w {
                let (mut set, mut all) = (0, 0);
                for v in y.saturating_sub(half)..(y + half + 1).min(h) {
                    for u in x.saturating_sub(half)..(x + half + 1).min(w) {
                        set += usize::from(source[v * w + u]);
                        all += 1;
                    }
                }
                want[y * w + x] = u8::from(2 * set > all);
            }
        }
        for execution in every_way() {
            let mut to = vec![7; w * h];
            majority(&source, (w, h), 2 * half + 1, &mut to, &execution).unwrap();
            prop_assert_eq!(&to, &want);
        }
    }
}

#[test]
fn elements_and_windows_are_odd_and_bounded() {
    let one = Execution::default();
    for size in [0, 4, 257] {
        let error = dilate(&[1], (1, 1), Element::Square(size), &mut [0], &one).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("element: got {size}, expected an odd number of at most 255")
        );
    }
    let error = majority(&[1], (1, 1), 17, &mut [0], &one).unwrap_err();
    assert_eq!(
        error.to_string(),
        "window: got 17, expected an odd number of at most 15"
    );
    // As wide as counts allow, over a mask that is set everywhere.
    let mut to = vec![0; 300 * 300];
    let all = vec![1; 300 * 300];
    dilate(
        &all,
        (300, 300),
        Element::Square(255),
        &mut to,
        &one.clone().level(SimdLevel::Baseline),
    )
    .unwrap();
    assert_eq!(to, all);
    dilate(&[], (0, 0), Element::Disc(3), &mut [], &one).unwrap();
}

#[test]
#[ignore = "figures for those who change the kernels"]
fn time_of_masks() {
    let size = (640, 480);
    let source = mask(size, 0.1, 3);
    let mut to = vec![0; source.len()];
    let one = Execution::default().threads(1);
    let mut work = Morphology::default();
    let time = |name: &str, work: &mut dyn FnMut()| crate::segment::made::time(name, size, work);
    for window in [3, 5, 9] {
        time(&format!("majority {window}"), &mut || {
            majority(&source, size, window, &mut to, &one).unwrap()
        });
    }
    for element in [
        Element::Square(3),
        Element::Square(7),
        Element::Square(31),
        Element::Disc(5),
        Element::Disc(9),
    ] {
        time(&format!("dilate {element:?}"), &mut || {
            dilate(&source, size, element, &mut to, &one).unwrap()
        });
    }
    to.copy_from_slice(&source);
    time("close Disc(7)", &mut || {
        work.close(&mut to, size, Element::Disc(7), &one).unwrap()
    });
}
