//! Shape functions: how displacement may vary over a window, as polynomials of the place in it.

use crate::options::names;

/// How the displacement may vary over a window.
///
/// ```
/// use lk_core::GridShape;
///
/// assert_eq!("quadratic".parse::<GridShape>()?, GridShape::Quadratic);
/// assert_eq!(GridShape::default().to_string(), "affine");
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum GridShape {
    /// Not at all: the mean displacement of the window.
    Translation,
    /// Linearly: the window turns, grows and shears.
    #[default]
    Affine,
    /// As polynomials of second degree.
    Quadratic,
}

names!(GridShape, "shape": Translation "translation", Affine "affine", Quadratic "quadratic");

impl GridShape {
    /// The degree of its polynomials.
    pub(super) fn degree(self) -> usize {
        match self {
            Self::Translation => 0,
            Self::Affine => 1,
            Self::Quadratic => 2,
        }
    }
}

/// Monomials in x and y up to this degree: 1; x, y; x^2, x y, y^2; ...
pub(super) const fn monomials(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// Most monomials of a shape, and of the product of two.
pub(super) const TERMS: usize = monomials(2);
pub(super) const PRODUCTS: usize = monomials(4);

/// The exponents of x and y in each monomial, in the order of [`monomials`].
pub(super) const EXPONENTS: [[usize; 2]; PRODUCTS] = {
    let mut exponents = [[0; 2]; PRODUCTS];
    let (mut degree, mut at) = (0, 0);
    while at < PRODUCTS {
        let mut y = 0;
        while y <= degree {
            exponents[at] = [degree - y, y];
            at += 1;
            y += 1;
        }
        degree += 1;
    }
    exponents
};

/// Where the product of two monomials stands.
pub(super) const fn product(a: usize, b: usize) -> usize {
    let x = EXPONENTS[a][0] + EXPONENTS[b][0];
    let y = EXPONENTS[a][1] + EXPONENTS[b][1];
    let degree = x + y;
    degree * (degree + 1) / 2 + y
}

/// The motion of a window: for u and for v the factor of each monomial of the place in the window, which runs from -1 to 1
/// along both axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Warp(pub(super) [[f64; TERMS]; 2]);

impl Warp {
    /// The displacement of the window's centre.
    pub(super) fn displacement(&self) -> [f64; 2] {
        [self.0[0][0], self.0[1][0]]
    }

    /// Derivatives of u and of v along x and y at the centre, of a window that reaches `half` pixels.
    pub(super) fn gradient(&self, half: f64) -> [[f64; 2]; 2] {
        self.0.map(|factors| [factors[1] / half, factors[2] / half])
    }

    /// The same motion seen from `offset` half windows beside the centre.
    pub(super) fn seen_from(&self, [x, y]: [f64; 2]) -> Self {
        Self(self.0.map(|[c, cx, cy, cxx, cxy, cyy]| {
            [
                c + cx * x + cy * y + cxx * x * x + cxy * x * y + cyy * y * y,
                cx + 2.0 * cxx * x + cxy * y,
                cy + cxy * x + 2.0 * cyy * y,
                cxx,
                cxy,
                cyy,
            ]
        }))
    }

    /// Without the monomials above `degree`.
    pub(super) fn up_to(mut self, degree: usize) -> Self {
        for factors in &mut self.0 {
            factors[monomials(degree)..].fill(0.0);
        }
        self
    }

    /// Whether every factor is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.0
            .as_flattened()
            .iter()
            .all(|factor| factor.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_monomials_stand_where_they_are_sought() {
        let value = |at: usize, [x, y]: [i32; 2]| {
            x.pow(EXPONENTS[at][0] as u32) * y.pow(EXPONENTS[at][1] as u32)
        };
        for a in 0..TERMS {
            for b in 0..monomials(2) {
                let place = [3, 7];
                assert_eq!(
                    value(product(a, b), place),
                    value(a, place) * value(b, place)
                );
            }
        }
        assert_eq!(EXPONENTS[TERMS - 1], [0, 2]);
    }

    #[test]
    fn a_warp_is_the_same_from_another_place() {
        let warp = Warp([
            [1.0, 0.2, -0.3, 0.05, 0.02, -0.04],
            [0.5, 0.1, 0.4, -0.01, 0.03, 0.02],
        ]);
        let value = |warp: &Warp, [x, y]: [f64; 2]| {
            warp.0
                .map(|c| c[0] + c[1] * x + c[2] * y + c[3] * x * x + c[4] * x * y + c[5] * y * y)
        };
        let moved = warp.seen_from([0.5, -1.25]);
        for place in [[0.0, 0.0], [0.3, 0.7], [-1.0, 1.0]] {
            let (a, b) = (
                value(&moved, place),
                value(&warp, [place[0] + 0.5, place[1] - 1.25]),
            );
            assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
        }
        assert_eq!(
            moved
                .seen_from([-0.5, 1.25])
                .up_to(0)
                .displacement()
                .map(|d| (d * 1e9).round()),
            [1e9, 5e8]
        );
        assert_eq!(warp.gradient(2.0), [[0.1, -0.15], [0.05, 0.2]]);
    }
}
