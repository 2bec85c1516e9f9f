//! The stages by name, in the order of the flow: the first that fails is where to look, as the
//! later ones build on it. The sorts scan, so the scan comes before them.

use crate::gpu::Rasterizer;

/// Projects Gaussians to splats and keys them by depth.
pub const PROJECT: &str = "project";
/// Sums the counts of pairs up, so that each splat knows its first pair.
pub const SCAN: &str = "scan";
/// Sums the counts up, the threads of a workgroup as a tree.
pub const SCAN_WORKGROUP: &str = "scan, workgroup";
/// Sorts splats by depth, and pairs by tile.
pub const RADIX_SORT: &str = "radix sort";
/// Sorts them, a workgroup a block of entries.
pub const RADIX_SORT_WORKGROUP: &str = "radix sort, workgroup";
/// Counts and emits the pairs of a splat and a tile that it reaches.
pub const BIN: &str = "bin";
/// Emits pairs for the tiles of a workgroup.
pub const BIN_WORKGROUP: &str = "bin, workgroup";
/// Finds where the list of each tile begins and ends.
pub const TILE_RANGES: &str = "tile_ranges";
/// Orders the tiles of a block by the length of their lists.
pub const TILE_ORDER: &str = "tile_order";
/// Takes 2^x, whichever the rule gives the adapter.
pub const EXP2: &str = "2^x";
/// Blends the splats of each tile to an image.
pub const RASTERIZE: &str = "rasterize";
/// Blends the splats of each tile, a workgroup a tile.
pub const RASTERIZE_WORKGROUP: &str = "rasterize, workgroup";
/// Compares an image with its target image, and finds the gradient.
pub const LOSS: &str = "L1 + SSIM";
/// Compares an image with its target image, each pixel by its weight, and finds the gradient.
pub const MASKED_LOSS: &str = "L1 + SSIM, masked";
/// Compares the images, a workgroup a part of a strip.
pub const LOSS_WORKGROUP: &str = "L1 + SSIM, workgroup";
/// Compares the images by the pixels' weights, a workgroup a part of a strip.
pub const MASKED_LOSS_WORKGROUP: &str = "L1 + SSIM, masked, workgroup";
/// Carries the image's gradient back to the pairs.
pub const RASTERIZE_BACKWARD: &str = "rasterize_backward";
/// Finds the gradients of splats, a workgroup a tile.
pub const RASTERIZE_BACKWARD_WORKGROUP: &str = "rasterize_backward, workgroup";
/// Sums the gradients of the pairs of one Gaussian, block by block.
pub const SUM_PAIRS: &str = "sum_pairs";
/// Carries the pairs' gradients back to the stored parameters.
pub const PROJECT_BACKWARD: &str = "project_backward";
/// Carries the gradients back to the camera's pose.
pub const POSE_BACKWARD: &str = "pose_backward";
/// Finds depths and normals of Gaussians.
pub const PROJECT_DEPTH: &str = "project_depth";
/// Blends the depths and normals of each tile.
pub const RASTERIZE_DEPTH: &str = "rasterize_depth";
/// Blends the depths and normals of each tile, a workgroup a tile.
pub const RASTERIZE_DEPTH_WORKGROUP: &str = "rasterize_depth, workgroup";
/// Compares depths and normals with targets, and finds the gradient.
pub const DEPTH_LOSS: &str = "depth_loss";
/// Adds the gradients of depths and normals to the pairs'.
pub const RASTERIZE_DEPTH_BACKWARD: &str = "rasterize_depth_backward";
/// Adds these gradients, a workgroup a tile.
pub const RASTERIZE_DEPTH_BACKWARD_WORKGROUP: &str = "rasterize_depth_backward, workgroup";
/// Carries the gradients of depths and normals back to the stored parameters.
pub const PROJECT_DEPTH_BACKWARD: &str = "project_depth_backward";
/// Steps the parameters, SH by way of the colours' gradients.
pub const ADAM: &str = "Adam";
/// Carries a densification plan out.
pub const REARRANGE: &str = "rearrange";
/// Bounds opacities from above and clears their moments.
pub const RESET_OPACITY: &str = "reset_opacity";
/// Hands renders over to the set of Gaussians that is trained beside.
pub const EXCHANGE: &str = "exchange";
/// Finds the potentials `U_info` and `U_conf` of directions.
pub const FIELD: &str = "field, on the CPU";
/// Splats the point cloud into a camera.
pub const POINT_SPLAT: &str = "point splat, on the CPU";

