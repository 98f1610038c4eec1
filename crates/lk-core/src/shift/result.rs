//! What a caller gets.

/// Whether a displacement could be measured, and if not, why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum ShiftStatus {
    /// Measured.
    Valid = 0,
    /// The window, or what a mask or NaN leave of it, has too few pixels.
    TooSmall = 1,
    /// At the displacement found, the frames share too little of the window.
    TooLittleOverlap = 2,
    /// The window shows no structure that stands out of the noise.
    NoTexture = 3,
    /// The window shows structure in one direction only: motion along it cannot be seen. The displacement across it is
    /// given, with infinite variance along it, unless the structure repeats.
    Aperture = 4,
    /// Nothing in the other frame looks like the window: a scene cut, or motion beyond `max_displacement`.
    NoMatch = 5,
    /// The iteration did not settle.
    NotConverged = 6,
    /// The window repeats: another displacement within `max_displacement` explains the frames as well.
    Ambiguous = 7,
}

impl ShiftStatus {
    /// Every status, in the order of its values.
    pub const ALL: [Self; 8] = [
        Self::Valid,
        Self::TooSmall,
        Self::TooLittleOverlap,
        Self::NoTexture,
        Self::Aperture,
        Self::NoMatch,
        Self::NotConverged,
        Self::Ambiguous,
    ];

    /// The name used in Python and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::TooSmall => "too_small",
            Self::TooLittleOverlap => "too_little_overlap",
            Self::NoTexture => "no_texture",
            Self::Aperture => "aperture",
            Self::NoMatch => "no_match",
            Self::NotConverged => "not_converged",
            Self::Ambiguous => "ambiguous",
        }
    }
}

/// The displacement of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Shift {
    /// Displacement to the right, in pixels; NaN where not measured.
    pub dx: f64,
    /// Displacement down, in pixels; NaN where not measured.
    pub dy: f64,
    /// Covariance of (dx, dy), in square pixels; infinite where not measured.
    pub covariance: [[f64; 2]; 2],
    /// Where the status is [`ShiftStatus::Aperture`] and the displacement across the structure was measured: the unit
    /// vector (x, y) across it; NaN otherwise. `dx` and `dy` are then the displacement along this vector, the smallest
    /// that explains the frames, and the covariance is infinite along the structure.
    pub direction: [f64; 2],
    /// The variance of the displacement along `direction`, in square pixels; infinite without one.
    pub direction_variance: f64,
    /// The gradient of the displacement, [[du/dx, du/dy], [dv/dx, dv/dy]], of a window that may deform: what was at
    /// (x, y) in `prev`, counted from the centre of the window, is at (x + dx + du/dx x + du/dy y, ...) in `next`. Zero
    /// without [`ShiftDeformation::Affine`](crate::ShiftDeformation::Affine); NaN where not measured.
    pub gradient: [[f64; 2]; 2],
    /// The covariance of (dx, dy, du/dx, du/dy, dv/dx, dv/dy); that of the gradient is zero without
    /// [`ShiftDeformation::Affine`](crate::ShiftDeformation::Affine), and infinite where not measured.
    pub joint_covariance: [[f64; 6]; 6],
    /// `next = gain * prev + offset`, on average over the window; 1 if the model has no gain.
    pub gain: f64,
    /// See `gain`; in grey levels, 0 if the model has no offset.
    pub offset: f64,
    /// Root mean square of `next - prev` after motion and light, in grey levels.
    pub residual: f64,
    /// Whether the displacement could be measured, and if not, why.
    pub status: ShiftStatus,
}

impl Shift {
    /// As a displacement alone, that of the window's centre.
    pub(super) fn without_gradient(self) -> Self {
        Self {
            gradient: [[0.0; 2]; 2],
            joint_covariance: without_gradient(self.covariance),
            ..self
        }
    }

    /// A displacement that could not be measured.
    pub(super) fn invalid(status: ShiftStatus) -> Self {
        Self {
            dx: f64::NAN,
            dy: f64::NAN,
            covariance: [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]],
            direction: [f64::NAN; 2],
            direction_variance: f64::INFINITY,
            gradient: [[f64::NAN; 2]; 2],
            joint_covariance: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { f64::INFINITY } else { 0.0 })
            }),
            gain: f64::NAN,
            offset: f64::NAN,
            residual: f64::NAN,
            status,
        }
    }

    /// Whether the displacement was measured.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.status == ShiftStatus::Valid
    }
}

/// The joint covariance where there is no gradient.
pub(super) fn without_gradient(covariance: [[f64; 2]; 2]) -> [[f64; 6]; 6] {
    let mut joint = [[0.0; 6]; 6];
    for (joint, row) in joint.iter_mut().zip(covariance) {
        joint[..2].copy_from_slice(&row);
    }
    joint
}
