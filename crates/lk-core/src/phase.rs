//! Phase correlation: how well each whole-pixel displacement explains two pictures, from their Fourier transforms.
//!
//! Kuglin and Hines, "The phase correlation image alignment method", 1975. The cross-power spectrum is whitened only
//! where it stands above its mean, so that frequencies without signal do not add noise.

use std::cell::RefCell;

use realfft::RealFftPlanner;
use realfft::num_complex::Complex32;
use rustfft::FftPlanner;

use crate::error::{Error, Result};
use crate::frame::Plane;

/// The planners keep their plans; one set for each thread, so that nothing is locked when a process forks.
struct Planners {
    real: RealFftPlanner<f32>,
    complex: FftPlanner<f32>,
}

thread_local! {
    static PLANNERS: RefCell<Planners> = RefCell::new(Planners {
        real: RealFftPlanner::new(),
        complex: FftPlanner::new(),
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
    let mut surface = Plane::new(width, height);
    if width == 0 || height == 0 {
        return Ok(surface);
    }
    PLANNERS.with_borrow_mut(|planners| {
        let mut a = forward(planners, prev)?;
        let b = forward(planners, next)?;
        let mean = a
            .iter()
            .zip(&b)
            .map(|(p, n)| f64::from((p.conj() * n).norm_sqr().sqrt()))
            .sum::<f64>()
            / a.len() as f64;
        // A floor of one mean: frequencies below it are weighted by their power, those above count alike.
        let floor = mean as f32 + f32::MIN_POSITIVE;
        for (p, n) in a.iter_mut().zip(&b) {
            let cross = p.conj() * n;
            *p = cross / (cross.norm_sqr().sqrt() + floor);
        }
        inverse(planners, a, &mut surface)?;
        Ok(surface)
    })
}

fn failed(error: &dyn std::fmt::Display) -> Error {
    Error::shape(
        "phase correlation",
        error.to_string(),
        "a length that the transform takes",
    )
}

/// The spectrum, one row for each horizontal frequency.
fn forward(planners: &mut Planners, plane: &Plane) -> Result<Vec<Complex32>> {
    let (width, height) = (plane.width(), plane.height());
    let bins = width / 2 + 1;
    let rows = planners.real.plan_fft_forward(width);
    let columns = planners.complex.plan_fft_forward(height);
    let mut input = rows.make_input_vec();
    let mut output = rows.make_output_vec();
    let mut scratch = rows.make_scratch_vec();
    let mut spectrum = vec![Complex32::default(); bins * height];
    for y in 0..height {
        input.copy_from_slice(plane.row(y));
        rows.process_with_scratch(&mut input, &mut output, &mut scratch)
            .map_err(|error| failed(&error))?;
        for (x, value) in output.iter().enumerate() {
            spectrum[x * height + y] = *value;
        }
    }
    columns.process(&mut spectrum);
    Ok(spectrum)
}

fn inverse(
    planners: &mut Planners,
    mut spectrum: Vec<Complex32>,
    surface: &mut Plane,
) -> Result<()> {
    let (width, height) = (surface.width(), surface.height());
    let columns = planners.complex.plan_fft_inverse(height);
    let rows = planners.real.plan_fft_inverse(width);
    columns.process(&mut spectrum);
    let mut input = rows.make_input_vec();
    let mut scratch = rows.make_scratch_vec();
    let scale = 1.0 / (width * height) as f32;
    for y in 0..height {
        for (x, value) in input.iter_mut().enumerate() {
            *value = spectrum[x * height + y];
        }
        // The first bin of a real row is real, and so is the last of an even one; rounding may have left dust.
        input[0].im = 0.0;
        if width.is_multiple_of(2)
            && let Some(last) = input.last_mut()
        {
            last.im = 0.0;
        }
        let row = surface.row_mut(y);
        rows.process_with_scratch(&mut input, row, &mut scratch)
            .map_err(|error| failed(&error))?;
        for value in row {
            *value *= scale;
        }
    }
    Ok(())
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
            let mut prev = Plane::new(width, height);
            for (i, value) in prev.data_mut().iter_mut().enumerate() {
                *value = ((i * 7919 + 13) % 101) as f32 - 50.0;
            }
            let (dx, dy) = (3 % width, 5 % height);
            let mut next = Plane::new(width, height);
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
        let error = phase_correlation(&Plane::new(4, 4), &Plane::new(4, 5)).unwrap_err();
        assert_eq!(error.to_string(), "next: got 4 x 5, expected 4 x 4");
    }
}
