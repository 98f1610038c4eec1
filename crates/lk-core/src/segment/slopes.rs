//! Gradients of rows: central differences, the frame's border repeated.

/// Write the differences along x and down of the middle one of three rows. For kernels: it is compiled with their
/// instructions.
#[inline(always)]
pub(crate) fn gradient([above, row, below]: [&[f32]; 3], gx: &mut [f32], gy: &mut [f32]) {
    let width = row.len();
    for ((to, above), below) in gy.iter_mut().zip(above).zip(below) {
        *to = 0.5 * (below - above);
    }
    if width < 2 {
        gx.fill(0.0);
        return;
    }
    gx[0] = 0.5 * (row[1] - row[0]);
    gx[width - 1] = 0.5 * (row[width - 1] - row[width - 2]);
    for ((to, left), right) in gx[1..width - 1].iter_mut().zip(row).zip(&row[2..]) {
        *to = 0.5 * (right - left);
    }
}

/// The row above, itself and below of row `y` of a plane.
#[inline(always)]
pub(crate) fn rows_around(plane: &[f32], (width, height): (usize, usize), y: usize) -> [&[f32]; 3] {
    [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| &plane[y * width..][..width])
}
