//! What a segmenter knows, to go on with elsewhere.

use crate::error::{Error, Result};

use super::parallax::Parallax;
use super::segmenter::Segmenter;
use super::transform::Map;

/// What a segmenter knows: planes one after the other.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct SegmenterSnapshot {
    /// Masks, ages and memories.
    pub bytes: Vec<u8>,
    /// Samples of the background.
    pub samples: Vec<i16>,
    /// Pictures.
    pub floats: Vec<f32>,
    /// Maps, counts and lights.
    pub numbers: Vec<f64>,
}

/// Numbers of a parallax.
const PARALLAX: usize = 16;
/// Numbers of a state.
const NUMBERS: usize = 9 + 9 + 6 + PARALLAX;

impl Segmenter {
    /// What is known, for [`Segmenter::restore`].
    #[must_use]
    pub(super) fn snapshot(&self) -> SegmenterSnapshot {
        let state = &self.state;
        let background = &state.background;
        let bytes = [
            &background.known,
            &background.age,
            &state.confirmed,
            &state.heat,
            &state.shaded,
            &state.foreground,
            &state.lived,
            &state.seen,
            &state.moving,
            &state.earlier.seen[0],
            &state.earlier.seen[1],
        ];
        let floats = [
            &background.median,
            &background.deviation,
            &state.picture,
            &state.prev,
            &state.shadows.seen,
            &state.slow.along,
            &state.slow.across,
            &state.slow.length,
            &state.earlier.pictures[0],
            &state.earlier.pictures[1],
        ];
        let mut numbers: Vec<f64> = state.canvas.to_canvas.iter().flatten().copied().collect();
        numbers.extend(state.motion.iter().flatten());
        let [gain, offset] = state.light.map(f64::from);
        let (noise, spread) = (f64::from(state.noise), f64::from(state.spread));
        numbers.extend([
            state.frames as f64,
            background.frame as f64,
            noise,
            spread,
            gain,
            offset,
        ]);
        numbers.extend(parallax_numbers(state.parallax.as_ref()));
        SegmenterSnapshot {
            bytes: bytes
                .into_iter()
                .chain(state.flutter.planes())
                .flatten()
                .copied()
                .collect(),
            samples: background.samples.clone(),
            floats: floats.into_iter().flatten().copied().collect(),
            numbers,
        }
    }

    /// Take over what [`Segmenter::snapshot`] gave, perhaps elsewhere, of a segmenter of the same options and size.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] where it is of another size.
    pub(super) fn restore(&mut self, snapshot: &SegmenterSnapshot) -> Result<()> {
        let mut state = self.state.clone();
        let background = &mut state.background;
        let (width, height) = self.reduced_size();
        if snapshot.frames() > 0 {
            crate::memory::resize("a frame", &mut state.prev, width * height, 0.0)?;
        } else {
            state.prev.clear();
        }
        let [way, since, path, turns, flutters] = state.flutter.planes_mut();
        let [older, newer] = &mut state.earlier.pictures;
        let [older_seen, newer_seen] = &mut state.earlier.seen;
        let fits = split(
            &snapshot.bytes,
            [
                &mut background.known,
                &mut background.age,
                &mut state.confirmed,
                &mut state.heat,
                &mut state.shaded,
                &mut state.foreground,
                &mut state.lived,
                &mut state.seen,
                &mut state.moving,
                older_seen,
                newer_seen,
                way,
                since,
                path,
                turns,
                flutters,
            ],
        ) && split(
            &snapshot.floats,
            [
                &mut background.median,
                &mut background.deviation,
                &mut state.picture,
                &mut state.prev,
                &mut state.shadows.seen,
                &mut state.slow.along,
                &mut state.slow.across,
                &mut state.slow.length,
                older,
                newer,
            ],
        ) && split(&snapshot.samples, [&mut background.samples])
            && snapshot.numbers.len() == NUMBERS;
        if !fits {
            let sizes = (
                snapshot.bytes.len(),
                snapshot.samples.len(),
                snapshot.floats.len(),
                snapshot.numbers.len(),
            );
            return Err(Error::shape(
                "state",
                format!("parts of {sizes:?} elements"),
                format!("those of frames of {:?}", state.canvas.frame),
            ));
        }
        let numbers = &snapshot.numbers;
        state.canvas.to_canvas = map_of(&numbers[..9]);
        state.motion = map_of(&numbers[9..18]);
        state.frames = numbers[18] as u64;
        state.background.frame = numbers[19] as u64;
        (state.noise, state.spread) = (numbers[20] as f32, numbers[21] as f32);
        state.light = [numbers[22] as f32, numbers[23] as f32];
        state.parallax = parallax_of(&numbers[24..]);
        self.state = state;
        self.work.lit = false;

        Ok(())
    }
}

