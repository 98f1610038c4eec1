//! Phase correlation: how well each whole-pixel displacement explains two pictures, from their Fourier transforms.
//!
//! Kuglin and Hines, "The phase correlation image alignment method", 1975. The cross-power spectrum is whitened only
//! where it stands above its mean, so that frequencies without signal do not add noise.
//!
//! `docs/explanation/algorithms.md`, section "Start: phase correlation and rivals".

use std::cell::RefCell;

use realfft::RealFftPlanner;
use realfft::num_complex::Complex32;
use rustfft::FftPlanner;

use crate::error::{Error, Result};
use crate::frame::Plane;
use crate::memory::{reserve, resize};

/// Plans and buffers, kept from call to call; one set for each thread, so that nothing is locked when a process forks.
struct Transforms {
    real: RealFftPlanner<f32>,
    complex: FftPlanner<f32>,
    row: Vec<f32>,
    half: Vec<Complex32>,
    scratch: Vec<Complex32>,
    prev: Vec<Complex32>,
    next: Vec<Complex32>,
}

thread_local! {
    static TRANSFORMS: RefCell<Transforms> = RefCell::new(Transforms {
        real: RealFftPlanner::new(),
        complex: FftPlanner::new(),
        row: Vec::new(),
        half: Vec::new(),
        scratch: Vec::new(),
        prev: Vec::new(),
        next: Vec::new(),
    });
}

/// The smallest length of at least `length` that has no prime factor above 5.
pub(crate) fn fast_length(length: usize) -> usize {
    let mut candidate = length.max(1);
    loop {
        let mut rest = candidate;
        for prime in [2, 3, 5] {
            while rest.is_multiple_of(prime) {
                rest /= prime;
            }
        }
        if rest == 1 {
            return candidate;
        }
        candidate += 1;
    }
}

/// The correlation surface of two planes of one size: its value at (x, y), taken modulo the size, says how well
/// `next(p + (x, y)) = prev(p)` holds. Both should fade to zero at their borders.
///
/// # Errors
///
/// [`Error::Shape`] if the sizes differ.
pub(crate) fn phase_correlation(prev: &Plane, next: &Plane) -> Result<Plane> {
    let (width, height) = (prev.width(), prev.height());
    if (next.width(), next.height()) != (width, height) {
        return Err(Error::shape(
            "next",
            format!("{} x {}", next.width(), next.height()),
            format!("{width} x {height}"),
        ));
    }
    let mut surface = Plane::new(width, height)?;
    let rows = |plane: &Plane, y: usize, row: &mut [f32]| {
        row.copy_from_slice(plane.row(y));
        true
    };
    correlate_rows(
        |y, row| rows(prev, y, row),
        |y, row| rows(next, y, row),
        &mut surface,
    )?;
    Ok(surface)
}

/// [`phase_correlation`] of pictures that are given row by row, in the size of `surface`: each function writes row `y`,
/// or says that it is zero.
///
/// # Errors
///
/// [`Error::Shape`] if the transform refuses the size.
pub(crate) fn correlate_rows(
    prev: impl FnMut(usize, &mut [f32]) -> bool,
    next: impl FnMut(usize, &mut [f32]) -> bool,
    surface: &mut Plane,
) -> Result<()> {
    let (width, height) = (surface.width(), surface.height());
    if width == 0 || height == 0 {
        return Ok(());
    }
    TRANSFORMS.with_borrow_mut(|transforms| {
        let (mut a, mut b) = (
            std::mem::take(&mut transforms.prev),
            std::mem::take(&mut transforms.next),
        );
        transforms.forward(prev, [width, height], &mut a)?;
        transforms.forward(next, [width, height], &mut b)?;
        let mut sum = 0.0f64;
        for (p, n) in a.iter_mut().zip(&b) {
            *p = p.conj() * n;
            sum += f64::from(p.norm_sqr().sqrt());
        }
        // A floor of one mean: frequencies below it are weighted by their power, those above count alike.
        let floor = (sum / a.len() as f64) as f32 + f32::MIN_POSITIVE;
        for p in &mut a {
            *p /= p.norm_sqr().sqrt() + floor;
        }
        let found = transforms.inverse(&mut a, surface);
        (transforms.prev, transforms.next) = (a, b);
        found
    })
}

fn failed(error: &dyn std::fmt::Display) -> Error {
    Error::shape(
        "phase correlation",
        error.to_string(),
        "a length that the transform takes",
    )
}

/// Whether there is memory for the plans of both lengths: the planners do not ask.
fn room_for_plans(lengths: [usize; 2]) -> Result<()> {
    // The factors of a plan and of those that it is made of, and what these need meanwhile.
    const NUMBERS: usize = 4;
    let count = lengths.into_iter().sum::<usize>() * NUMBERS;
    reserve("plans of a transform", &mut Vec::<Complex32>::new(), count)
}

