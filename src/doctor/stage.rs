//! The stages by name, in the order of the flow: the first that fails is where to look, as the
//! later ones build on it. The sorts scan, so the scan comes before them.

pub const PROJECT: &str = "project";
pub const SCAN: &str = "scan";
pub const RADIX_SORT: &str = "radix sort";
pub const BIN: &str = "bin";
pub const TILE_RANGES: &str = "tile_ranges";
pub const TILE_ORDER: &str = "tile_order";
pub const RASTERIZE: &str = "rasterize";
pub const LOSS: &str = "L1 + SSIM";
pub const MASKED_LOSS: &str = "L1 + SSIM, masked";
pub const RASTERIZE_BACKWARD: &str = "rasterize_backward";
pub const SUM_PAIRS: &str = "sum_pairs";
pub const PROJECT_BACKWARD: &str = "project_backward";
pub const POSE_BACKWARD: &str = "pose_backward";
pub const ADAM: &str = "Adam";
pub const REARRANGE: &str = "rearrange";
pub const RESET_OPACITY: &str = "reset_opacity";
pub const FIELD: &str = "field, on the CPU";
pub const POINT_SPLAT: &str = "point splat, on the CPU";

/// Every stage.
pub const ALL: [&str; 18] = [
    PROJECT,
    SCAN,
    RADIX_SORT,
    BIN,
    TILE_RANGES,
    TILE_ORDER,
    RASTERIZE,
    LOSS,
    MASKED_LOSS,
    RASTERIZE_BACKWARD,
    SUM_PAIRS,
    PROJECT_BACKWARD,
    POSE_BACKWARD,
    ADAM,
    REARRANGE,
    RESET_OPACITY,
    FIELD,
    POINT_SPLAT,
];