/// Every stage, in the order of the flow.
pub const ALL: [&str; 34] = [
    PROJECT,
    SCAN,
    SCAN_WORKGROUP,
    RADIX_SORT,
    RADIX_SORT_WORKGROUP,
    BIN,
    BIN_WORKGROUP,
    TILE_RANGES,
    TILE_ORDER,
    EXP2,
    RASTERIZE,
    RASTERIZE_WORKGROUP,
    LOSS,
    MASKED_LOSS,
    LOSS_WORKGROUP,
    MASKED_LOSS_WORKGROUP,
    RASTERIZE_BACKWARD,
    RASTERIZE_BACKWARD_WORKGROUP,
    SUM_PAIRS,
    PROJECT_BACKWARD,
    POSE_BACKWARD,
    PROJECT_DEPTH,
    RASTERIZE_DEPTH,
    RASTERIZE_DEPTH_WORKGROUP,
    DEPTH_LOSS,
    RASTERIZE_DEPTH_BACKWARD,
    RASTERIZE_DEPTH_BACKWARD_WORKGROUP,
    PROJECT_DEPTH_BACKWARD,
    ADAM,
    REARRANGE,
    RESET_OPACITY,
    EXCHANGE,
    FIELD,
    POINT_SPLAT,
];

/// The stages that are a rasterizer's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Own {
    /// Sums counts up.
    pub scan: &'static str,
    /// Sorts by radix.
    pub radix_sort: &'static str,
    /// Emits the pairs.
    pub bin: &'static str,
    /// Blends the splats of each tile.
    pub rasterize: &'static str,
    /// Compares images.
    pub loss: &'static str,
    /// Compares images by the pixels' weights.
    pub masked_loss: &'static str,
    /// Finds the gradients of the pairs.
    pub rasterize_backward: &'static str,
    /// Blends depths and normals.
    pub rasterize_depth: &'static str,
    /// Adds their gradients to the pairs'.
    pub rasterize_depth_backward: &'static str,
}

impl Own {
    /// Returns all of them.
    pub fn all(&self) -> [&'static str; 9] {
        [
            self.scan,
            self.radix_sort,
            self.bin,
            self.rasterize,
            self.loss,
            self.masked_loss,
            self.rasterize_backward,
            self.rasterize_depth,
            self.rasterize_depth_backward,
        ]
    }
}

/// Returns the stages of `rasterizer`.
pub fn own(rasterizer: Rasterizer) -> Own {
    match rasterizer {
        Rasterizer::Thread => Own {
            scan: SCAN,
            radix_sort: RADIX_SORT,
            loss: LOSS,
            masked_loss: MASKED_LOSS,
            bin: BIN,
            rasterize: RASTERIZE,
            rasterize_backward: RASTERIZE_BACKWARD,
            rasterize_depth: RASTERIZE_DEPTH,
            rasterize_depth_backward: RASTERIZE_DEPTH_BACKWARD,
        },
        Rasterizer::Workgroup => Own {
            scan: SCAN_WORKGROUP,
            radix_sort: RADIX_SORT_WORKGROUP,
            loss: LOSS_WORKGROUP,
            masked_loss: MASKED_LOSS_WORKGROUP,
            bin: BIN_WORKGROUP,
            rasterize: RASTERIZE_WORKGROUP,
            rasterize_backward: RASTERIZE_BACKWARD_WORKGROUP,
            rasterize_depth: RASTERIZE_DEPTH_WORKGROUP,
            rasterize_depth_backward: RASTERIZE_DEPTH_BACKWARD_WORKGROUP,
        },
    }
}