impl Transforms {
    /// The spectrum, one row for each horizontal frequency.
    fn forward(
        &mut self,
        mut write: impl FnMut(usize, &mut [f32]) -> bool,
        [width, height]: [usize; 2],
        spectrum: &mut Vec<Complex32>,
    ) -> Result<()> {
        room_for_plans([width, height])?;
        let rows = self.real.plan_fft_forward(width);
        let columns = self.complex.plan_fft_forward(height);
        self.buffers(
            width,
            rows.get_scratch_len(),
            columns.get_inplace_scratch_len(),
        )?;
        let count = (width / 2 + 1) * height;
        spectrum.clear();
        resize("a spectrum", spectrum, count, Complex32::default())?;
        for y in 0..height {
            if !write(y, &mut self.row) {
                continue;
            }
            let scratch = &mut self.scratch[..rows.get_scratch_len()];
            rows.process_with_scratch(&mut self.row, &mut self.half, scratch)
                .map_err(|error| failed(&error))?;
            for (column, value) in spectrum.chunks_exact_mut(height).zip(&self.half) {
                column[y] = *value;
            }
        }
        columns.process_with_scratch(spectrum, &mut self.scratch);
        Ok(())
    }

    fn inverse(&mut self, spectrum: &mut [Complex32], surface: &mut Plane) -> Result<()> {
        let (width, height) = (surface.width(), surface.height());
        room_for_plans([width, height])?;
        let columns = self.complex.plan_fft_inverse(height);
        let rows = self.real.plan_fft_inverse(width);
        self.buffers(
            width,
            rows.get_scratch_len(),
            columns.get_inplace_scratch_len(),
        )?;
        columns.process_with_scratch(spectrum, &mut self.scratch);
        let scale = 1.0 / (width * height) as f32;
        for y in 0..height {
            for (value, column) in self.half.iter_mut().zip(spectrum.chunks_exact(height)) {
                *value = column[y];
            }
            // The first bin of a real row is real, and so is the last of an even one; rounding may have left dust.
            self.half[0].im = 0.0;
            if width.is_multiple_of(2)
                && let Some(last) = self.half.last_mut()
            {
                last.im = 0.0;
            }
            let row = surface.row_mut(y);
            let scratch = &mut self.scratch[..rows.get_scratch_len()];
            rows.process_with_scratch(&mut self.half, row, scratch)
                .map_err(|error| failed(&error))?;
            for value in row {
                *value *= scale;
            }
        }
        Ok(())
    }

    /// Give the buffers the lengths of these transforms.
    fn buffers(&mut self, width: usize, row_scratch: usize, column_scratch: usize) -> Result<()> {
        let (none, scratch) = (Complex32::default(), row_scratch.max(column_scratch));
        resize("a row", &mut self.row, width, 0.0)?;
        resize("a spectrum", &mut self.half, width / 2 + 1, none)?;
        resize("a transform", &mut self.scratch, scratch, none)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_lengths_have_small_factors() {
        let found: Vec<usize> = [0, 1, 7, 11, 13, 31, 97, 121]
            .into_iter()
            .map(fast_length)
            .collect();
        assert_eq!(found, [1, 1, 8, 12, 15, 32, 100, 125]);
    }

    #[test]
    fn the_peak_is_the_circular_displacement() {
        for (width, height) in [(16, 12), (15, 9), (32, 20), (1, 8), (8, 1)] {
            let mut prev = Plane::new(width, height).unwrap();
            for (i, value) in prev.data_mut().iter_mut().enumerate() {
                *value = ((i * 7919 + 13) % 101) as f32 - 50.0;
            }
            let (dx, dy) = (3 % width, 5 % height);
            let mut next = Plane::new(width, height).unwrap();
            for y in 0..height {
                for x in 0..width {
                    next.row_mut((y + dy) % height)[(x + dx) % width] = prev.row(y)[x];
                }
            }
            let surface = phase_correlation(&prev, &next).unwrap();
            let best = (0..width * height)
                .max_by(|a, b| surface.data()[*a].total_cmp(&surface.data()[*b]))
                .unwrap();
            assert_eq!((best % width, best / width), (dx, dy), "{width} x {height}");
        }
    }

    #[test]
    fn different_sizes_are_an_error() {
        let error =
            phase_correlation(&Plane::new(4, 4).unwrap(), &Plane::new(4, 5).unwrap()).unwrap_err();
        assert_eq!(error.to_string(), "next: got 4 x 5, expected 4 x 4");
    }
}