impl SegmenterSnapshot {
    fn frames(&self) -> usize {
        self.numbers.get(18).map_or(0, |frames| *frames as usize)
    }
}

/// Copy all planes from one run of values, if it has as many.
fn split<T: Copy, const N: usize>(mut values: &[T], planes: [&mut Vec<T>; N]) -> bool {
    if planes.iter().map(|plane| plane.len()).sum::<usize>() != values.len() {
        return false;
    }
    for plane in planes {
        let (own, rest) = values.split_at(plane.len());
        plane.copy_from_slice(own);
        values = rest;
    }
    true
}

fn map_of(values: &[f64]) -> Map {
    let mut map = [[0.0; 3]; 3];
    for (to, from) in map.iter_mut().flatten().zip(values) {
        *to = *from;
    }
    map
}

fn parallax_numbers(parallax: Option<&Parallax>) -> [f64; PARALLAX] {
    let Some(p) = parallax else {
        return [0.0; PARALLAX];
    };
    let [x, y, w] = p.epipole;
    let ([away, towards], truth) = (p.seen, |value: bool| f64::from(u8::from(value)));
    let sign = p.sign.unwrap_or(0.0);
    let (depth, believed) = (truth(p.depth), truth(p.believed));
    let ([a, b, c], [angle, weight]) = (p.travel, p.turned);
    [
        1.0, x, y, w, sign, p.belief, depth, believed, away, towards, a, b, c, angle, weight,
        p.along,
    ]
}

fn parallax_of(numbers: &[f64]) -> Option<Parallax> {
    let [
        there,
        x,
        y,
        w,
        sign,
        belief,
        depth,
        believed,
        away,
        towards,
        a,
        b,
        c,
        angle,
        weight,
        along,
    ] = *numbers.first_chunk::<PARALLAX>()?;
    (there == 1.0).then_some(Parallax {
        epipole: [x, y, w],
        sign: (sign != 0.0).then_some(sign),
        belief,
        depth: depth == 1.0,
        believed: believed == 1.0,
        seen: [away, towards],
        travel: [a, b, c],
        turned: [angle, weight],
        along,
    })
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::super::segmenter::{Segmenter, SegmenterOptions};
    use crate::Execution;

    #[test]
    fn of_one_that_was_begun_anew() {
        let size = (24, 16);
        let mut segmenter =
            Segmenter::new(SegmenterOptions::new(false, 1, 1.0, 0.3), size).unwrap();
        let frame = Array2::from_shape_fn((size.1, size.0), |(y, x)| ((7 * x + 11 * y) % 50) as u8);
        let one = Execution::default().threads(1);
        segmenter.update(frame.view(), None, None, &one).unwrap();
        segmenter.reset().unwrap();
        let kept = segmenter.snapshot();
        segmenter.restore(&kept).unwrap();
        assert_eq!(segmenter.snapshot(), kept);
        segmenter.update(frame.view(), None, None, &one).unwrap();
        assert_eq!(segmenter.moving(), vec![0; size.0 * size.1]);
    }
}
