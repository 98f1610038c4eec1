//! What kind of map a camera's motion is, and the steps that stay within a kind.

use super::camera_rows::{Map, NUMBERS};

/// What kind of map a camera's motion is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraModel {
    /// Nothing could be fitted.
    None,
    /// Two parameters.
    Translation,
    /// Four parameters.
    Similarity,
    /// Six parameters.
    Affine,
    /// Eight parameters.
    Homography,
}

pub(super) const MODELS: [CameraModel; 4] = [
    CameraModel::Translation,
    CameraModel::Similarity,
    CameraModel::Affine,
    CameraModel::Homography,
];

const fn unit(k: usize) -> Map {
    let mut column = [0.0; NUMBERS];
    column[k] = 1.0;
    column
}

/// Steps of a homography's numbers that stay within a model.
const TRANSLATION: [Map; 2] = [unit(2), unit(5)];
const SIMILARITY: [Map; 4] = [
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    unit(2),
    unit(5),
];
const HOMOGRAPHY: [Map; 8] = [
    unit(0),
    unit(1),
    unit(2),
    unit(3),
    unit(4),
    unit(5),
    unit(6),
    unit(7),
];

impl CameraModel {
    /// Its name, in the field's words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Translation => "translation",
            Self::Similarity => "similarity",
            Self::Affine => "affine",
            Self::Homography => "homography",
        }
    }

    pub(super) fn columns(self) -> &'static [Map] {
        match self {
            Self::None => &[],
            Self::Translation => &TRANSLATION,
            Self::Similarity => &SIMILARITY,
            Self::Affine => &HOMOGRAPHY[..6],
            Self::Homography => &HOMOGRAPHY,
        }
    }
}
