// What the depth passes of all rasterizers share: four pixels side by side, forward and backward. Needs
// `view` and `depths`, whose planes hold first what is rendered, and then the loss's gradient with
// respect to it:
//   DEPTH_SUM              sum of w z over the splats' weights w and depths z
//   DEPTH_NORMAL, + 1, + 2 sum of w n over their normals n, in the camera's axes
//   DEPTH_MEDIAN           z of the splat that takes the transmittance to a half or less; 0: none does
//   DEPTH_MODE             z of the first splat of the largest w; 0: there is none
//   DEPTH_ALPHA            the largest w; then the gradient with respect to 1 - transmittance, and in
//                          slices what is behind
//   DEPTH_TRANSMITTANCE    as it is in the end; negative between slices where a pixel takes no more
//   DEPTH_LAST             one past the last blended splat, counted from its tile's first
//   DEPTH_MEDIAN_NUMBER, DEPTH_MODE_NUMBER   the same for these two splats; 0: there is none
#import shared/view
const DEPTH_SUM = 0u;
const DEPTH_NORMAL = 1u;
const DEPTH_MEDIAN = 4u;
const DEPTH_MODE = 5u;
const DEPTH_ALPHA = 6u;
const DEPTH_TRANSMITTANCE = 7u;
const DEPTH_LAST = 8u;
const DEPTH_MEDIAN_NUMBER = 9u;
const DEPTH_MODE_NUMBER = 10u;

fn depth_bits(plane: u32, x4: u32, y: u32) -> vec4u {
    return depths[plane_index(view, plane, x4, y)];
}

fn depth_plane(plane: u32, x4: u32, y: u32) -> vec4f {
    return bitcast<vec4f>(depth_bits(plane, x4, y));
}
