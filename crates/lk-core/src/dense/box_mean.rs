//! A grid of cells some of which may not be known: what stands for those, and the mean of what is around each.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of dense flow".

use crate::error::Result;
use crate::memory::resize;

/// Give cells that are not known, NaN, the value of the one before them in their row, or of the first that is known.
pub(super) fn carry(cells: &mut [f32], columns: usize) {
    let first = |row: &[f32]| row.iter().copied().find(|value| !value.is_nan());
    let mut last = f32::NAN;
    for row in cells.chunks_exact_mut(columns) {
        last = first(row).unwrap_or(last);
        for value in row {
            if value.is_nan() {
                *value = last;
            }
            last = *value;
        }
    }
    // Rows above the first that is known.
    let Some(known) = first(cells) else { return };
    for value in cells.iter_mut().take_while(|value| value.is_nan()) {
        *value = known;
    }
}

/// Replace each cell by the mean of those within `radius` along both axes; `spare` is memory.
pub(super) fn box_mean(
    cells: &mut [f32],
    spare: &mut Vec<f32>,
    (columns, rows): (usize, usize),
    radius: usize,
) -> Result<()> {
    let wide = columns + 2 * radius;
    resize("sums of cells", spare, columns * rows + wide, 0.0)?;
    let (across, padded) = spare.split_at_mut(columns * rows);
    let padded = &mut padded[..wide];
    padded.fill(0.0);
    let within = |at: usize, size: usize| at.saturating_sub(radius)..(at + radius + 1).min(size);
    for (from, to) in cells
        .chunks_exact(columns)
        .zip(across.chunks_exact_mut(columns))
    {
        padded[radius..radius + columns].copy_from_slice(from);
        add_all(to, (0..=2 * radius).map(|k| &padded[k..k + columns]));
        for (x, to) in to.iter_mut().enumerate() {
            *to /= within(x, columns).len() as f32;
        }
    }
    for (y, to) in cells.chunks_exact_mut(columns).enumerate() {
        let near = within(y, rows);
        let share = (near.len() as f32).recip();
        add_all(to, near.map(|row| &across[row * columns..][..columns]));
        for to in to {
            *to *= share;
        }
    }
    Ok(())
}

fn add_all<'a>(sums: &mut [f32], rows: impl Iterator<Item = &'a [f32]>) {
    sums.fill(0.0);
    for row in rows {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_that_of_the_cells_around() {
        let (columns, rows, radius) = (9usize, 7usize, 2usize);
        let before: Vec<f32> = (0..columns * rows).map(|k| (k * k % 11) as f32).collect();
        let mut cells = before.clone();
        box_mean(&mut cells, &mut Vec::new(), (columns, rows), radius).unwrap();
        for y in 0..rows {
            let down = y.saturating_sub(radius)..(y + radius + 1).min(rows);
            for x in 0..columns {
                let across = x.saturating_sub(radius)..(x + radius + 1).min(columns);
                let count = (down.len() * across.len()) as f32;
                let rows = down
                    .clone()
                    .map(|row| &before[row * columns..][across.clone()]);
                let want = rows.flatten().sum::<f32>() / count;
                assert!((cells[y * columns + x] - want).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn cells_that_are_not_known_take_the_value_of_one_that_is() {
        let unknown = f32::NAN;
        let mut cells = [
            unknown, unknown, unknown, 1.0, 2.0, unknown, unknown, unknown,
        ];
        carry(&mut cells, 2);
        assert_eq!(cells, [1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]);
        let mut nothing = [unknown; 4];
        carry(&mut nothing, 2);
        assert!(nothing.iter().all(|value| value.is_nan()));
    }
}
