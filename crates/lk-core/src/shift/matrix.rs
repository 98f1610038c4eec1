//! Symmetric matrices of two rows.

/// A matrix of two rows and two columns.
pub(super) type Matrix = [[f64; 2]; 2];

/// The inverse of a symmetric matrix; `None` unless it is positive.
pub(super) fn inverse(a: Matrix) -> Option<Matrix> {
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    (determinant > 0.0 && a[0][0] > 0.0).then(|| {
        [
            [a[1][1] / determinant, -a[0][1] / determinant],
            [-a[1][0] / determinant, a[0][0] / determinant],
        ]
    })
}

/// The product of two matrices.
pub(super) fn product(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

/// `x' matrix x`.
pub(super) fn quadratic(matrix: Matrix, [x, y]: [f64; 2]) -> f64 {
    matrix[0][0] * x * x + (matrix[0][1] + matrix[1][0]) * x * y + matrix[1][1] * y * y
}

/// The unit eigenvector of the larger eigenvalue of a symmetric matrix.
pub(super) fn largest_direction(matrix: Matrix) -> [f64; 2] {
    let angle = (2.0 * matrix[0][1]).atan2(matrix[0][0] - matrix[1][1]) / 2.0;
    [angle.cos(), angle.sin()]
}

/// Eigenvalues of a symmetric matrix, the smaller first.
pub(super) fn eigenvalues(matrix: Matrix) -> [f64; 2] {
    let half = (matrix[0][0] + matrix[1][1]) / 2.0;
    let radius = ((matrix[0][0] - matrix[1][1]) / 2.0).hypot(matrix[0][1]);
    [half - radius, half + radius]
}
