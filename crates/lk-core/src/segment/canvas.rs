//! Where the frames of a camera lie on the canvas that the background is kept on: moved by whole pixels as the view moves,
//! drawn anew where its scale changed.

use super::morphology::Size;
use super::transform::{IDENTITY, Map, applied, inverse, product, shift};

/// Pixels around a frame, and the smallest and largest share that a frame may take of its own area on the canvas.
const PAD: usize = 32;
const SCALES: [f64; 2] = [0.75, 1.35];

/// The canvas of one camera.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Canvas {
    /// Columns and rows of a frame.
    pub(crate) frame: Size,
    /// Columns and rows of the canvas.
    pub(crate) size: Size,
    /// From a pixel of the frame to the canvas.
    pub(crate) to_canvas: Map,
    pad: usize,
}

impl Canvas {
    /// For frames of a size, of a camera that is at rest or not.
    pub(crate) fn new(frame: Size, moves: bool) -> Self {
        let pad = if moves {
            PAD.min(frame.0.max(frame.1) / 4)
        } else {
            0
        };
        let mut canvas = Self {
            frame,
            size: (frame.0 + 2 * pad, frame.1 + 2 * pad),
            to_canvas: IDENTITY,
            pad,
        };
        canvas.to_canvas = canvas.home();
        canvas
    }

    fn home(&self) -> Map {
        shift(self.pad as f64, self.pad as f64)
    }

    /// Whether frames lie on the canvas as they are.
    pub(crate) fn rests(&self) -> bool {
        self.pad == 0
    }

    /// From a pixel of the canvas to the frame.
    pub(crate) fn to_frame(&self) -> Map {
        inverse(&self.to_canvas).unwrap_or(IDENTITY)
    }

    /// Go on to the next frame, whose pixels are where `motion` takes those of the one before. Give the map from the canvas as
    /// it is from now on to what it was before, if it changed, or that the view is lost.
    pub(crate) fn follow(&mut self, motion: &Map) -> Moved {
        let Some(back) = inverse(motion) else {
            return Moved::Lost;
        };
        self.to_canvas = product(&self.to_canvas, &back);
        let (w, h) = (self.frame.0 as f64 - 1.0, self.frame.1 as f64 - 1.0);
        let corners =
            [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|corner| applied(&self.to_canvas, corner));
        if corners.iter().flatten().any(|value| !value.is_finite()) {
            return Moved::Lost;
        }
        let area: f64 = (0..4)
            .map(|k| (corners[k], corners[(k + 1) % 4]))
            .map(|([ax, ay], [bx, by])| (ax * by - bx * ay) / 2.0)
            .sum();
        let scale = area / (w * h).max(1.0);
        let mut by = [0.0; 2];
        let mut fits = scale > SCALES[0] && scale < SCALES[1];
        for axis in 0..2 {
            let values = corners.map(|corner| corner[axis]);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let room = [self.size.0, self.size.1][axis] as f64 - 1.0;
            fits &= high - low <= room - 2.0;
            // Most of the room goes to the side that the view moves to.
            let spare = room - (high - low);
            if low < 0.0 {
                by[axis] = (0.75 * spare - low).round();
            } else if high > room {
                by[axis] = (room - 0.75 * spare - high).round();
            }
        }
        if !fits {
            let to_old = product(
                &self.to_canvas,
                &shift(-(self.pad as f64), -(self.pad as f64)),
            );
            self.to_canvas = self.home();
            return Moved::By(to_old);
        }
        if by == [0.0; 2] {
            return Moved::Not;
        }
        self.to_canvas = product(&shift(by[0], by[1]), &self.to_canvas);
        Moved::By(shift(-by[0], -by[1]))
    }
}

/// What became of the canvas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Moved {
    /// It is as it was.
    Not,
    /// From its pixels to those it had before.
    By(Map),
    /// Nothing of it is of use.
    Lost,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pan_moves_the_canvas_by_whole_pixels_and_loses_nothing() {
        let mut canvas = Canvas::new((320, 240), true);
        let mut place = applied(&canvas.to_canvas, [100.0, 100.0]);
        for k in 1..40 {
            let motion = shift(-3.3, 1.1);
            let moved = canvas.follow(&motion);
            if let Moved::By(map) = moved {
                place = applied(&inverse(&map).unwrap(), place);
                assert!(map[0][2].fract() == 0.0 && map[1][2].fract() == 0.0);
            }
            // The same point of the scene.
            let seen = [100.0 - 3.3 * f64::from(k), 100.0 + 1.1 * f64::from(k)];
            let now = applied(&canvas.to_canvas, seen);
            assert!((now[0] - place[0]).abs() + (now[1] - place[1]).abs() < 1e-9);
            for corner in [[0.0, 0.0], [319.0, 239.0]] {
                let [x, y] = applied(&canvas.to_canvas, corner);
                assert!(
                    x >= 0.0 && y >= 0.0 && x < canvas.size.0 as f64 && y < canvas.size.1 as f64
                );
            }
        }
    }

    #[test]
    fn a_zoom_draws_the_canvas_anew() {
        let mut canvas = Canvas::new((320, 240), true);
        let zoom = [[1.05, 0.0, -8.0], [0.0, 1.05, -6.0], [0.0, 0.0, 1.0]];
        let anew = (0..20)
            .filter(|_| canvas.follow(&zoom) != Moved::Not)
            .count();
        assert!((1..10).contains(&anew), "{anew}");
        assert_eq!(canvas.follow(&[[0.0; 3]; 3]), Moved::Lost);
    }
}
