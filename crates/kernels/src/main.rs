//! One kernel, once, for a tool that counts instructions: `kernels NAME`; `kernels --list` names them. All work of a name
//! happens in [`measured_kernel`], on one thread, after a first call that has made its buffers. `.ci/count_instructions.py`
//! holds the counts to recorded ones. Without a name every kernel runs once.
#![allow(clippy::print_stdout, reason = "it is a program")]

#[path = "../../lk-core/benches/made/mod.rs"]
mod made;

use std::hint::black_box;

use lk_core::{
    CornerDetector, CornerOptions, DenseFlow, DenseHints, DenseOptions, Distortion, Execution,
    FlowField, GivenFlow, GridOptions, Lens, Masks, MotionSegmenter, PlaneInterval, PlaneOptions,
    PlaneTracker, Preset, Pyramid, Result, SegmenterOptions, ShiftOptions, TrackOptions,
    detect_corners, displacement_grid, estimate_shift, find_parallax, fit_camera, track_points,
};
use ndarray::s;

use made::{SHIFT, pair, vectors};

type Kernel = (&'static str, fn() -> Result<()>);

const KERNELS: &[Kernel] = &[
    ("pyramid", pyramid),
    ("shift 60x60", shift),
    ("corners", corners),
    ("track 100 points", track),
    ("dense ultrafast", || dense(Preset::Ultrafast, false)),
    ("dense fast", || dense(Preset::Fast, false)),
    ("dense balanced", || dense(Preset::Balanced, false)),
    ("dense accurate", || dense(Preset::Accurate, false)),
    ("dense fast, covariance", || dense(Preset::Fast, true)),
    ("grid", grid),
    ("plane", plane),
    ("camera and parallax", cameras),
    ("what moves, still camera", || moving(false)),
    ("what moves, moving camera", || moving(true)),
];

/// What is counted.
#[inline(never)]
fn measured_kernel(run: &mut dyn FnMut() -> Result<()>) -> Result<()> {
    run()
}

/// Twice: the first time with buffers still to be made, the second time counted.
fn measure(mut run: impl FnMut() -> Result<()>) -> Result<()> {
    run()?;
    measured_kernel(&mut run)
}

fn one() -> Execution {
    Execution::default().threads(1)
}

fn pyramid() -> Result<()> {
    let (prev, _) = pair(320, 240);
    let mut built = Pyramid::new(prev.view(), 5, &one())?;
    measure(|| built.rebuild(prev.view(), 5, &one()))?;
    black_box(built.levels().len());
    Ok(())
}

fn shift() -> Result<()> {
    let (prev, next) = pair(60, 60);
    let options = ShiftOptions::default().execution(one());
    measure(|| {
        let found = estimate_shift(prev.view(), next.view(), Masks::default(), &options)?;
        assert!((found.dx - SHIFT.0).abs() < 0.05);
        Ok(())
    })
}

fn corners() -> Result<()> {
    let (prev, _) = pair(320, 240);
    let options = CornerOptions::default().max_corners(100).execution(one());
    let (mut detector, mut found) = (CornerDetector::default(), Vec::new());
    measure(|| detector.detect(prev.view(), None, &options, &mut found))?;
    assert_eq!(found.len(), 100);
    Ok(())
}

fn track() -> Result<()> {
    let (prev, next) = pair(320, 240);
    let corners = CornerOptions::default().max_corners(100).execution(one());
    let found = detect_corners(prev.view(), None, &corners)?;
    let positions: Vec<[f32; 2]> = found.iter().map(|corner| corner.position).collect();
    let options = TrackOptions::default().execution(one());
    measure(|| {
        let masks = Masks::default();
        let tracks = track_points(prev.view(), next.view(), &positions, None, masks, &options);
        assert_eq!(tracks?.len(), 100);
        Ok(())
    })
}

fn dense(preset: Preset, covariance: bool) -> Result<()> {
    let (prev, next) = pair(160, 120);
    let options = DenseOptions::default()
        .preset(preset)
        .covariance(covariance)
        .execution(one());
    let (mut flow, mut field) = (DenseFlow::new(options)?, FlowField::default());
    measure(|| {
        let hints = DenseHints::default();
        flow.pair(prev.view(), next.view(), hints, &mut field)
    })
}

fn grid() -> Result<()> {
    let (prev, next) = pair(160, 120);
    let options = GridOptions::default().execution(one());
    measure(|| {
        let masks = Masks::default();
        let found = displacement_grid(prev.view(), next.view(), None, masks, &options)?;
        assert!(found.nodes.iter().all(lk_core::GridNode::is_valid));
        Ok(())
    })
}

fn plane() -> Result<()> {
    let frames = pair(320, 240);
    let camera = Lens::new([320.0; 2], [159.5, 119.5], Distortion::Brown([0.0; 12]))?;
    let mut tracker = PlaneTracker::new(camera);
    let options = PlaneOptions::default()
        .rotation_std([1e-4; 3])
        .execution(one());
    tracker.push(frames.0.view(), None, &one())?;
    let mut sign = 1.0;
    measure(|| {
        let frame = if sign > 0.0 { &frames.1 } else { &frames.0 };
        tracker.push(frame.view(), None, &one())?;
        let way = [-sign * (SHIFT.0 + 0.5) / 320.0, -sign * SHIFT.1 / 320.0];
        let start = [way[0], way[1], 0.0, 0.0, 0.0, 0.0];
        let fit = tracker.motion(&PlaneInterval::default(), &start, &options);
        assert!(fit?.is_some());
        sign = -sign;
        Ok(())
    })
}

fn cameras() -> Result<()> {
    let (few, many) = (vectors(25, 20), vectors(60, 50));
    measure(|| {
        let camera = fit_camera(&few, None);
        black_box(find_parallax(&many, &camera, None));
        Ok(())
    })
}

/// Sixteen frames in which a square crosses the scene, and one more that is counted.
fn moving(camera_moves: bool) -> Result<()> {
    const SIZE: (usize, usize) = (160, 120);
    let step = if camera_moves { 1.0 } else { 0.0 };
    let (wide, _) = pair(SIZE.0 + 20, SIZE.1);
    let frame = |number: usize| {
        let start = (number as f64 * step) as usize;
        let mut frame = wide.slice(s![.., start..start + SIZE.0]).to_owned();
        frame
            .slice_mut(s![50..70, 20 + 3 * number..40 + 3 * number])
            .map_inplace(|level| *level = 255 - *level / 2);
        frame
    };
    let mut flow = DenseFlow::new(
        DenseOptions::default()
            .preset(Preset::Fast)
            .execution(one()),
    )?;
    let options = SegmenterOptions::new(camera_moves, 9, 1.0, 0.29);
    let mut segmenter = MotionSegmenter::new(options, SIZE)?;
    let mut field = FlowField::default();
    segmenter.update(frame(0).view(), None, None, &one())?;
    for number in 1..=16 {
        let (prev, next) = (frame(number - 1), frame(number));
        flow.pair(prev.view(), next.view(), DenseHints::default(), &mut field)?;
        let mut update = || {
            let given = GivenFlow {
                uv: field.uv(),
                valid: field.valid(),
                size: SIZE,
            };
            let seen = segmenter.update(next.view(), Some(given), None, &one());
            seen.map(drop)
        };
        if number == 16 {
            measured_kernel(&mut update)?;
        } else {
            update()?;
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let named: Vec<String> = std::env::args().skip(1).collect();
    if named.iter().any(|name| name == "--list") {
        for (name, _) in KERNELS {
            println!("{name}");
        }
        return Ok(());
    }
    for (name, run) in KERNELS {
        if named.is_empty() || named.iter().any(|wanted| wanted == name) {
            run()?;
        }
    }
    Ok(())
}
