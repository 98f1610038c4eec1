//! Where a segmenter puts a frame on its canvas: by the camera's motion, then by the background itself.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{replace, resize};
use crate::parallel::{RowsMut, SplitRows, even_bands, for_each_band};

use super::align::{self};
use super::background::moved;
use super::camera::CameraMotion;
use super::canvas::{Canvas, Moved};
use super::flutter::Going;
use super::placed::{self, nearest, nearest_mask, nearest_of_few};
use super::segmenter::Segmenter;
use super::transform::{IDENTITY, Map, inverse, product};
use crate::scratch::with_scratch;

/// Corrections of the registration above this many pixels are seen to again, so many times.
const ALIGNED_PX: f64 = 0.08;
const ALIGNMENTS: usize = 3;
/// A correction beyond this many pixels is none.
const MOST_CORRECTION_PX: f64 = 6.0;

impl Segmenter {
    /// Put the frame on the canvas, in the background's light; give the camera's motion as that has it.
    pub(super) fn follow(&mut self, camera: &CameraMotion, execution: &Execution) -> Result<Map> {
        let before = self.state.canvas.to_canvas;
        let mut to_new = IDENTITY;
        if self.options.camera_moves {
            match self.state.canvas.follow(&camera.homography) {
                Moved::Not => {}
                Moved::By(map) => {
                    self.move_canvas(&map, execution)?;
                    to_new = inverse(&map).unwrap_or(IDENTITY);
                }
                Moved::Lost => {
                    self.state.canvas = Canvas::new(self.state.canvas.frame, true);
                    self.forget()?;
                }
            }
        }
        // The picture and where it was seen are of the frame before until `decide` has compared them.
        self.work.both.clear();
        replace(
            "masks",
            &mut self.work.both,
            self.state.seen.iter().copied(),
        )?;
        self.warp(execution)?;
        self.place_moving(execution)?;
        self.match_light(execution)?;
        if !self.options.camera_moves {
            self.place_going(execution)?;
            return Ok(camera.homography);
        }
        let placed = self.state.canvas.to_canvas;
        for _ in 0..ALIGNMENTS {
            let of = align::Pictures {
                size: self.state.canvas.size,
                background: &self.state.background.median,
                picture: &self.work.raw,
                still: &self.work.still,
                noise: self.state.noise,
            };
            let (step, most) = self.work.alignment.step(&of, execution)?;
            if most.is_nan() || most >= MOST_CORRECTION_PX {
                break;
            }
            self.state.canvas.to_canvas = product(&step, &self.state.canvas.to_canvas);
            if most < ALIGNED_PX {
                break;
            }
            self.warp(execution)?;
            self.relight(execution)?;
        }
        if self.state.canvas.to_canvas != placed {
            self.place_moving(execution)?;
        }
        self.place_going(execution)?;
        Ok(product(
            &self.state.canvas.to_frame(),
            &product(&to_new, &before),
        ))
    }

    pub(super) fn move_canvas(&mut self, map: &Map, execution: &Execution) -> Result<()> {
        let state = &mut self.state;
        let size = state.canvas.size;
        state.background.moved(map, execution)?;
        for mask in [
            &mut state.confirmed,
            &mut state.heat,
            &mut state.shaded,
            &mut state.foreground,
            &mut state.lived,
            &mut state.seen,
        ] {
            moved(mask, size, map, 0, execution)?;
        }
        state.flutter.moved(size, map, execution)?;
        for plane in &mut state.earlier.pictures {
            moved(plane, size, map, 0.0, execution)?;
        }
        for plane in &mut state.earlier.seen {
            moved(plane, size, map, 0, execution)?;
        }
        moved(&mut state.picture, size, map, 0.0, execution)
    }

    /// The frame on the canvas, and where it is.
    pub(super) fn warp(&mut self, execution: &Execution) -> Result<()> {
        let (frame, size) = (self.state.canvas.frame, self.state.canvas.size);
        let pixels = size.0 * size.1;
        resize("a picture", &mut self.work.raw, pixels, 0.0)?;
        if self.state.canvas.rests() {
            self.work.raw.copy_from_slice(&self.work.frame);
            self.state.seen.copy_from_slice(&self.work.counts_canvas);
            return Ok(());
        }
        let map = self.state.canvas.to_frame();
        let moved = placed::Moved {
            from: (&self.work.frame, frame),
            map: &map,
        };
        let level = execution.simd_level();
        let outputs = Warped(
            RowsMut::new(&mut self.work.raw, size.0),
            RowsMut::new(&mut self.state.seen, size.0),
        );
        let rows = even_bands(execution, size.1, [32_768 / size.0, 8192 / size.0]);
        for_each_band(execution, size.1, rows, outputs, |band, mut part| {
            with_scratch(2 * size.0, |spare| {
                for (local, y) in band.enumerate() {
                    moved.row(
                        y,
                        part.0.row_mut(local),
                        part.1.row_mut(local),
                        spare,
                        level,
                    );
                }
            })
        })?;
        if self.work.counts_canvas.contains(&0) {
            resize("masks", &mut self.work.spare, pixels, 0)?;
            nearest(
                (&self.work.counts_canvas, frame),
                &map,
                (&mut self.work.spare, size),
                0,
                execution,
            )?;
            for (seen, counts) in self.state.seen.iter_mut().zip(&self.work.spare) {
                *seen &= counts;
            }
        }
        Ok(())
    }

    /// From pixels of the canvas to those that flow is judged on.
    pub(super) fn to_reduced(&self) -> Map {
        let factor = self.factor() as f64;
        let s = (1.0 / factor - 1.0) / 2.0;
        let down = [
            [1.0 / factor, 0.0, s],
            [0.0, 1.0 / factor, s],
            [0.0, 0.0, 1.0],
        ];
        product(&down, &self.state.canvas.to_frame())
    }

    /// What moves by its flow, on the canvas.
    pub(super) fn place_moving(&mut self, execution: &Execution) -> Result<()> {
        let (size, small, map) = (
            self.state.canvas.size,
            self.reduced_size(),
            self.to_reduced(),
        );
        resize("masks", &mut self.work.by_flow, size.0 * size.1, 0)?;
        nearest_mask(
            (&self.work.evidence.moving, small),
            &map,
            (&mut self.work.by_flow, size),
            execution,
        )?;
        // What goes to and fro is no thing.
        let places = self.state.seen.iter().zip(&self.state.flutter.mask);
        for (by_flow, (seen, flutters)) in self.work.by_flow.iter_mut().zip(places) {
            *by_flow &= seen & (1 - flutters);
        }
        Ok(())
    }

    /// Which way it goes there.
    fn place_going(&mut self, execution: &Execution) -> Result<()> {
        let (size, small, map) = (
            self.state.canvas.size,
            self.reduced_size(),
            self.to_reduced(),
        );
        let nowhere = Going::default();
        resize("directions", &mut self.work.going, size.0 * size.1, nowhere)?;
        nearest_of_few(
            (&self.work.evidence.going, small),
            |going| going.goes(),
            &map,
            (&mut self.work.going, size),
            nowhere,
            execution,
        )
    }
}

struct Warped<'a>(RowsMut<'a, f32>, RowsMut<'a, u8>);

impl SplitRows for Warped<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at_row(row), self.1.split_at_row(row));
        (Self(a.0, b.0), Self(a.1, b.1))
    }
}
