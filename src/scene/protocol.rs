//! The pose protocol says how test cameras came to be where they are.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How the test cameras came into the frame of the training cameras. Figures under different
/// protocols do not compare. Scenes have the first two, evaluation makes
/// the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseProtocol {
    /// The scene gives both in one frame.
    SharedFrame,
    /// Some were interpolated between training cameras and never fitted to their photographs
    /// (InstantSplat's starting values).
    Interpolated,
    /// By the similarity that takes the training cameras' true poses to the estimated ones
    /// (Umeyama 1991).
    TrainingSimilarity,
    /// Fitted to the test photographs by gradient (InstantSplat, Fan et al. 2024).
    TestPoseFit,
}

impl fmt::Display for PoseProtocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PoseProtocol::SharedFrame => {
                "in one frame with the training cameras, as the scene has them"
            }
            PoseProtocol::Interpolated => "interpolated between training cameras",
            PoseProtocol::TrainingSimilarity => {
                "brought in by a similarity fitted to the training cameras"
            }
            PoseProtocol::TestPoseFit => "fitted to the test photographs",
        })
    }
}
