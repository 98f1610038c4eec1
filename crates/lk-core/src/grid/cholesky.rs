//! Small symmetric systems: factors, solutions and inverses.

/// Unknowns at most: those of a quadratic shape, and of the light.
pub(super) const MOST: usize = 16;

/// A pivot below this share of its diagonal is nothing but rounding.
const LEAST_PIVOT: f64 = 1e-9;

/// A symmetric matrix of `MOST` unknowns or fewer; the lower half is read.
pub(super) type Matrix = [[f64; MOST]; MOST];

/// The factor of a positive definite matrix.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    lower: Matrix,
    size: usize,
}

impl Factor {
    /// Of the first `size` unknowns; `None` unless the matrix is positive definite beyond rounding.
    pub(super) fn new(matrix: &Matrix, size: usize) -> Option<Self> {
        let mut lower = [[0.0; MOST]; MOST];
        for i in 0..size {
            for j in 0..=i {
                let before: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
                let rest = matrix[i][j] - before;
                if i == j {
                    // False for NaN.
                    let is_definite = rest > LEAST_PIVOT * matrix[i][i] && rest.is_finite();
                    if !is_definite {
                        return None;
                    }
                    lower[i][i] = rest.sqrt();
                } else {
                    lower[i][j] = rest / lower[j][j];
                }
            }
        }
        Some(Self { lower, size })
    }

    /// The solution for the right side `rest`, in place.
    pub(super) fn solve(&self, rest: &mut [f64; MOST]) {
        for i in 0..self.size {
            let before: f64 = (0..i).map(|k| self.lower[i][k] * rest[k]).sum();
            rest[i] = (rest[i] - before) / self.lower[i][i];
        }
        for i in (0..self.size).rev() {
            let after: f64 = (i + 1..self.size).map(|k| self.lower[k][i] * rest[k]).sum();
            rest[i] = (rest[i] - after) / self.lower[i][i];
        }
    }

    /// Column `at` of the inverse.
    pub(super) fn inverse_column(&self, at: usize) -> [f64; MOST] {
        let mut column = [0.0; MOST];
        column[at] = 1.0;
        self.solve(&mut column);
        column
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn solutions_solve(values in prop::array::uniform32(-1.0f64..1.0), size in 1usize..9) {
            let mut matrix = [[0.0; MOST]; MOST];
            for i in 0..size {
                for j in 0..size {
                    matrix[i][j] = (0..4).map(|k| values[4 * i % 32 + k] * values[4 * j % 32 + k]).sum();
                }
                matrix[i][i] += 0.5;
            }
            let factor = Factor::new(&matrix, size).unwrap();
            for at in 0..size {
                let column = factor.inverse_column(at);
                for (i, row) in matrix.iter().enumerate().take(size) {
                    let product: f64 = (0..size).map(|j| row[j] * column[j]).sum();
                    prop_assert!((product - f64::from(u8::from(i == at))).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn what_is_not_definite_has_no_factor() {
        let mut matrix = [[0.0; MOST]; MOST];
        matrix[0][0] = 1.0;
        assert!(Factor::new(&matrix, 1).is_some());
        assert!(Factor::new(&matrix, 2).is_none());
        matrix[1][1] = f64::NAN;
        assert!(Factor::new(&matrix, 2).is_none());
    }
}
