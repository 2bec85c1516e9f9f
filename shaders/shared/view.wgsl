// One rendered view: camera in the canonical frame, image and buffer sizes. 288 bytes.
// What a difference is formed of has low parts, which hold the digits that f32 has no room for.
struct View {
    // Rows of world-to-camera [R | t].
    w2c_x: vec4f,
    w2c_y: vec4f,
    w2c_z: vec4f,
    w2c_low_x: vec4f,
    w2c_low_y: vec4f,
    w2c_low_z: vec4f,
    // xyz: optical centre; w: near plane.
    center_near: vec4f,
    // w: 0, which the compiler does not know.
    center_low: vec4f,
    // fx, fy, cx, cy in pixels.
    intrinsics: vec4f,
    intrinsics_low: vec4f,
    // Bounds of x/z (xy) and y/z (zw) in the projection's Jacobian.
    ratio_bounds: vec4f,
    ratio_bounds_low: vec4f,
    // xyz: colour behind the last Gaussian.
    background: vec4f,
    // Image width and height in pixels, tiles across and down.
    size: vec4u,
    // Number of Gaussians, their stride in planar buffers; 2^32 times the probability of dropout,
    // its key.
    counts: vec4u,
    // x: pixels a plane of the padded image / 4, y: vec4s a row, z: this view's slot in the step,
    // w: longest list of a tile that the step's slices cover.
    planes: vec4u,
    // A Gaussian's share of the dropout's probability: x + y distance + z density; w: 1 where the
    // others' opacity makes up for those left out.
    drop_share: vec4f,
    // Distances from the optical centre up to which that share counts in full (x) and at 0.7 (y).
    drop_layers: vec4f,
}

// `p` less the optical centre.
fn from_center(view: View, p: vec3f) -> vec3f {
    return (p - view.center_near.xyz) - view.center_low.xyz;
}

// Colour, transmittance and gradients of four pixels side by side are one vec4f, so an image
// plane is an array<vec4f> of rows padded to whole tiles.
fn plane_index(view: View, plane: u32, x4: u32, y: u32) -> u32 {
    return plane * view.planes.x + y * view.planes.y + x4;
}
