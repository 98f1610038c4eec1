//! Pictures of the canvas of some frames ago: what moves slowly has gone far enough since to show it.

use crate::error::Result;
use crate::memory::resize;

use super::morphology::Size;
use super::slow::{Differences, Slow, SlowWork};
use super::transform::{Map, applied};

/// Frames after which a picture is kept; the older of two is what a frame is compared with.
const EVERY: u64 = 8;
/// Squared differences count up to so many times the noise's.
const MOST: f32 = 36.0;
/// A thing's motion explains the picture so many times better than rest, and by this much of what noise makes of a pixel.
const BETTER: f32 = 1.25;
const GAIN: f32 = 0.5;
/// Not in places of so many pixels along each side which rest explains better by this factor, and by so much.
const CELL: usize = 8;
const WORSE: f32 = 1.2;
const ABOVE: f32 = 0.25;

/// The pictures, and where they were seen.
#[derive(Debug, Clone, Default)]
pub(crate) struct Earlier {
    pub(crate) pictures: [Vec<f32>; 2],
    pub(crate) seen: [Vec<u8>; 2],
}

/// What a slow motion is held to.
pub(super) struct Now<'a> {
    pub(super) size: Size,
    pub(super) picture: &'a [f32],
    pub(super) to_canvas: &'a Map,
    /// Frames since the older picture.
    pub(super) age: f64,
    pub(super) noise: f32,
    /// Pixels of a frame in one that flow is judged on.
    pub(super) factor: f64,
}

impl Earlier {
    /// Nothing is known.
    pub(crate) fn reset(&mut self, pixels: usize) -> Result<()> {
        for plane in &mut self.pictures {
            plane.clear();
            resize("a picture", plane, pixels, 0.0)?;
        }
        for plane in &mut self.seen {
            plane.clear();
            resize("masks", plane, pixels, 0)?;
        }
        Ok(())
    }

    /// Forget the pictures: the background has another light from now on.
    pub(super) fn forget(&mut self) {
        for plane in &mut self.seen {
            plane.fill(0);
        }
    }

    /// Keep a picture of the canvas now and then.
    pub(super) fn keep(&mut self, picture: &[f32], seen: &[u8], frame: u64) {
        if frame.is_multiple_of(EVERY) {
            self.pictures.swap(0, 1);
            self.seen.swap(0, 1);
            self.pictures[1].copy_from_slice(picture);
            self.seen[1].copy_from_slice(seen);
        }
    }

    /// How old the older one is.
    pub(super) fn age(frame: u64) -> f64 {
        (EVERY + frame % EVERY) as f64
    }

    /// The older picture between pixels, where it was seen.
    fn at(&self, size: Size, place: [f64; 2]) -> Option<f32> {
        let (corner, [fx, fy]) = corner_of(size, place)?;
        let (seen, plane, below) = (&self.seen[0], &self.pictures[0], corner + size.0);
        if seen[corner] & seen[corner + 1] & seen[below] & seen[below + 1] == 0 {
            return None;
        }
        Some(between(plane, [corner, below], [fx, fy]))
    }

    /// How a pixel that flow is judged on differs from where it was, by the motion there and without.
    fn differences(&self, slow: &Slow, of: &Now<'_>, width: usize, at: usize) -> Differences {
        let shift = (of.factor - 1.0) / 2.0;
        let here = [at % width, at / width].map(|at| at as f64 * of.factor + shift);
        let way = slow.at(at).map(|part| f64::from(part) * of.factor * of.age);
        let place = applied(of.to_canvas, here);
        let before = applied(of.to_canvas, [here[0] - way[0], here[1] - way[1]]);
        let (Some(rest), Some(moved)) = (self.at(of.size, place), self.at(of.size, before)) else {
            return Differences::default();
        };
        let Some((corner, share)) = corner_of(of.size, place) else {
            return Differences::default();
        };
        let now = between(of.picture, [corner, corner + of.size.0], share);
        let most = MOST * 2.0 * of.noise * of.noise;
        Differences {
            rest: ((now - rest) * (now - rest)).min(most),
            moved: ((now - moved) * (now - moved)).min(most),
            count: 1.0,
        }
    }

