//! `MotionSegmenter` over several frames, each with flow and a mask of its own: what it says is of the frame, the same for every
//! thread count and CPU level, and goes on after it was written down and read again.

use arbitrary::Arbitrary;
use lk_core::{Execution, GivenFlow, MotionSegmenter, SegmenterOptions};
use ndarray::Array2;

use crate::frames::{Frames, Grey, mask};
use crate::{by_depth, others, plain};

/// What the flow between two frames is said to be.
#[derive(Debug, Clone, Copy, Arbitrary)]
pub enum Said {
    /// One motion everywhere, in 1/16 px.
    Even(i8, i8),
    /// Motion that grows from the corner, in 1/16 px over the frame.
    Growing(i8, i8),
    /// Nothing is known.
    Nothing,
    /// Valid, but not finite or far beyond the picture.
    Odd(u8),
}

/// Frames, what is said of their flow, masks.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    said: [Said; 3],
    masks: [Option<u16>; 4],
    camera_moves: bool,
    min_area: u8,
    /// Whether it is written down and read again after this frame.
    parked: u8,
    /// Begun anew after this frame.
    reset: u8,
}

/// Frames that are shown, back and forth between the two of the pair.
const SHOWN: usize = 7;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

type Flow = (Vec<f32>, Vec<bool>);

fn flow(said: Said, (height, width): (usize, usize)) -> Flow {
    let mut uv = Vec::with_capacity(2 * height * width);
    for y in 0..height {
        for x in 0..width {
            let (u, v) = match said {
                Said::Even(u, v) => (f32::from(u) / 16.0, f32::from(v) / 16.0),
                Said::Growing(u, v) => {
                    let (along, down) = (x as f32 / width as f32, y as f32 / height as f32);
                    (along * f32::from(u) / 16.0, down * f32::from(v) / 16.0)
                }
                Said::Nothing => (f32::NAN, f32::NAN),
                Said::Odd(which) => match (which as usize + x + y) % 4 {
                    0 => (f32::NAN, 0.0),
                    1 => (f32::INFINITY, f32::NEG_INFINITY),
                    2 => (1e30, -1e30),
                    _ => (0.0, f32::MAX),
                },
            };
            uv.extend([u, v]);
        }
    }
    let valid = vec![!matches!(said, Said::Nothing); height * width];
    (uv, valid)
}

/// What is held to be the same, bit by bit.
#[derive(Debug, PartialEq)]
struct Seen {
    moving: Vec<u8>,
    length: Vec<u32>,
    motion: Vec<u32>,
    light: [u32; 2],
    noise: u32,
    parallax: bool,
}

fn check_as<T: Grey>(case: &Case) {
    let size = case.frames.size();
    let (prev, next) = case.frames.pair::<T>();
    let pair = [prev.rows(), next.rows()];
    let flows: Vec<Flow> = case.said.iter().map(|&said| flow(said, size)).collect();
    let masks: Vec<Option<Array2<bool>>> =
        case.masks.iter().map(|&seed| mask(size, seed)).collect();
    let run = |execution: &Execution, parked: bool| -> Option<Vec<Seen>> {
        let options =
            SegmenterOptions::new(case.camera_moves, usize::from(case.min_area), 1.0, 0.3);
        let mut segmenter = MotionSegmenter::new(options, (size.1, size.0)).ok()?;
        let mut seen = Vec::new();
        for number in 0..SHOWN {
            let (uv, valid) = &flows[number % flows.len()];
            let given = GivenFlow {
                uv,
                valid,
                size: (size.1, size.0),
            };
            let counts = masks[number % masks.len()]
                .as_ref()
                .map(|mask| mask.as_slice().unwrap());
            let frame = pair[number % 2].view();
            let said = segmenter
                .update(frame, (number > 0).then_some(given), counts, execution)
                .ok()?;
            let pixels = size.0 * size.1;
            let (mut length, mut motion) = (vec![0.0; pixels], vec![0.0; 2 * pixels]);
            segmenter
                .motion(0.4, &mut length, &mut motion, execution)
                .unwrap();
            seen.push(Seen {
                moving: segmenter.moving().to_vec(),
                length: length.iter().map(|value| value.to_bits()).collect(),
                motion: motion.iter().map(|value| value.to_bits()).collect(),
                light: said.light.map(f32::to_bits),
                noise: said.noise.to_bits(),
                parallax: said.parallax,
            });
            if usize::from(case.reset) % (2 * SHOWN) == number {
                segmenter.reset().unwrap();
            }
            if parked && usize::from(case.parked) % SHOWN == number {
                let kept = segmenter.snapshot();
                segmenter.restore(&kept).unwrap();
            }
        }
        Some(seen)
    };
    let Some(found) = run(&plain(), false) else {
        return;
    };
    for frame in &found {
        assert!(
            frame.moving.iter().all(|&value| value <= 1),
            "moving is 0 or 1"
        );
        assert!(
            f32::from_bits(frame.noise) >= 0.0,
            "noise {}",
            f32::from_bits(frame.noise)
        );
    }
    assert_eq!(
        run(&plain(), true).as_ref(),
        Some(&found),
        "written down and read again"
    );
    for execution in others() {
        assert_eq!(
            run(&execution, false).as_ref(),
            Some(&found),
            "{execution:?}"
        );
    }
}
