//! What a caller gets.

use super::covariance::MOTION;

/// Whether a node was measured, or else why not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum GridStatus {
    /// Displacement and covariance hold.
    Measured = 0,
    /// Neither a neighbour nor a search led to a displacement that explains the window.
    NotFound = 1,
    /// Less than a quarter of the window counts in both frames.
    LowSupport = 2,
    /// The window has too little texture to tell its motion.
    LowTexture = 3,
    /// The steps did not come to rest, or went further than `max_displacement`.
    NotConverged = 4,
    /// What was found does not look like what was sought.
    LowCorrelation = 5,
    /// The standard deviation is above 0.3 pixels.
    Unsure = 6,
    /// The neighbours, with their gradients, say otherwise.
    Contradicted = 7,
}

impl GridStatus {
    /// Every status, in the order of its value.
    pub const ALL: [Self; 8] = [
        Self::Measured,
        Self::NotFound,
        Self::LowSupport,
        Self::LowTexture,
        Self::NotConverged,
        Self::LowCorrelation,
        Self::Unsure,
        Self::Contradicted,
    ];

    /// The name used in Python and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::NotFound => "not_found",
            Self::LowSupport => "low_support",
            Self::LowTexture => "low_texture",
            Self::NotConverged => "not_converged",
            Self::LowCorrelation => "low_correlation",
            Self::Unsure => "unsure",
            Self::Contradicted => "contradicted",
        }
    }
}

/// What was measured at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridNode {
    /// Whether it was measured.
    pub status: GridStatus,
    /// Displacement (u, v) in pixels, of what was found last where it does not hold; NaN where nothing was.
    pub displacement: [f32; 2],
    /// Derivatives of u along x and y, then those of v.
    pub gradient: [[f32; 2]; 2],
    /// Covariance of u, v and the derivatives in the order of `gradient`; infinite variances unless measured.
    pub covariance: [[f32; MOTION]; MOTION],
    /// Root mean square of what is left of the window's difference, in grey levels of `next`.
    pub residual: f32,
    /// Correlation of the window with what was found, light and deformation taken out.
    pub correlation: f32,
    /// Gain of the light at the window.
    pub gain: f32,
    /// Offset of the light at the node, in grey levels.
    pub offset: f32,
}

impl GridNode {
    /// A node that was not measured.
    pub(super) fn lost(status: GridStatus) -> Self {
        let mut covariance = [[0.0; MOTION]; MOTION];
        for (at, row) in covariance.iter_mut().enumerate() {
            row[at] = f32::INFINITY;
        }
        Self {
            status,
            displacement: [f32::NAN; 2],
            gradient: [[f32::NAN; 2]; 2],
            covariance,
            residual: f32::NAN,
            correlation: f32::NAN,
            gain: f32::NAN,
            offset: f32::NAN,
        }
    }

    /// The same, not valid for this reason.
    pub(super) fn refused(self, status: GridStatus) -> Self {
        Self {
            status,
            covariance: Self::lost(status).covariance,
            ..self
        }
    }

    /// Whether the node was measured.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.status == GridStatus::Measured
    }
}

/// Displacements on a regular grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// The place (x, y) of the first node, in pixels: its window's centre.
    pub first: [f64; 2],
    /// Pixels from one node to the next.
    pub step: usize,
    /// Nodes in a row.
    pub columns: usize,
    /// Rows of nodes.
    pub rows: usize,
    /// Row by row.
    pub nodes: Vec<GridNode>,
}

impl Grid {
    /// The place (x, y) of the node in this column and row.
    #[must_use]
    pub fn place(&self, column: usize, row: usize) -> [f64; 2] {
        let step = self.step as f64;
        [
            self.first[0] + column as f64 * step,
            self.first[1] + row as f64 * step,
        ]
    }
}