    /// Keep what has moved since, by the picture too.
    pub(super) fn confirm(
        &self,
        slow: &Slow,
        of: &Now<'_>,
        size: Size,
        work: &mut SlowWork,
    ) -> Result<()> {
        let columns = size.0.div_ceil(CELL);
        let cell = |at: usize| (at / size.0 / CELL) * columns + (at % size.0) / CELL;
        work.runs.label(&work.moving, size)?;
        let none = Differences::default();
        let (regions, cells) = (work.runs.regions().len(), columns * size.1.div_ceil(CELL));
        let [whole, parts] = &mut work.differences;
        for (sums, count) in [(&mut *whole, regions), (&mut *parts, cells)] {
            sums.clear();
            resize("differences", sums, count, none)?;
        }
        for run in work.runs.runs() {
            for at in run.place(size.0) {
                let one = self.differences(slow, of, size.0, at);
                whole[run.label as usize].add(one);
                parts[cell(at)].add(one);
            }
        }
        let noise = 2.0 * of.noise * of.noise;
        work.any = false;
        for run in work.runs.runs() {
            let moved = whole[run.label as usize].moved(noise);
            for at in run.place(size.0) {
                let keep = moved && !parts[cell(at)].rests(noise);
                work.moving[at] = u8::from(keep);
                work.any |= keep;
            }
        }
        Ok(())
    }
}

impl Differences {
    fn add(&mut self, other: Self) {
        self.rest += other.rest;
        self.moved += other.moved;
        self.count += other.count;
    }

    /// Whether motion explains what is seen, where noise makes a squared difference of `noise`.
    fn moved(self, noise: f32) -> bool {
        self.rest > BETTER * self.moved && self.rest - self.moved > GAIN * noise * self.count
    }

    /// Whether rest does, and better.
    fn rests(self, noise: f32) -> bool {
        self.moved > WORSE * self.rest + ABOVE * noise * self.count
    }
}

/// The pixel on the upper left of a place, and how far from it that is.
fn corner_of((width, height): Size, [x, y]: [f64; 2]) -> Option<(usize, [f32; 2])> {
    let inside = x >= 0.0 && y >= 0.0 && x + 1.0 < width as f64 && y + 1.0 < height as f64;
    let (left, top) = (x as usize, y as usize);
    let share = [x - left as f64, y - top as f64].map(|share| share as f32);
    inside.then_some((top * width + left, share))
}

fn between(plane: &[f32], [above, below]: [usize; 2], [fx, fy]: [f32; 2]) -> f32 {
    let [above, below] = [above, below].map(|k| plane[k] + fx * (plane[k + 1] - plane[k]));
    above + fy * (below - above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::made::greys;
    use crate::segment::transform::IDENTITY;

    const SIZE: Size = (48, 48);

    /// What is left of a patch of 16 x 16 pixels that flow says to have gone a quarter of a pixel a frame for 8 frames, where
    /// its picture has gone so far.
    fn left(gone: usize) -> usize {
        let (ground, thing) = (greys(SIZE, 3), greys(SIZE, 5));
        let patch = |at: usize| {
            let mut picture = ground.clone();
            for y in 16..32 {
                let to = &mut picture[y * 48 + at..y * 48 + at + 16];
                to.copy_from_slice(&thing[y * 48..y * 48 + 16]);
            }
            picture
        };
        let mut earlier = Earlier::default();
        earlier.reset(48 * 48).unwrap();
        earlier.keep(&patch(16), &[1; 48 * 48], 8);
        earlier.keep(&patch(16), &[1; 48 * 48], 16);
        let mut slow = Slow::default();
        slow.reset(SIZE).unwrap();
        slow.along.fill(0.25);
        let mut work = SlowWork::default();
        work.moving.resize(48 * 48, 0);
        for y in 16..32 {
            work.moving[y * 48 + 16 + gone..y * 48 + 32 + gone].fill(1);
        }
        let now = Now {
            size: SIZE,
            picture: &patch(16 + gone),
            to_canvas: &IDENTITY,
            age: 8.0,
            noise: 1.0,
            factor: 1.0,
        };
        earlier.confirm(&slow, &now, SIZE, &mut work).unwrap();
        let left = work.moving.iter().filter(|moving| **moving == 1).count();
        assert_eq!(work.any, left > 0);
        left
    }

    #[test]
    fn a_picture_of_before_tells_what_has_gone() {
        assert_eq!(left(2), 256);
        assert_eq!(left(0), 0);
    }
}
